// Writing a model: its real-valued tensors as F32, as F16 beside their scales, or entropy-coded
// beside the steps of their quantisation.
#include <algorithm>
#include <functional>
#include <map>
#include <optional>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/btf_tensors.hpp"
#include "weft/model/coded_tensor.hpp"
#include "weft/model/component_scale.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/model_metadata.hpp"
#include "weft/model/quantise.hpp"

namespace weft {
namespace {

// The tensors of the file. Values are not looked at, but where they are entropy-coded.
struct Plan {
  std::vector<TensorInfo> tensors;
  Metadata metadata;
  Checksums checksums;  // of the right length, to be filled in
  std::map<std::string, CodedBlob, std::less<>> coded;
};

// The values of a real-valued tensor. Throws if one is not finite: no reader would take it.
std::span<const float> checked_values(const ModelTensor& tensor, const std::string& where) {
  const std::span<const float> values(reinterpret_cast<const float*>(tensor.values.data()),
                                      tensor.values.size() / sizeof(float));
  for (std::size_t i = 0; i < values.size(); ++i) {
    // x - x is NaN for an infinity and for NaN.
    if (values[i] - values[i] != 0) {
      fail_runtime("{}: tensor \"{}\": value {} at index {} is not finite", where, tensor.name,
                   values[i], i);
    }
  }
  return values;
}

// A quantised tensor; of a model that has some, also indices that get smaller by more than what the
// metadata then say of them.
std::optional<CodedBlob> coded_blob(const ModelTensor& tensor, const ModelInfo& info,
                                    const std::string& where) {
  constexpr std::size_t entry_bytes = 96;
  if (tensor.dtype == DType::f32) {
    const auto found = info.quantised.find(tensor.name);
    if (found == info.quantised.end()) return std::nullopt;
    const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
    const std::string name = fmt::format("{}: tensor \"{}\"", where, tensor.name);
    return encode_quantised(tensor, found->second.bits,
                            codes_of(checked_values(tensor, where), layout, found->second, name));
  }
  if (is_float(tensor.dtype) || info.quantised.empty()) return std::nullopt;
  CodedBlob blob = encode_indices(tensor);
  if (blob.bytes.size() + entry_bytes > tensor.values.size()) return std::nullopt;
  return blob;
}

bool stored_as_half(const ModelTensor& tensor, Storage storage) {
  return tensor.dtype == DType::f32 && tensor.storage.value_or(storage) == Storage::f16;
}

Plan plan_of(const Model& model, const std::string& where) {
  Plan plan;
  plan.metadata = model_metadata(model.info, where);
  for (const ModelTensor& tensor : model.tensors()) {
    TensorInfo info{tensor.name, tensor.dtype, tensor.shape};
    if (tensor.values.size() != info.bytes()) {
      fail_runtime("{}: tensor \"{}\": {} bytes for shape {}", where, tensor.name,
                   tensor.values.size(), shape_text(tensor.shape));
    }
    if (std::optional<CodedBlob> blob = coded_blob(tensor, model.info, where)) {
      info.dtype = DType::u8;
      info.shape = {blob->bytes.size()};
      if (tensor.dtype == DType::f32) {
        const std::size_t components = model.info.quantised.at(tensor.name).steps.size();
        plan.tensors.push_back({tensor.name + ".step", DType::f32, {components}});
      }
      plan.coded.emplace(tensor.name, std::move(*blob));
    } else if (stored_as_half(tensor, model.info.storage)) {
      info.dtype = DType::f16;
      const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
      plan.tensors.push_back({tensor.name + ".scale", DType::f32, {layout.components}});
    }
    plan.tensors.push_back(std::move(info));
  }
  for (TensorInfo& tensor : btf_side_tensors(model.info.btf)) {
    plan.tensors.push_back(std::move(tensor));
  }
  for (const TensorInfo& tensor : plan.tensors) plan.checksums[tensor.name] = checksum_of({});
  plan.metadata["checksums"] = checksums_json(plan.checksums);
  if (!plan.coded.empty()) {
    CodedTensors coded;
    for (const auto& [name, blob] : plan.coded) coded[name] = blob.tensor;
    plan.metadata["weft.format"] = coded_format_version;
    plan.metadata["coded"] = coded_json(coded);
  }
  return plan;
}

}  // namespace

std::size_t write_model(const std::filesystem::path& path, const Model& model) {
  const std::string where = path.string();
  validate(model.info.btf, where);
  Plan plan = plan_of(model, where);
  SafetensorsWriter writer(path, plan.tensors, plan.metadata);
  const auto write = [&](const std::string& name, std::span<const std::byte> bytes) {
    writer.write(name, 0, bytes);
    plan.checksums[name] = checksum_of(bytes);
  };
  // A tensor may be most of what memory holds: its halves are made a block at a time.
  const auto write_halves = [&](const ModelTensor& tensor, std::span<const float> values) {
    constexpr std::size_t block = std::size_t{1} << 20;
    const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
    const std::vector<float> scales = component_scales(values, layout);
    write(tensor.name + ".scale", std::as_bytes(std::span(scales)));
    std::vector<std::uint16_t> halves(std::min(block, values.size()));
    Checksum checksum;
    for (std::size_t first = 0; first < values.size(); first += block) {
      const std::size_t count = std::min(block, values.size() - first);
      to_scaled_half(values.subspan(first, count), layout, scales, halves, first);
      const auto bytes = std::as_bytes(std::span<const std::uint16_t>(halves).first(count));
      writer.write(tensor.name, first * sizeof(std::uint16_t), bytes);
      checksum.add(bytes);
    }
    plan.checksums[tensor.name] = checksum.text();
  };

  for (const ModelTensor& tensor : model.tensors()) {
    if (const auto coded = plan.coded.find(tensor.name); coded != plan.coded.end()) {
      const auto quantised = model.info.quantised.find(tensor.name);
      if (quantised != model.info.quantised.end()) {
        write(tensor.name + ".step", std::as_bytes(std::span(quantised->second.steps)));
      }
      write(tensor.name, coded->second.bytes);
      continue;
    }
    if (is_float(tensor.dtype)) {
      const std::span<const float> values = checked_values(tensor, where);
      if (stored_as_half(tensor, model.info.storage)) {
        write_halves(tensor, values);
        continue;
      }
    }
    write(tensor.name, tensor.values);
  }
  for (const TensorInfo& tensor : btf_side_tensors(model.info.btf)) {
    write(tensor.name, btf_side_values(model.info.btf, tensor.name));
  }

  writer.set_metadata("checksums", checksums_json(plan.checksums));
  writer.finish();
  return writer.file_size();
}

std::size_t model_file_size(const Model& model) {
  Plan plan = plan_of(model, "model");
  return safetensors_file_size(std::move(plan.tensors), std::move(plan.metadata));
}

}  // namespace weft
