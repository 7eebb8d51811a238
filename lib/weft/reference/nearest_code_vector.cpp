#include "weft/reference/nearest_code_vector.hpp"

#include <algorithm>
#include <limits>

namespace weft {

double NearestSearch::distance(const VectorShape& shape, const ScaledVectors& vector,
                               const float* code_vector, double most) const {
  return reference::code_vector_distance(shape, vector.rows.data(), vector.scales[0], code_vector,
                                         most);
}

// a root mean square
double NearestSearch::distance_of(double threshold, const VectorShape& shape) const {
  return threshold * threshold * static_cast<double>(shape.values());
}

namespace reference {
namespace {

// Values whose squares are summed before the sum is looked at.
constexpr std::size_t run = 64;

// Adds |x - scale c|^2 over n values, until the sum exceeds `most`.
double add_squares(double sum, const float* x, double scale, const float* c, std::size_t n,
                   double most) {
  for (std::size_t first = 0; first < n && sum <= most; first += run) {
    const std::size_t end = std::min(first + run, n);
    double part = 0;
    for (std::size_t i = first; i < end; ++i) {
      const double difference = double{x[i]} - scale * double{c[i]};
      part += difference * difference;
    }
    sum += part;
  }
  return sum;
}

}  // namespace

double code_vector_distance(const VectorShape& shape, const float* vector, float scale,
                            const float* code_vector, double most) {
  const double luminances =
      add_squares(0, vector, double{scale}, code_vector, shape.luminances, most);
  return add_squares(luminances, vector + shape.luminances, 1, code_vector + shape.luminances,
                     shape.chromaticities, most);
}

std::vector<std::uint32_t> nearest_code_vectors(const VectorShape& shape,
                                                const ScaledVectors& vectors,
                                                std::span<const float> code_vectors) {
  const std::size_t width = shape.values();
  const std::size_t count = code_vectors.size() / width;
  std::vector<std::uint32_t> nearest(vectors.scales.size(), 0);
  for (std::size_t i = 0; i < nearest.size(); ++i) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < count; ++j) {
      const double distance =
          code_vector_distance(shape, vectors.rows.data() + i * width, vectors.scales[i],
                               code_vectors.data() + j * width, least);
      if (distance >= least) continue;
      least = distance;
      nearest[i] = static_cast<std::uint32_t>(j);
    }
  }
  return nearest;
}

void PlainSearch::set(const VectorShape& shape, std::span<const float> code_vectors) {
  shape_ = shape;
  code_vectors_.assign(code_vectors.begin(), code_vectors.end());
}

std::vector<std::uint32_t> PlainSearch::nearest(const ScaledVectors& vectors, double /*most*/) {
  return nearest_code_vectors(shape_, vectors, code_vectors_);
}

}  // namespace reference
}  // namespace weft
