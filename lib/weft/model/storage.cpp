#include "weft/model/storage.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>

#include "weft/error.hpp"
#include "weft/model/component_scale.hpp"
#include "weft/model/quantise.hpp"
#include "weft/model/tt.hpp"

namespace weft {
namespace {

// The number that all of `text` is.
template <typename T>
bool parse(std::string_view text, T& value) {
  const auto [stop, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  return status == std::errc() && stop == text.data() + text.size();
}

// Calls visit(n, tensor) for the real-valued tensors.
template <typename Visit>
void for_each_real(const Model& model, const Visit& visit) {
  std::size_t n = 0;
  for (const ModelTensor& tensor : model.tensors()) {
    if (tensor.dtype == DType::f32) visit(n++, tensor);
  }
}

}  // namespace

StorageRequest storage_request(std::string_view text) {
  constexpr std::string_view bits = "q=";
  constexpr std::string_view automatic = "auto";
  StorageRequest request;
  if (text == "f16") return request;
  if (text == "f32") {
    request.kind = StorageRequest::Kind::single;
    return request;
  }
  if (text.starts_with(bits)) {
    request.kind = StorageRequest::Kind::bits;
    if (!parse(text.substr(bits.size()), request.bits) || request.bits < least_bits ||
        request.bits > most_bits) {
      fail_input("--storage {}: q=BITS takes {} to {} bits", text, least_bits, most_bits);
    }
    return request;
  }
  if (!text.starts_with(automatic)) {
    fail_input("--storage {}: none of f16, f32, q=BITS, auto, auto=SLACK", text);
  }
  request.kind = StorageRequest::Kind::automatic;
  const std::string_view slack = text.substr(automatic.size());
  // not NaN either
  if (!slack.empty() && (slack.front() != '=' || !parse(slack.substr(1), request.slack) ||
                         !(request.slack > 0 && request.slack <= 1))) {
    fail_input("--storage {}: auto=SLACK takes a slack above 0 and up to 1", text);
  }
  return request;
}

std::string storage_text(const ModelInfo& info) {
  std::string rest = info.storage == Storage::f16 ? "f16" : "f32";
  if (info.quantised.empty()) return rest;
  const auto by_bits = [](const auto& a, const auto& b) { return a.second.bits < b.second.bits; };
  const auto [least, most] =
      std::minmax_element(info.quantised.begin(), info.quantised.end(), by_bits);
  const unsigned first = least->second.bits;
  const unsigned last = most->second.bits;
  return first == last ? fmt::format("q={}", first) : fmt::format("q={}-{}", first, last);
}

void set_storage(Model& model, Storage storage) {
  model.info.storage = storage;
  model.info.quantised.clear();
  // a train says it of each core
  if (auto* train = dynamic_cast<TtModel*>(&model)) train->stored.fill(storage);
}

void round_to_storage(Model& model) {
  const std::vector<std::span<float>> values = model.real_values();
  for_each_real(model, [&](std::size_t n, const ModelTensor& tensor) {
    if (tensor.storage.value_or(model.info.storage) == Storage::f16) {
      round_to_scaled_half(values[n], component_layout(tensor.shape, tensor.component_axis));
    }
  });
}

void quantise_all(Model& model, unsigned bits) {
  set_storage(model, Storage::f32);
  quantise_others(model, bits);
}

void quantise_others(Model& model, unsigned bits) {
  const std::vector<std::span<float>> values = model.real_values();
  for_each_real(model, [&](std::size_t n, const ModelTensor& tensor) {
    if (model.info.quantised.contains(tensor.name)) return;
    const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
    const std::vector<float> steps = steps_of_bits(component_peaks(values[n], layout), bits);
    Quantisation& quantisation = model.info.quantised[tensor.name];
    quantisation = {bits, steps};
    quantise(values[n], layout, quantisation);
  });
}

void quantise_tensor(Model& model, std::size_t n, std::span<const float> steps) {
  const std::span<float> values = model.real_values()[n];
  for_each_real(model, [&](std::size_t i, const ModelTensor& tensor) {
    if (i != n) return;
    const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
    const std::vector<float> peaks = component_peaks(values, layout);
    std::vector<float> taken = steps_of_bits(peaks, most_bits);
    for (std::size_t c = 0; c < taken.size(); ++c) taken[c] = std::max(taken[c], steps[c]);
    Quantisation& quantisation = model.info.quantised[tensor.name];
    quantisation = {bits_of_steps(peaks, taken), std::move(taken)};
    quantise(values, layout, quantisation);
  });
}

}  // namespace weft
