#include "weft/btf/btf.hpp"

#include <array>
#include <cmath>
#include <utility>

#include "weft/error.hpp"

namespace weft {
namespace {
// So that no number of bytes computed from a shape can overflow, whatever the type.
constexpr std::size_t largest_values = std::size_t{1} << 48;
// Kernels hold a few vectors per channel in private memory.
constexpr std::size_t largest_channels = 1024;

template <typename Value, std::size_t Size>
using Names = std::array<std::pair<Value, std::string_view>, Size>;

constexpr Names<Encoding, 3> encodings{
    {{Encoding::linear, "linear"}, {Encoding::srgb, "srgb"}, {Encoding::gamma22, "gamma2.2"}}};
constexpr Names<Quantity, 2> quantities{
    {{Quantity::radiance, "radiance"}, {Quantity::brdf, "brdf"}}};
constexpr Names<Layout, 2> layouts{{{Layout::grid, "grid"}, {Layout::paired, "paired"}}};

template <typename Value, std::size_t Size>
std::string_view find_name(const Names<Value, Size>& names, Value value) {
  for (const auto& [key, name] : names) {
    if (key == value) return name;
  }
  return "?";
}

template <typename Value, std::size_t Size>
Value find_value(const Names<Value, Size>& names, std::string_view name, std::string_view where) {
  std::string known;
  for (const auto& [value, text] : names) {
    if (text == name) return value;
    if (!known.empty()) known += ", ";
    known += text;
  }
  fail_input("{}: \"{}\" is none of {}", where, name.substr(0, 80), known);
}

void check_directions(const std::vector<Direction>& directions, std::size_t count,
                      std::string_view field, std::string_view where) {
  if (directions.size() != count) {
    fail_input("{}: {} holds {} directions, the shape asks for {}", where, field, directions.size(),
               count);
  }
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const auto [x, y, z] = directions[i];
    // In double, so that no finite component overflows.
    const double length = std::sqrt(double{x} * x + double{y} * y + double{z} * z);
    // Written so that NaN fails.
    if (!(std::abs(length - 1.0) <= 1e-3)) {
      fail_input("{}: {}[{}] = ({}, {}, {}) is no unit vector", where, field, i, x, y, z);
    }
  }
}

}  // namespace

std::string_view name_of(Encoding value) {
  return find_name(encodings, value);
}
std::string_view name_of(Quantity value) {
  return find_name(quantities, value);
}
std::string_view name_of(Layout value) {
  return find_name(layouts, value);
}

Encoding encoding_from_name(std::string_view name, std::string_view where) {
  return find_value(encodings, name, where);
}
Quantity quantity_from_name(std::string_view name, std::string_view where) {
  return find_value(quantities, name, where);
}
Layout layout_from_name(std::string_view name, std::string_view where) {
  return find_value(layouts, name, where);
}

void validate(const BtfInfo& info, std::string_view where) {
  if (info.dtype != DType::u8 && info.dtype != DType::f16 && info.dtype != DType::f32) {
    fail_input("{}: dtype {} is none of U8, F16, F32", where, name_of(info.dtype));
  }
  const BtfShape& shape = info.shape;
  const std::string sizes = fmt::format("[{}, {}, {}, {}, {}]", shape.views, shape.lights,
                                        shape.height, shape.width, shape.channels);
  std::size_t values = 1;
  for (std::size_t size : {shape.views, shape.lights, shape.height, shape.width, shape.channels}) {
    if (size == 0) fail_input("{}: shape {} has a size of 0", where, sizes);
    if (__builtin_mul_overflow(values, size, &values) || values > largest_values) {
      fail_input("{}: shape {} is too large", where, sizes);
    }
  }
  if (shape.channels > largest_channels) {
    fail_input("{}: shape {} has more than {} channels", where, sizes, largest_channels);
  }

  const bool paired = info.layout == Layout::paired;
  if (paired && shape.lights != 1) {
    fail_input("{}: layout paired asks for shape [N, 1, Y, X, C], found {}", where, sizes);
  }
  check_directions(info.view_directions, shape.views, "view_directions", where);
  check_directions(info.light_directions, paired ? shape.views : shape.lights, "light_directions",
                   where);

  if (!info.channel_names.empty() && info.channel_names.size() != shape.channels) {
    fail_input("{}: {} channel names for {} channels", where, info.channel_names.size(),
               shape.channels);
  }
  if (!info.mask_distance.empty()) {
    if (info.mask_distance.size() != shape.views * shape.texels()) {
      fail_input("{}: mask_distance holds {} values, shape {} asks for {}", where,
                 info.mask_distance.size(), sizes, shape.views * shape.texels());
    }
    for (std::size_t i = 0; i < info.mask_distance.size(); ++i) {
      // Written so that NaN fails.
      if (!(std::abs(info.mask_distance[i]) <= 1)) {
        fail_input("{}: mask_distance value {} at index {} is outside [-1, 1]", where,
                   info.mask_distance[i], i);
      }
    }
  }
  if (!info.mask.empty()) {
    if (info.mask.size() != shape.views * shape.texels()) {
      fail_input("{}: mask holds {} values, shape {} asks for {}", where, info.mask.size(), sizes,
                 shape.views * shape.texels());
    }
    for (std::size_t i = 0; i < info.mask.size(); ++i) {
      if (info.mask[i] > 1) {
        fail_input("{}: mask value {} at index {} is neither 0 nor 1", where, info.mask[i], i);
      }
    }
  }
}

}  // namespace weft
