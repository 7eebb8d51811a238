#include "weft/model/tucker_parts.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <functional>
#include <nlohmann/json.hpp>

#include "weft/error.hpp"
#include "weft/model/storage.hpp"
#include "weft/model/tucker_ranks.hpp"
#include "weft/reference/mode_product.hpp"

namespace weft {
namespace {

// A copy without core and factors.
std::unique_ptr<TuckerModel> like(const TuckerModel& model) {
  auto copy = std::make_unique<TuckerModel>();
  copy->info = model.info;
  copy->info.errors.reset();  // they were measured of the model as it was
  copy->set_groups(model.groups);
  copy->ranks = model.ranks;
  return copy;
}

// Calls use(part) for the parts of a list between commas; none of an empty list.
void for_each_part(std::string_view list, const std::function<void(std::string_view)>& use) {
  for (std::size_t at = 0; at < list.size();) {
    const std::size_t end = std::min(list.find(',', at), list.size());
    use(list.substr(at, end - at));
    at = end + 1;
  }
}

std::vector<double> widened(std::span<const float> values) {
  return {values.begin(), values.end()};
}

}  // namespace

std::unique_ptr<TuckerModel> with_ranks(const TuckerModel& model, std::string_view ranks) {
  std::unique_ptr<TuckerModel> less = like(model);
  std::vector<bool> named(model.groups.count(), false);
  for_each_part(ranks, [&](std::string_view part) {
    const std::size_t equals = std::min(part.find('='), part.size());
    const std::string_view digits = part.substr(std::min(equals + 1, part.size()));
    std::size_t rank = 0;
    const auto [stop, status] = std::from_chars(digits.data(), digits.data() + digits.size(), rank);
    if (status != std::errc() || stop != digits.data() + digits.size() || rank == 0) {
      fail_input("--ranks {}: '{}' is not MODE=RANK with a rank of at least 1", ranks, part);
    }
    const std::size_t n =
        model.groups.find(part.substr(0, equals), fmt::format("--ranks {}", ranks));
    const std::string& name = model.groups.groups()[n].name;
    if (named[n]) fail_input("--ranks {}: mode {} is named twice", ranks, name);
    named[n] = true;
    if (!model.has_factor(n)) {
      fail_input("--ranks {}: mode {} is whole in this model, it has no factor to cut", ranks,
                 name);
    }
    if (rank > model.ranks[n]) {
      fail_input("--ranks {}: rank {} is above the model's {} in mode {}", ranks, rank,
                 model.ranks[n], name);
    }
    less->ranks[n] = rank;
  });
  less->core = leading_part(model.core, model.ranks, less->ranks);
  for (std::size_t n = 0; n < model.groups.count(); ++n) {
    if (!model.has_factor(n)) continue;
    less->factors[n] = leading_columns(model.factors[n], model.ranks[n], less->ranks[n]);
  }
  // what is left of a tensor are its first components
  for (const ModelTensor& tensor : less->tensors()) {
    const auto quantised = less->info.quantised.find(tensor.name);
    if (quantised == less->info.quantised.end()) continue;
    quantised->second.steps.resize(tensor.shape[tensor.component_axis]);
  }
  round_to_storage(*less);
  restate_ranks(*less);
  return less;
}

void restate_ranks(TuckerModel& model) {
  auto said = nlohmann::ordered_json::parse(model.info.parameters, nullptr, false);
  if (!said.is_object()) return;  // another program's, who may say what it likes
  if (said.contains("ranks")) {
    auto ranks = nlohmann::ordered_json::object();
    for (std::size_t n = 0; n < model.groups.count(); ++n) {
      ranks[model.groups.groups()[n].name] = model.ranks[n];
    }
    said["ranks"] = ranks;
  }
  for (const char* error : {"factors_error", "error_bound", "discarded"}) said.erase(error);
  model.info.parameters = said.dump();
}

std::unique_ptr<TuckerModel> expanded(const TuckerModel& model, std::string_view modes) {
  std::unique_ptr<TuckerModel> larger = like(model);
  larger->factors = model.factors;
  std::vector<double> core = widened(model.core);
  for_each_part(modes, [&](std::string_view name) {
    const std::size_t n = model.groups.find(name, fmt::format("--expand {}", modes));
    if (!larger->has_factor(n)) return;
    const std::size_t size = model.groups.groups()[n].size;
    core = reference::mode_product(larger->ranks, n, core, size, widened(larger->factors[n]));
    larger->ranks[n] = size;
    larger->factors[n].clear();
  });
  larger->core = std::vector<float>(core.begin(), core.end());
  // products are not halves
  if (larger->ranks != model.ranks) set_storage(*larger, Storage::f32);
  return larger;
}

std::unique_ptr<TuckerModel> at_directions(const TuckerModel& model, const BtfInfo& info,
                                           std::span<const DirectionWeights> views,
                                           std::span<const DirectionWeights> lights) {
  const BtfShape& whole = model.info.btf.shape;
  auto between = std::make_unique<TuckerModel>();
  between->info = model.info;
  between->info.errors.reset();
  set_storage(*between, Storage::f32);
  between->info.btf = info;
  BtfShape& shape = between->info.btf.shape;
  shape = whole;
  shape.views = views.size();
  shape.lights = lights.size();
  between->set_groups(ModeGroups(shape, model.groups.merge()));
  between->ranks = model.ranks;
  between->factors = model.factors;
  std::vector<double> core = widened(model.core);

  // Rows of each mode of directions as combinations of its measured rows.
  const DirectionWeights alone;
  for (std::size_t n = 0; n < model.groups.count(); ++n) {
    const ModeGroup& group = model.groups.groups()[n];
    if (!group.of_directions()) continue;
    const std::size_t channels = group.has(Mode::channel) ? whole.channels : 1;
    const auto view_list = group.has(Mode::view) ? views : std::span(&alone, 1);
    const auto light_list = group.has(Mode::light) ? lights : std::span(&alone, 1);
    const std::size_t rows = view_list.size() * light_list.size() * channels;
    std::vector<double> combination(rows * group.size, 0.0);  // [new rows][measured rows]
    std::size_t row = 0;
    for (const DirectionWeights& view : view_list) {
      for (const DirectionWeights& light : light_list) {
        for (std::size_t c = 0; c < channels; ++c, ++row) {
          for (std::size_t a = 0; a < 3; ++a) {
            for (std::size_t b = 0; b < 3; ++b) {
              std::size_t at = c;
              if (group.has(Mode::view)) at += view.index[a] * model.groups.stride(Mode::view);
              if (group.has(Mode::light)) at += light.index[b] * model.groups.stride(Mode::light);
              combination[row * group.size + at] +=
                  view.weight[a] * light.weight[b] * view.scale * light.scale;
            }
          }
        }
      }
    }
    if (model.has_factor(n)) {
      const std::array<std::size_t, 2> sizes{group.size, model.ranks[n]};
      const std::vector<double> made =
          reference::mode_product(sizes, 0, widened(model.factors[n]), rows, combination);
      between->factors[n].assign(made.begin(), made.end());
    } else {
      core = reference::mode_product(between->ranks, n, core, rows, combination);
      between->ranks[n] = rows;
    }
  }
  between->core = std::vector<float>(core.begin(), core.end());
  return between;
}

}  // namespace weft
