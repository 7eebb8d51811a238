#include "weft/ops/nearest_code_vector.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

// Bytes of code-vectors in one buffer, and of vectors that are on their way to or from one.
constexpr std::size_t part_bytes = std::size_t{128} << 20;

// Values of a run, the kernel's KC.
constexpr std::size_t run = 256;

// Groups of a block, the kernel's GROUP.
constexpr std::size_t block_groups = 8;

// Values of the longest vectors that blocks of code-vectors are skipped for: norms say little of
// longer ones, whose panels fill the caches.
constexpr std::size_t longest_pruned = 1024;

// Code-vectors that pass by together: rows of micro_tile.cl.
std::size_t group_rows(const Device& device) {
  return vector_width(device) == 16 ? 8 : 4;
}

std::size_t rows_of_part(const Device& device, const VectorShape& shape) {
  const std::size_t fitting = part_bytes / (shape.values() * sizeof(float));
  const std::size_t rows = group_rows(device);
  return std::max(fitting / rows, std::size_t{1}) * rows;
}

template <typename T>
Buffer upload(Device& device, std::span<const T> values, const char* what) {
  Buffer buffer(device, values.size_bytes(), what);
  device.write(buffer, values);
  return buffer;
}

template <typename T>
Buffer upload(Device& device, const std::vector<T>& values, const char* what) {
  return upload(device, std::span<const T>(values), what);
}

// |l'| / s, or |a| where there are no luminances: what rows are in the order of.
float key(const VectorShape& shape, const float* squares, float scale) {
  if (shape.luminances == 0) return std::sqrt(2 * squares[1]);
  return scale > 0 ? std::sqrt(2 * squares[0]) / scale : 0;
}

}  // namespace

bool DeviceNearestSearch::is_pruned() const {
  return pruning_ && shape_.values() <= longest_pruned;
}

DeviceNearestSearch::Ordered DeviceNearestSearch::order(std::span<const float> rows,
                                                        std::span<const float> scales) const {
  const std::size_t count = rows.size() / shape_.values();
  Ordered ordered{upload(device_, rows, "vectors on their way"), std::vector<float>(2 * count),
                  std::vector<std::uint32_t>(count)};
  std::iota(ordered.numbers.begin(), ordered.numbers.end(), 0U);
  // code-vectors need their squares in any case
  if (!is_pruned() && !scales.empty()) return ordered;
  const bool scaled = !scales.empty();
  const Buffer factors = scaled ? upload(device_, scales, "scales of vectors")
                                : Buffer(device_, sizeof(float), "no scales");
  Buffer squares(device_, ordered.squares.size() * sizeof(float), "squares");
  const cl_kernel kernel =
      device_.kernel(kernel_sources::nearest_code_vector, vector_option(device_), "half_squares");
  set_arguments(kernel, ulong(shape_.luminances), ulong(shape_.values()),
                std::uint32_t{scaled ? 1U : 0U}, ordered.rows, factors, squares);
  launch_items(device_, kernel, count);
  device_.read(squares, std::span<float>(ordered.squares));
  if (!is_pruned()) return ordered;
  std::vector<float> keys(count);
  for (std::size_t i = 0; i < count; ++i) {
    keys[i] = key(shape_, ordered.squares.data() + 2 * i, scaled ? scales[i] : 1);
  }
  std::sort(ordered.numbers.begin(), ordered.numbers.end(), [&](std::uint32_t a, std::uint32_t b) {
    return keys[a] != keys[b] ? keys[a] < keys[b] : a < b;
  });
  return ordered;
}

Buffer DeviceNearestSearch::pack(const Ordered& ordered, const Buffer& scales, bool scaled,
                                 std::size_t lanes) const {
  const std::size_t count = ordered.numbers.size();
  const std::size_t panels = ceil_div(count, lanes);
  const std::size_t values = shape_.values();
  const Buffer numbers = upload(device_, ordered.numbers, "order of vectors");
  Buffer packed(device_, panels * lanes * values * sizeof(float), "vectors");
  const cl_kernel kernel =
      device_.kernel(kernel_sources::nearest_code_vector, vector_option(device_), "pack_vectors");
  set_arguments(kernel, ulong(shape_.luminances), ulong(values), ulong(count), ulong(lanes),
                std::uint32_t{scaled ? 1U : 0U}, ordered.rows, scales, numbers, packed);
  launch_items(device_, kernel, ceil_div(values, run), panels);
  device_.finish();
  return packed;
}

