#include "weft/ops/orthonormalise.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "weft/error.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/gram.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/reals.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/gemm.hpp"

namespace weft::ops {
namespace {

// Y^T Y of packed Y.
std::vector<double> squared(Device& device, std::size_t n, std::size_t count, const Buffer& Y,
                            Arithmetic arithmetic) {
  const Columns columns = packed_columns(device, Y, n, count, arithmetic);
  std::vector<double> G = gram(device, n, columns, columns);
  for (std::size_t j = 0; j < count; ++j) {
    if (!std::isfinite(G[j * count + j])) {
      fail_runtime("column {} of a basis holds NaN or an infinity", j);
    }
  }
  return G;
}

// Whether the factors that bring columns to unit length might leave the range of float.
bool has_extreme_columns(std::size_t count, const std::vector<double>& G) {
  for (std::size_t j = 0; j < count; ++j) {
    const double square = G[j * count + j];
    if (square > 0 && (square < 0x1p-80 || square > 0x1p80)) return true;
  }
  return false;
}

// The diagonal matrix of the powers of two that bring the columns as near to unit length as float
// allows. It changes no digit.
std::vector<double> to_unit_magnitude(std::size_t count, const std::vector<double>& G) {
  std::vector<double> T(count * count, 0.0);
  for (std::size_t j = 0; j < count; ++j) {
    const double square = G[j * count + j];
    const int exponent = square > 0 ? -std::ilogb(std::sqrt(square)) : 0;
    T[j * count + j] = std::ldexp(1.0, std::clamp(exponent, -126, 127));
  }
  return T;
}

// D V diag(lambda)^(-1/2), row-major count x count, and how many of its columns are not zero.
struct Whitening {
  std::vector<double> T;
  std::size_t rank = 0;
};

// With `rotate`, columns come out along the principal axes; without, each stays as near to where it
// was as it can (T V^T: a symmetric square root), unless some depend on others.
Whitening whitening(std::size_t count, std::vector<double> G, bool rotate, Arithmetic arithmetic,
                    double least) {
  // unit columns
  std::vector<double> scale(count, 0.0);
  std::size_t columns = 0;
  for (std::size_t j = 0; j < count; ++j) {
    const double square = G[j * count + j];
    if (square > 0) {
      scale[j] = least > 0 ? 1.0 : 1.0 / std::sqrt(square);
      ++columns;
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t j = 0; j < count; ++j) G[i * count + j] *= scale[i] * scale[j];
  }
  // principal axes
  const reference::SymmetricEigen eigen = reference::symmetric_eigen(count, G);
  const std::vector<double>& V = eigen.vectors;
  const double size = static_cast<double>(count);
  const double ratio = arithmetic == Arithmetic::f32 ? size * size * 0x1p-46 : size * 0x1p-48;
  const double floor = least > 0 ? least * least : eigen.values[0] * ratio;
  Whitening result;
  while (result.rank < count && eigen.values[result.rank] > floor) ++result.rank;
  // scaled to unit length, and turned back by V^T to stay
  std::vector<double> axes(count * count, 0.0);
  for (std::size_t j = 0; j < count; ++j) {
    for (std::size_t r = 0; r < result.rank; ++r) {
      axes[j * count + r] = V[j * count + r] / std::sqrt(eigen.values[r]);
    }
  }
  if (!rotate && result.rank == columns) {
    std::vector<double> transposed(count * count);
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t r = 0; r < count; ++r) transposed[r * count + i] = V[i * count + r];
    }
    const std::vector<double> whole = axes;
    reference::gemm(count, count, count, 1.0, whole, transposed, 0.0, axes);
    // zero columns stay exactly so
    for (std::size_t j = 0; j < count; ++j) {
      for (std::size_t i = 0; i < count; ++i) axes[j * count + i] *= scale[i] > 0 ? 1.0 : 0.0;
    }
  }
  for (std::size_t j = 0; j < count; ++j) {
    for (std::size_t i = 0; i < count; ++i) {
      result.T.push_back(scale[j] * axes[j * count + i]);
    }
  }
  return result;
}

// Y <- Y T for packed Y.
void transform(Device& device, std::size_t n, std::size_t count, const std::vector<double>& T,
               Buffer& Y, Buffer& scratch, Arithmetic arithmetic) {
  const Buffer small = real_buffer(device, T, arithmetic, "basis change");
  const std::size_t padded = round_up(count, panel_width(device, arithmetic));
  Buffer packed(device, packed_elements(device, count, padded, arithmetic) * size_of(arithmetic),
                "basis change");
  pack_panels(device, row_major(device, small, count, 0, arithmetic), count, count, packed);
  gemm_packed(device, n, padded, count, 1.0, panelled(device, Y, n, arithmetic), packed, 0.0,
              to_panels(device, scratch, n, arithmetic));
  std::swap(Y, scratch);
}

}  // namespace

std::size_t orthonormalise(Device& device, std::size_t n, std::size_t count, Buffer& Y,
                           Buffer& scratch, Arithmetic arithmetic, double least) {
  std::size_t rank = count;
  for (int round = 0; round < 2; ++round) {
    std::vector<double> G = squared(device, n, count, Y, arithmetic);
    if (least == 0 && has_extreme_columns(count, G)) {
      transform(device, n, count, to_unit_magnitude(count, G), Y, scratch, arithmetic);
      G = squared(device, n, count, Y, arithmetic);
    }
    // the second round only mends what rounding left of the first
    const Whitening white =
        whitening(count, std::move(G), round == 0, arithmetic, round == 0 ? least : 0);
    transform(device, n, count, white.T, Y, scratch, arithmetic);
    rank = white.rank;
  }
  return rank;
}

void project_out(Device& device, std::size_t n, const Buffer& Q, std::size_t q_count, Buffer& Y,
                 std::size_t count, Arithmetic arithmetic) {
  const std::vector<double> C = gram(device, n, packed_columns(device, Q, n, q_count, arithmetic),
                                     packed_columns(device, Y, n, count, arithmetic));
  const Buffer small = real_buffer(device, C, arithmetic, "projection");
  const std::size_t padded = round_up(count, panel_width(device, arithmetic));
  Buffer packed(device, packed_elements(device, q_count, padded, arithmetic) * size_of(arithmetic),
                "projection");
  pack_panels(device, row_major(device, small, count, 0, arithmetic), q_count, count, packed);
  gemm_packed(device, n, padded, q_count, -1.0, panelled(device, Q, n, arithmetic), packed, 1.0,
              to_panels(device, Y, n, arithmetic));
}

}  // namespace weft::ops
