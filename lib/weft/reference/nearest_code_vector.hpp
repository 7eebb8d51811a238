// The nearest code-vector of each of many vectors (Havran et al. 2010, section 4.2). A vector is a
// slice of a BTF: luminances l, compared without their scale s, and chromaticities a, compared as
// they are. What is near is a matter of the search's measure; that of the searches here is
//
//   D(x, j) = |l_x - s_x L_j|^2 + |a_x - A_j|^2          index[x] = the first j with the least D
//
// similar_code_vector.hpp has the other.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace weft {

// Rows of luminances, then chromaticities.
struct VectorShape {
  std::size_t luminances = 0;
  std::size_t chromaticities = 0;

  std::size_t values() const { return luminances + chromaticities; }
  bool operator==(const VectorShape&) const = default;
};

// Slices with their scales: rows [scales.size()][values].
struct ScaledVectors {
  std::span<const float> rows;
  std::span<const float> scales;
  // Rows of what is about each value in its image, for measures that look at that: mean and
  // standard deviation. Empty for others.
  std::span<const float> means = {};
  std::span<const float> deviations = {};

  // Vector i alone.
  ScaledVectors vector(const VectorShape& shape, std::size_t i) const {
    const auto row = [&](std::span<const float> plane) {
      return plane.empty() ? plane : plane.subspan(i * shape.values(), shape.values());
    };
    return {row(rows), scales.subspan(i, 1), row(means), row(deviations)};
  }
};

inline constexpr double any_distance = std::numeric_limits<double>::infinity();

// A search that keeps its code-vectors.
class NearestSearch {
 public:
  virtual ~NearestSearch() = default;
  // Code-vectors [count][values], count at least 1, in place of those before.
  virtual void set(const VectorShape& shape, std::span<const float> code_vectors) = 0;
  // One index for each vector; any where no code-vector is within `most`.
  virtual std::vector<std::uint32_t> nearest(const ScaledVectors& vectors,
                                             double most = any_distance) = 0;

  // The distance between one vector and a code-vector; anything more than `most` where it is.
  virtual double distance(const VectorShape& shape, const ScaledVectors& vector,
                          const float* code_vector, double most) const;
  // The distance that a threshold stands for.
  virtual double distance_of(double threshold, const VectorShape& shape) const;
};

namespace reference {

// D of one vector and one code-vector; stops where it exceeds `most`.
double code_vector_distance(const VectorShape& shape, const float* vector, float scale,
                            const float* code_vector, double most);

std::vector<std::uint32_t> nearest_code_vectors(const VectorShape& shape,
                                                const ScaledVectors& vectors,
                                                std::span<const float> code_vectors);

class PlainSearch final : public NearestSearch {
 public:
  void set(const VectorShape& shape, std::span<const float> code_vectors) override;
  std::vector<std::uint32_t> nearest(const ScaledVectors& vectors, double most) override;

 private:
  VectorShape shape_;
  std::vector<float> code_vectors_;
};

}  // namespace reference
}  // namespace weft
