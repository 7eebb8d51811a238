// Sums and multiples of vectors; their products are in reflectance.hpp.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "weft/scene/reflectance.hpp"

namespace weft {

inline Vector3 sum(const Vector3& a, const Vector3& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}

inline Vector3 difference(const Vector3& a, const Vector3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

inline Vector3 scaled(const Vector3& a, double factor) {
  return {a[0] * factor, a[1] * factor, a[2] * factor};
}

inline double length(const Vector3& a) {
  return std::hypot(a[0], a[1], a[2]);
}

// A vector as kernels take it.
inline std::array<float, 3> to_float(const Vector3& a) {
  return {static_cast<float>(a[0]), static_cast<float>(a[1]), static_cast<float>(a[2])};
}

}  // namespace weft
