// What the ways of streamed_svd.hpp do with a basis: products with it, Rayleigh-Ritz, residuals.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/codecs/panel_stream.hpp"
#include "weft/codecs/streamed_svd.hpp"
#include "weft/job.hpp"

namespace weft {

// All of what an m x m problem tells about X.
struct Spectrum {
  std::vector<double> values;   // m, descending
  std::vector<double> vectors;  // m x m, row-major; column j belongs to values[j]
  double squares = 0;           // |X|^2
};

// Projects X on as many leading directions of `spectrum` as the target seems to need and `margin`
// more, measures what is left, and keeps the fewest that do; takes more directions, in another
// pass, where those do not.
StreamedSvd project(Device& device, PanelStream& stream, const SvdTarget& target,
                    const Spectrum& spectrum, std::size_t margin, Job& job);

// D and upper triangular R, unit columns, with X^T X = D R^T R D: by Cholesky's method on the
// columns scaled to unit length, which keeps the small ones. Dependent columns give zero rows.
struct ScaledCholesky {
  std::vector<double> lengths;  // D
  std::vector<double> R;        // k x k, row-major
};
ScaledCholesky scaled_cholesky(std::size_t k, const std::vector<double>& gram);

// The leading dimension of row-major results of k columns: as little padding as vectors like.
// Buffers of them end with room for a whole panel, since inner products read past the last column.
constexpr std::size_t leading_of(std::size_t k) {
  return (k + 3) / 4 * 4;
}
std::size_t row_major_bytes(const Device& device, std::size_t rows, std::size_t k,
                            Arithmetic arithmetic);

// C (rows x columns, row-major at leading_of(columns)) = A S of a row-major or panelled A with k
// columns and a small row-major S (k x columns).
struct ProductOf {
  const Buffer* buffer = nullptr;
  bool panelled = false;
  std::size_t leading = 0;
};
Buffer times_small(Device& device, std::size_t rows, std::size_t k, const ProductOf& A,
                   std::span<const double> S, std::size_t columns, Arithmetic arithmetic,
                   const char* what);

// |X - XV V^T|, measured in one pass. V: [m][leading], XV: [K][leading], k columns of each.
double measured_residual(Device& device, PanelStream& stream, const Buffer& V, const Buffer& XV,
                         std::size_t k, std::size_t leading, Job& job);

}  // namespace weft
