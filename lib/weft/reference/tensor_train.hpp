// Tensor trains in double by Eigen: TT-SVD and TT-rounding (Oseledets 2011, algorithms 1 and 2),
// the truth that host/weft/codecs/fit_tt.hpp is checked against.
//
//   T[i1, .., i5] = G1[i1, :] G2[:, i2, :] G3[:, i3, :] G4[:, i4, :] G5[:, i5]
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "weft/model/tensor_train.hpp"

namespace weft::reference {

// R_1 .. R_4 at most; 0: as many as the tolerance asks for.
using BondRanks = std::array<std::size_t, bond_count>;

// What is wanted: |T - T'| <= tolerance |T| (0: none), within the given ranks.
struct TrainRequest {
  double tolerance = 0;
  BondRanks ranks{};
};

// A train as it is stored, to be rounded further.
TensorTrain to_train(const TtModel& model);

// TT-SVD of a row-major tensor. What one truncation leaves of its part of the error goes to those
// after it. Directions below 1e-14 of the longest are dropped; every rank is at least 1.
TrainFit tt_svd(const std::array<std::size_t, mode_count>& sizes, std::span<const double> tensor,
                const TrainRequest& request);

// A train of lower ranks: QR from the right, then truncated SVDs from the left.
TrainFit tt_round(TensorTrain train, const TrainRequest& request);

// The tensor that a train stands for.
std::vector<double> tt_full(const TensorTrain& train);

// Inner product of two trains' tensors of the same sizes, and |T|.
double tt_inner(const TensorTrain& one, const TensorTrain& other);
double tt_norm(const TensorTrain& train);

}  // namespace weft::reference
