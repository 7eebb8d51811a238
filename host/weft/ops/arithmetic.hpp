// The arithmetic that an operation on real matrices computes in.
#pragma once

#include <cstddef>

namespace weft {

// f32 everywhere; f64 on devices that have it.
enum class Arithmetic { f32, f64 };

constexpr std::size_t size_of(Arithmetic arithmetic) {
  return arithmetic == Arithmetic::f32 ? 4 : 8;
}

}  // namespace weft
