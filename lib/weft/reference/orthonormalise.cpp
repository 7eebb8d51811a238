#include "weft/reference/orthonormalise.hpp"

#include <cmath>
#include <utility>

#include "weft/reference/factorise.hpp"
#include "weft/reference/gemm.hpp"
#include "weft/reference/gram.hpp"

namespace weft::reference {

ColumnSpace orthonormalise(std::size_t n, std::size_t count, std::span<const double> Y) {
  std::vector<double> unit(Y.begin(), Y.end());
  for (std::size_t j = 0; j < count; ++j) {
    double square = 0;
    for (std::size_t p = 0; p < n; ++p) square += unit[p * count + j] * unit[p * count + j];
    const double scale = square > 0 ? 1.0 / std::sqrt(square) : 0.0;
    for (std::size_t p = 0; p < n; ++p) unit[p * count + j] *= scale;
  }
  ThinSvd svd = thin_svd(n, count, unit);
  return {std::move(svd.values), std::move(svd.U)};
}

void project_out(std::size_t n, std::span<const double> Q, std::size_t q_count, std::span<double> Y,
                 std::size_t count) {
  const std::vector<double> coefficients = gram(n, q_count, Q, count, Y);
  gemm(n, count, q_count, -1.0, Q, coefficients, 1.0, Y);
}

}  // namespace weft::reference
