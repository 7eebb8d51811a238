#include "weft/ops/similar_code_vector.hpp"

#include <algorithm>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

// Bytes of code-vectors in one buffer, and of one plane of the vectors that are compared together.
constexpr std::size_t part_bytes = std::size_t{64} << 20;

constexpr std::uint32_t none = 0xffffffff;

// Rows whose luminances and chromaticities fill whole vectors of `lanes`.
std::size_t padded_row(const VectorShape& shape, std::size_t lanes) {
  return round_up(shape.luminances, lanes) + round_up(shape.chromaticities, lanes);
}

std::vector<float> padded(const VectorShape& shape, std::size_t lanes,
                          std::span<const float> rows) {
  const std::size_t count = rows.size() / shape.values();
  const std::size_t row = padded_row(shape, lanes);
  std::vector<float> out(count * row, 0.0f);
  for (std::size_t i = 0; i < count; ++i) {
    const float* const from = rows.data() + i * shape.values();
    float* const to = out.data() + i * row;
    std::copy_n(from, shape.luminances, to);
    std::copy_n(from + shape.luminances, shape.chromaticities,
                to + round_up(shape.luminances, lanes));
  }
  return out;
}

// Panels [values][lanes] of as many rows, the last one padded with zeros.
std::vector<float> interleaved(const VectorShape& shape, std::size_t lanes,
                               std::span<const float> rows) {
  const std::size_t values = shape.values();
  const std::size_t count = rows.size() / values;
  std::vector<float> out(round_up(count, lanes) * values, 0.0f);
  for (std::size_t i = 0; i < count; ++i) {
    float* const to = out.data() + i / lanes * lanes * values + i % lanes;
    for (std::size_t k = 0; k < values; ++k) to[k * lanes] = rows[i * values + k];
  }
  return out;
}

Buffer upload(Device& device, std::span<const float> values, const char* what) {
  Buffer buffer(device, values.size_bytes(), what);
  device.write(buffer, values);
  return buffer;
}

}  // namespace

bool DeviceSimilarSearch::is_short() const {
  return similarity_outliers(shape_.values()) == 0;
}

std::size_t DeviceSimilarSearch::row_floats() const {
  return is_short() ? shape_.values() : padded_row(shape_, vector_width(device_));
}

void DeviceSimilarSearch::set(const VectorShape& shape, std::span<const float> code_vectors) {
  shape_ = shape;
  parts_.clear();
  const std::size_t values = shape.values();
  const std::size_t count = code_vectors.size() / values;
  const std::size_t most = std::max<std::size_t>(part_bytes / (row_floats() * sizeof(float)), 1);
  for (std::size_t first = 0; first < count; first += most) {
    const std::size_t here = std::min(most, count - first);
    const std::span<const float> rows = code_vectors.subspan(first * values, here * values);
    parts_.push_back(
        {first, here,
         is_short() ? upload(device_, rows, "code-vectors")
                    : upload(device_, padded(shape, vector_width(device_), rows), "code-vectors")});
  }
}

std::vector<std::uint32_t> DeviceSimilarSearch::nearest(const ScaledVectors& vectors, double most) {
  const std::size_t values = shape_.values();
  const std::size_t lanes = vector_width(device_);
  const std::size_t count = vectors.scales.size();
  const std::size_t together =
      std::max<std::size_t>(part_bytes / (row_floats() * sizeof(float)) / lanes, 1) * lanes;
  const SimilarityConstants constants = similarity_constants();
  const auto c1 = static_cast<float>(constants.c1);
  const auto centre = static_cast<float>(constants.centre);
  const cl_kernel kernel =
      device_.kernel(kernel_sources::similar_code_vector, vector_option(device_),
                     is_short() ? "similar_short_vector" : "similar_code_vector");
  std::vector<std::uint32_t> result;
  result.reserve(count);
  for (std::size_t first = 0; first < count; first += together) {
    const std::size_t here = std::min(together, count - first);
    const std::size_t whole = round_up(here, lanes);
    // a plane of `rows`, each value as the kernel takes it
    const auto plane = [&](std::span<const float> rows, const char* what, const auto& taken) {
      const std::span<const float> part = rows.subspan(first * values, here * values);
      std::vector<float> laid =
          is_short() ? interleaved(shape_, lanes, part) : padded(shape_, lanes, part);
      for (float& value : laid) value = taken(value);
      return upload(device_, laid, what);
    };
    std::vector<float> scales(whole, 0.0f);
    std::copy_n(vectors.scales.begin() + static_cast<std::ptrdiff_t>(first), here, scales.begin());
    const Buffer x = plane(vectors.rows, "vectors", [](float x) { return x; });
    const Buffer means = plane(vectors.means, "means about their values", [&](float mean) {
      return static_cast<float>(2 * constants.centre * double{mean});
    });
    const Buffer deviations =
        plane(vectors.deviations, "deviations about their values", [&](float deviation) {
          return static_cast<float>(2 * double{deviation} * double{deviation} + constants.c2);
        });
    const Buffer scale = upload(device_, scales, "scales of vectors");
    const Buffer best =
        upload(device_, std::vector<float>(whole, static_cast<float>(most)), "dissimilarities");
    Buffer index(device_, whole * sizeof(std::uint32_t), "most similar code-vectors");
    device_.write(index, std::span<const std::uint32_t>(std::vector<std::uint32_t>(whole, none)));
    if (is_short()) {
      for (const Part& part : parts_) {
        set_arguments(kernel, static_cast<std::uint32_t>(shape_.luminances),
                      static_cast<std::uint32_t>(values), static_cast<std::uint32_t>(part.count),
                      static_cast<std::uint32_t>(part.first), c1, centre, x, means, deviations,
                      scale, part.rows, best, index);
        launch_items(device_, kernel, whole / lanes);
      }
    } else {
      const Buffer room(device_, here * row_floats() * sizeof(float), "their dissimilarities");
      for (const Part& part : parts_) {
        set_arguments(
            kernel, ulong(round_up(shape_.luminances, lanes) / lanes), ulong(row_floats() / lanes),
            static_cast<std::uint32_t>(similarity_outliers(values)),
            static_cast<std::uint32_t>(part.count), static_cast<std::uint32_t>(part.first), c1,
            centre, x, means, deviations, scale, part.rows, room, best, index);
        launch_items(device_, kernel, here);
      }
      device_.finish();
    }
    std::vector<std::uint32_t> found(whole);
    device_.read(index, std::span<std::uint32_t>(found));
    for (std::size_t i = 0; i < here; ++i) result.push_back(found[i] == none ? 0 : found[i]);
  }
  return result;
}

std::size_t DeviceSimilarSearch::bytes(const Device& device, const VectorShape& shape,
                                       std::size_t code_vectors, std::size_t vectors) {
  const std::size_t lanes = vector_width(device);
  const std::size_t row = padded_row(shape, lanes) * sizeof(float);
  const std::size_t together =
      std::min(round_up(vectors, lanes), std::max(part_bytes / row / lanes * lanes, lanes));
  // vectors, what is about them, their dissimilarities, and a plane or code-vectors on their way
  return code_vectors * row + together * 4 * row + std::max(part_bytes, lanes * row);
}

}  // namespace weft::ops
