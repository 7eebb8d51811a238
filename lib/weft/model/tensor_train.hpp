// A tensor train as its encoders make it, before it is stored.
//
//   T[i1, .., i5] = G1[i1, :] G2[:, i2, :] G3[:, i3, :] G4[:, i4, :] G5[:, i5]
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <vector>

#include "weft/btf/modes.hpp"
#include "weft/model/tt.hpp"

namespace weft {

inline constexpr std::size_t bond_count = mode_count - 1;

struct TensorTrain {
  std::array<std::size_t, mode_count> sizes{};
  std::array<std::size_t, mode_count + 1> ranks{1, 1, 1, 1, 1, 1};
  std::array<std::vector<double>, mode_count> cores;  // row-major [R_{n-1}, I_n, R_n]

  // Of a train whose cores were cut off one by one, from either end: those before the center have
  // orthonormal columns [R_{n-1} I_n, R_n], those after it orthonormal rows, and `values` of a bond
  // are the singular values of what its cut divided.
  std::size_t center = 0;
  std::array<std::vector<double>, bond_count> values;

  std::size_t coefficients() const;
};

// A train with what the truncations that made it left out.
struct TrainFit {
  TensorTrain train;
  double squares = 0;  // |T|^2
  double lost = 0;     // |T - T'|^2 / |T|^2
};

// A model of the train in the order of modes that it was made in. As `f32`, all cores are; as
// `f16`, the cores are rounded to half but for as many as it takes to keep the rounding's
// |T' - T''|^2 within `allowed_squares`: those of the most error per number first.
std::unique_ptr<TtModel> store_train(const TensorTrain& train, const ModeOrder& order,
                                     const BtfInfo& info, Storage storage, double allowed_squares);

}  // namespace weft
