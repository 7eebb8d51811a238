// Local subspaces of the columns of a matrix A (n rows by P texels) that streams by, rows after
// rows: per cluster g of texels a mean and k basis vectors, on the device.
//
//   fit:     W_g = (A_g - mu_g)^T U_g        U_g: [P_g, k], orthonormal, columns sum to zero
//            W_g^T W_g = X diag(lambda) X^T  A_g ~ mu_g + W_g U_g^T, of squared error
//                                            |A_g - mu_g|^2 - sum lambda
//   assign:  B_g = W_g X diag(lambda)^(-1/2) an orthonormal basis on the side of the rows
//            p to the g of the least |a_p - mu_g|^2 - |B_g^T (a_p - mu_g)|^2
//
// The coefficients B_g^T (a_p - mu_g) of the chosen clusters, orthonormalised (texel_basis.hpp),
// are the next U. A fit to them has no larger error: mu and W are the best for U, and U spans what
// the assignment's reconstruction used; and each round is a step of subspace iteration besides.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/ops/cluster_products.hpp"

namespace weft {

// Calls use(tile, first row, rows) for all rows in order: tile is [ceil(P / NR)][rows][NR], in
// texel order, zero past the last texel.
using RowUser = std::function<void(const Buffer& tile, std::size_t first, std::size_t rows)>;
using RowStream = std::function<void(const RowUser& use)>;

class LocalSubspaces {
 public:
  struct Sizes {
    std::size_t texels = 0;
    std::size_t n = 0;          // rows of the matrix
    std::size_t tile_rows = 0;  // most rows of a tile
    std::size_t clusters = 0;
    std::size_t rank = 0;
  };

  LocalSubspaces(Device& device, const Sizes& sizes);

  // Device and host memory. Throws an input error where a piece is more than the device gives at
  // once.
  static MemoryPlan plan(const Device& device, const Sizes& sizes);

  // Fits means and bases to labels [P] and U [P][k]; returns the squared error, 0 where that is a
  // difference of squares that float does not resolve (a relative error of 2^-10).
  double fit(const RowStream& rows, std::span<const std::uint32_t> labels,
             std::span<const float> U);

  struct Assignment {
    std::vector<std::uint32_t> labels;  // [P]
    std::vector<float> errors;          // [P], squared
    std::vector<float> coefficients;    // [P][k]
  };
  // Assigns every texel to its nearest subspace of the last fit. A texel stays where it is unless
  // another is nearer by more than rounding. Nothing goes to a cluster that was empty.
  Assignment assign(const RowStream& rows, std::span<const std::uint32_t> labels);

  // Of the last fit: each cluster's X, so that U X and W X are its singular vectors.
  struct Rotation {
    std::size_t rank = 0;   // components that the cluster holds
    std::vector<double> X;  // [k][rank]
  };
  const std::vector<Rotation>& rotations() const { return rotations_; }
  // [n][clusters][k + 1]: W X, in descending order of length, and the mean.
  std::vector<float> right_side();

 private:
  // B = per cluster W T with T [k][rank] in double, and the mean behind it.
  void transform(const std::vector<std::vector<double>>& T);

  Device& device_;
  Sizes sizes_;
  ops::ClusterTables tables_;
  std::size_t panels_ = 0;
  Buffer sorted_;       // tile sorted by cluster
  Buffer U_;            // [panels][k][NR]
  Buffer W_;            // [clusters][n padded][k + 1 padded]
  Buffer row_squares_;  // [n][clusters]
  Buffer B_;            // [n][clusters (k + 1)]
  Buffer scores_;       // [clusters (k + 1)][P padded]
  Buffer texel_squares_;
  ops::ClusterMatrix matrix_;
  bool has_texel_squares_ = false;
  std::vector<std::vector<double>> grams_;  // of [W mu], (k + 1) x (k + 1)
  std::vector<std::size_t> counts_;         // texels of each cluster
  std::vector<Rotation> rotations_;
  std::vector<std::vector<double>> lambdas_;
};

}  // namespace weft
