// The nearest code-vector of each of many vectors (Havran et al. 2010, section 4.2). A vector is a
// slice of a BTF: luminances l, compared without their scale s, and chromaticities a, compared as
// they are:
//
//   D(x, j) = |l_x - s_x L_j|^2 + |a_x - A_j|^2          index[x] = the first j with the least D
#pragma once

#include <cstddef>
#include <cstdint>
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
};

// A search that keeps its code-vectors.
class NearestSearch {
 public:
  virtual ~NearestSearch() = default;
  // Code-vectors [count][values], count at least 1, in place of those before.
  virtual void set(const VectorShape& shape, std::span<const float> code_vectors) = 0;
  // One index for each vector.
  virtual std::vector<std::uint32_t> nearest(const ScaledVectors& vectors) = 0;
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
  std::vector<std::uint32_t> nearest(const ScaledVectors& vectors) override;

 private:
  VectorShape shape_;
  std::vector<float> code_vectors_;
};

}  // namespace reference
}  // namespace weft
