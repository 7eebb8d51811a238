#include "weft/model/group_tensors.hpp"

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "weft/error.hpp"
#include "weft/model/selected_indices.hpp"

namespace weft {
namespace {

// The lists of indices that a selection keeps of each mode.
std::array<std::vector<std::size_t>, mode_count> kept_indices(const BtfShape& shape,
                                                              const Selection& selection) {
  const SelectedIndices indices = selected_indices(shape, selection);
  const Region region = selection.region.value_or(Region{0, 0, shape.width, shape.height});
  std::array<std::vector<std::size_t>, mode_count> kept;
  kept[index_of(Mode::view)] = indices.views;
  kept[index_of(Mode::light)] = indices.lights;
  kept[index_of(Mode::channel)] = indices.channels;
  for (std::size_t y = 0; y < region.height; ++y) {
    kept[index_of(Mode::row)].push_back(region.y + y);
  }
  for (std::size_t x = 0; x < region.width; ++x) {
    kept[index_of(Mode::column)].push_back(region.x + x);
  }
  return kept;
}

}  // namespace

std::vector<std::uint8_t> group_numbers(const ModeGroups& groups) {
  std::vector<std::uint8_t> numbers;
  for (const Mode mode : all_modes) {
    numbers.push_back(static_cast<std::uint8_t>(groups.group_of(mode)));
  }
  return numbers;
}

ModeGroups read_groups(const ModelFile& file) {
  // Modes of the same number are merged; the numbers must be those that this makes.
  const std::vector<std::uint32_t> numbers = file.index_tensor("modes", {mode_count}, mode_count);
  std::string merge;
  for (std::uint32_t g = 0; g < mode_count; ++g) {
    std::string group;
    for (const Mode mode : all_modes) {
      if (numbers[index_of(mode)] == g) group += name_of(mode);
    }
    if (group.size() > 1) merge += (merge.empty() ? "" : ",") + group;
  }
  ModeGroups groups;
  try {
    groups = ModeGroups(file.info().btf.shape, merge);
  } catch (const Error& error) {
    file.reject(std::string("tensor \"modes\": ") + error.what());
  }
  const std::vector<std::uint8_t> made = group_numbers(groups);
  if (!std::equal(numbers.begin(), numbers.end(), made.begin())) {
    file.reject("tensor \"modes\": groups are not numbered in the order of the core");
  }
  return groups;
}

std::vector<std::vector<std::size_t>> kept_rows(const ModeGroups& groups, const BtfShape& shape,
                                                const Selection& selection) {
  const auto kept = kept_indices(shape, selection);
  std::vector<std::vector<std::size_t>> of_groups;
  for (const ModeGroup& group : groups.groups()) {
    // rows of the group, its last mode fastest
    std::vector<std::size_t> rows{0};
    for (const Mode mode : group.modes) {
      std::vector<std::size_t> longer;
      for (const std::size_t row : rows) {
        for (const std::size_t index : kept[index_of(mode)]) {
          longer.push_back(row + index * groups.stride(mode));
        }
      }
      rows = std::move(longer);
    }
    of_groups.push_back(std::move(rows));
  }
  return of_groups;
}

std::vector<float> take_rows(std::span<const float> T, std::size_t outer, std::size_t n,
                             std::size_t inner, std::span<const std::size_t> rows) {
  std::vector<float> part;
  part.reserve(outer * rows.size() * inner);
  for (std::size_t o = 0; o < outer; ++o) {
    for (const std::size_t row : rows) {
      const auto from = T.begin() + static_cast<std::ptrdiff_t>((o * n + row) * inner);
      part.insert(part.end(), from, from + static_cast<std::ptrdiff_t>(inner));
    }
  }
  return part;
}

std::vector<std::vector<double>> group_divisors(const ModeGroups& groups, const BtfShape& shape,
                                                const Weights& factors, std::string_view codec) {
  const auto split = rows_and_columns(factors.texels, shape.height, shape.width);
  if (groups.group_of(Mode::row) != groups.group_of(Mode::column) && !split) {
    fail_runtime("{}: texel factors are no products", codec);
  }
  std::vector<std::vector<double>> divisors;
  for (const ModeGroup& group : groups.groups()) {
    const auto index = [&](Mode mode, std::size_t i) {
      return i / groups.stride(mode) % mode_size(shape, mode);
    };
    std::vector<double> s(group.size, 1.0);
    for (std::size_t i = 0; i < group.size; ++i) {
      if (group.has(Mode::view) && !factors.views.empty()) {
        s[i] *= factors.views[index(Mode::view, i)];
      }
      if (group.has(Mode::light) && !factors.lights.empty()) {
        s[i] *= factors.lights[index(Mode::light, i)];
      }
      if (factors.texels.empty()) continue;
      if (group.has(Mode::row) && group.has(Mode::column)) {
        s[i] *= factors.texels[index(Mode::row, i) * shape.width + index(Mode::column, i)];
      } else if (group.has(Mode::row)) {
        s[i] *= split->first[index(Mode::row, i)];
      } else if (group.has(Mode::column)) {
        s[i] *= split->second[index(Mode::column, i)];
      }
    }
    const bool ones = std::all_of(s.begin(), s.end(), [](double value) { return value == 1; });
    divisors.push_back(ones ? std::vector<double>() : std::move(s));
  }
  return divisors;
}

}  // namespace weft