void DeviceNearestSearch::set(const VectorShape& shape, std::span<const float> code_vectors) {
  shape_ = shape;
  parts_.clear();
  const std::size_t values = shape.values();
  const std::size_t count = code_vectors.size() / values;
  const std::size_t lanes = group_rows(device_);
  const std::size_t rows = rows_of_part(device_, shape);
  const std::size_t block = block_groups * lanes;
  for (std::size_t first = 0; first < count; first += rows) {
    const std::size_t here = std::min(rows, count - first);
    Part part;
    part.first = first;
    part.groups = ceil_div(here, lanes);
    const Ordered ordered = order(code_vectors.subspan(first * values, here * values), {});
    // padding is never the nearest
    std::vector<float> squares(part.groups * lanes * 2, 1e30F);
    std::vector<std::uint32_t> numbers(part.groups * lanes, 0);
    std::vector<float> ranges;
    for (std::size_t i = 0; i < here; ++i) {
      const std::uint32_t number = ordered.numbers[i];
      const float* const from = ordered.squares.data() + std::size_t{2} * number;
      numbers[i] = number;
      std::copy_n(from, 2, squares.data() + 2 * i);
      const std::array<float, 2> norms{std::sqrt(2 * from[0]), std::sqrt(2 * from[1])};
      if (i % block == 0) {
        ranges.insert(ranges.end(), {norms[0], norms[0], norms[1], norms[1]});
        part.keys.push_back(key(shape, from, 1));
      }
      float* const range = ranges.data() + ranges.size() - 4;
      for (std::size_t n = 0; n < 2; ++n) {
        range[2 * n] = std::min(range[2 * n], norms[n]);
        range[2 * n + 1] = std::max(range[2 * n + 1], norms[n]);
      }
    }
    part.squares = upload(device_, squares, "squares of code-vectors");
    part.numbers = upload(device_, numbers, "numbers of code-vectors");
    part.ranges = upload(device_, ranges, "norms of code-vectors");
    part.packed = pack(ordered, part.squares, false, lanes);
    parts_.push_back(std::move(part));
  }
}

std::vector<std::uint32_t> DeviceNearestSearch::nearest(const ScaledVectors& vectors,
                                                        double /*most*/) {
  const std::size_t values = shape_.values();
  const std::size_t count = vectors.scales.size();
  std::vector<std::uint32_t> result(count);
  const std::size_t lanes = panel_width(device_);
  const std::size_t most =
      std::max(part_bytes / (values * sizeof(float)) / lanes, std::size_t{1}) * lanes;
  const cl_kernel kernel = device_.kernel(kernel_sources::nearest_code_vector,
                                          vector_option(device_), "nearest_code_vector");
  for (std::size_t first = 0; first < count; first += most) {
    const std::size_t here = std::min(most, count - first);
    const std::size_t panels = ceil_div(here, lanes);
    const std::size_t padded = panels * lanes;
    const std::span<const float> given = vectors.scales.subspan(first, here);
    const Ordered ordered = order(vectors.rows.subspan(first * values, here * values), given);
    constexpr float infinity = std::numeric_limits<float>::infinity();
    // nothing is better than the best of padding
    std::vector<float> in_order(padded, 0.0F), norms(2 * padded, 0.0F), scores(padded, infinity);
    for (std::size_t i = 0; i < here; ++i) {
      const std::uint32_t number = ordered.numbers[i];
      in_order[i] = given[number];
      scores[i] = -infinity;
      for (std::size_t n = 0; n < 2; ++n) {
        norms[(i / lanes * 2 + n) * lanes + i % lanes] =
            std::sqrt(2 * ordered.squares[std::size_t{2} * number + n]);
      }
    }
    const Buffer scales = upload(device_, in_order, "scales of vectors");
    const Buffer packed = pack(ordered, scales, true, lanes);
    const Buffer lengths = upload(device_, norms, "norms of vectors");
    const Buffer best = upload(device_, scores, "scores");
    const Buffer index =
        upload(device_, std::vector<std::uint32_t>(padded, 0), "nearest code-vectors");
    for (const Part& part : parts_) {
      std::vector<std::uint32_t> start(panels, 0);
      for (std::size_t panel = 0; panel < panels && is_pruned(); ++panel) {
        const std::uint32_t middle = ordered.numbers[std::min(panel * lanes + lanes / 2, here - 1)];
        const float wanted =
            key(shape_, ordered.squares.data() + std::size_t{2} * middle, given[middle]);
        const auto above = std::upper_bound(part.keys.begin(), part.keys.end(), wanted);
        start[panel] =
            static_cast<std::uint32_t>(std::max<std::ptrdiff_t>(above - part.keys.begin(), 1) - 1);
      }
      const Buffer from = upload(device_, start, "blocks to begin with");
      set_arguments(kernel, ulong(values), ulong(part.groups),
                    static_cast<std::uint32_t>(part.first), std::uint32_t{is_pruned() ? 1U : 0U},
                    packed, scales, lengths, from, part.packed, part.squares, part.numbers,
                    part.ranges, best, index);
      launch_items(device_, kernel, panels);
      device_.finish();
    }
    std::vector<std::uint32_t> found(padded);
    device_.read(index, std::span<std::uint32_t>(found));
    for (std::size_t i = 0; i < here; ++i) result[first + ordered.numbers[i]] = found[i];
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
  return rows * (row + 4 * sizeof(float)) +
         std::max(std::min(rows * row, std::max(part_bytes, group_rows(device) * row)),
                  2 * at_a_time * (row + 6 * sizeof(float)));
}

}  // namespace weft::ops
