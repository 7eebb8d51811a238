// The clustering stage of clustered tensor approximation in double (Tsai & Shih 2012, section 4.2;
// equation numbers are theirs), for a tensor with the clustered mode first: which clusters each
// slice is a mixture of, and by which coefficients.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/btf/view_grid.hpp"
#include "weft/model/kcta.hpp"

namespace weft {

// Eigenvalues of Gram matrices of mixing coefficients up to this part of the largest are taken for
// 0: cores may be rank-deficient, and clusters nearly the same.
inline constexpr double mixing_cutoff = 1e-6;

namespace reference {

// A cluster's core [R_m][R_n ...] and its bases U_n [I_n][R_n] of the modes n behind the first;
// empty for an identity.
struct KctaCluster {
  std::vector<std::size_t> sizes;  // of the core
  std::vector<double> Z;
  std::vector<std::vector<double>> U;  // of mode n at n - 1

  // Z x_n U_n over the modes behind the first: [R_m][I_n ...].
  std::vector<double> rows() const;
};

// The clusters of each slice, ascending, and their coefficients, [slices][K][R_m]; and what each
// slice is then short of, squared.
struct KctaMixing {
  std::vector<std::uint32_t> members;
  std::vector<double> coefficients;
  std::vector<double> errors;
};

// The clustering stage of a tensor A of these sizes.
KctaMixing mix_slices(std::span<const std::size_t> sizes, std::span<const double> A,
                      std::span<const KctaCluster> clusters, std::size_t mixtures);

// The coefficients (15) of one slice for given clusters, from the Gram matrix (17) and products
// (18).
std::vector<double> solve_mixing(std::size_t n, std::span<const double> gram,
                                 std::span<const double> products);

// Views of a grid, each what is interpolated of the slices (section 6.3.2).
KctaMixing mix_between(const ViewResampling& views, std::span<const std::size_t> sizes,
                       std::span<const double> A, std::span<const KctaCluster> clusters,
                       std::size_t mixtures);

// A tensor projected onto a cluster's bases but for one mode, or for none behind the first (10);
// `sizes` become those of what is left.
std::vector<double> projected(std::vector<std::size_t>& sizes, std::span<const double> T,
                              std::span<const std::vector<double>> U, std::size_t but = 0);

// A B^T of row-major matrices [a][length] and [b][length], and A B of [a][n] and [n][b].
std::vector<double> row_products(std::size_t length, std::span<const double> A,
                                 std::span<const double> B);
std::vector<double> matrix_product(std::size_t n, std::span<const double> A,
                                   std::span<const double> B);

}  // namespace reference

// Puts the mixing coefficients [slices][given][R_m] of `given` clusters for each slice into a model
// of `mixtures`, at least as many: the others are the first that a slice has not, with coefficients
// 0.
void set_mixing(KctaModel& model, std::size_t mixtures, std::size_t given,
                std::span<const std::uint32_t> members, std::span<const float> coefficients);

// Puts a grid of N x N views into a model.
void set_grid(KctaModel& model, std::size_t side, const reference::KctaMixing& mixing);

}  // namespace weft
