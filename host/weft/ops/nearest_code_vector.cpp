#include "weft/ops/nearest_code_vector.hpp"

#include <algorithm>
#include <limits>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

// Bytes of code-vectors in one buffer, and of vectors that are on their way to or from one.
constexpr std::size_t part_bytes = std::size_t{128} << 20;

// Values of a run, the kernel's KC.
constexpr std::size_t run = 256;

// Code-vectors that pass by together: rows of micro_tile.cl.
std::size_t group_rows(const Device& device) {
  return vector_width(device) == 16 ? 8 : 4;
}

std::size_t rows_of_part(const Device& device, const VectorShape& shape) {
  const std::size_t fitting = part_bytes / (shape.values() * sizeof(float));
  const std::size_t rows = group_rows(device);
  return std::max(fitting / rows, std::size_t{1}) * rows;
}

Buffer upload(Device& device, std::span<const float> values, const char* what) {
  Buffer buffer(device, values.size() * sizeof(float), what);
  device.write(buffer, values);
  return buffer;
}

}  // namespace

void DeviceNearestSearch::set(const VectorShape& shape, std::span<const float> code_vectors) {
  shape_ = shape;
  parts_.clear();
  const std::size_t values = shape.values();
  const std::size_t count = code_vectors.size() / values;
  const std::size_t lanes = group_rows(device_);
  const std::size_t rows = rows_of_part(device_, shape);
  const std::string options = vector_option(device_);
  for (std::size_t first = 0; first < count; first += rows) {
    const std::size_t here = std::min(rows, count - first);
    Part part{first, ceil_div(here, lanes), {}, {}};
    const Buffer raw = upload(device_, code_vectors.subspan(first * values, here * values),
                              "code-vectors on their way");
    part.packed = Buffer(device_, part.groups * lanes * values * sizeof(float), "code-vectors");
    part.squares = Buffer(device_, part.groups * lanes * 2 * sizeof(float), "their squares");
    const cl_kernel pack =
        device_.kernel(kernel_sources::nearest_code_vector, options, "pack_vectors");
    set_arguments(pack, ulong(shape.luminances), ulong(values), ulong(here), ulong(lanes),
                  std::uint32_t{0}, raw, part.squares, part.packed);
    launch_items(device_, pack, ceil_div(values, run), part.groups);
    const cl_kernel squares =
        device_.kernel(kernel_sources::nearest_code_vector, options, "half_squares");
    set_arguments(squares, ulong(shape.luminances), ulong(values), ulong(here), raw, part.squares);
    launch_items(device_, squares, part.groups * lanes);
    device_.finish();
    parts_.push_back(std::move(part));
  }
}

std::vector<std::uint32_t> DeviceNearestSearch::nearest(const ScaledVectors& vectors,
                                                        double /*most*/) {
  const std::size_t values = shape_.values();
  const std::size_t count = vectors.scales.size();
  std::vector<std::uint32_t> result;
  result.reserve(count);
  const std::size_t lanes = panel_width(device_);
  const std::size_t most =
      std::max(part_bytes / (values * sizeof(float)) / lanes, std::size_t{1}) * lanes;
  const std::string options = vector_option(device_);
  for (std::size_t first = 0; first < count; first += most) {
    const std::size_t here = std::min(most, count - first);
    const std::size_t panels = ceil_div(here, lanes);
    const std::size_t padded = panels * lanes;
    const Buffer raw = upload(device_, vectors.rows.subspan(first * values, here * values),
                              "vectors on their way");
    std::vector<float> padded_scales(padded, 0.0f);
    std::copy_n(vectors.scales.begin() + static_cast<std::ptrdiff_t>(first), here,
                padded_scales.begin());
    const Buffer scales = upload(device_, padded_scales, "scales of vectors");
    Buffer packed(device_, padded * values * sizeof(float), "vectors");
    Buffer best = upload(
        device_, std::vector<float>(padded, -std::numeric_limits<float>::infinity()), "scores");
    Buffer index(device_, padded * sizeof(std::uint32_t), "nearest code-vectors");
    device_.fill_zero(index, 0, padded * sizeof(std::uint32_t));
    const cl_kernel pack =
        device_.kernel(kernel_sources::nearest_code_vector, options, "pack_vectors");
    set_arguments(pack, ulong(shape_.luminances), ulong(values), ulong(here), ulong(lanes),
                  std::uint32_t{1}, raw, scales, packed);
    launch_items(device_, pack, ceil_div(values, run), panels);
    const cl_kernel kernel =
        device_.kernel(kernel_sources::nearest_code_vector, options, "nearest_code_vector");
    for (const Part& part : parts_) {
      set_arguments(kernel, ulong(values), ulong(part.groups),
                    static_cast<std::uint32_t>(part.first), packed, scales, part.packed,
                    part.squares, best, index);
      launch_items(device_, kernel, panels);
    }
    std::vector<std::uint32_t> found(padded);
    device_.read(index, std::span<std::uint32_t>(found));
    result.insert(result.end(), found.begin(), found.begin() + static_cast<std::ptrdiff_t>(here));
  }
  return result;
}

std::size_t DeviceNearestSearch::bytes(const Device& device, const VectorShape& shape,
                                       std::size_t code_vectors, std::size_t vectors) {
  const std::size_t row = shape.values() * sizeof(float);
  const std::size_t rows = round_up(code_vectors, group_rows(device));
  const std::size_t at_a_time = round_up(
      std::min(vectors, std::max(part_bytes / row, panel_width(device))), panel_width(device));
  // whole code-vectors, some of them on their way, or vectors twice
  return rows * (row + 2 * sizeof(float)) +
         std::max(std::min(rows * row, std::max(part_bytes, group_rows(device) * row)),
                  2 * at_a_time * (row + 2 * sizeof(float)));
}

}  // namespace weft::ops
