#include "weft/reference/tsqr.hpp"

#include <Eigen/QR>
#include <algorithm>

namespace weft::reference {

std::vector<double> triangular_factor(std::size_t K, std::size_t m, std::span<const double> X) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto rows = static_cast<Eigen::Index>(K);
  const auto columns = static_cast<Eigen::Index>(m);
  std::vector<double> R(m * m, 0.0);
  if (K == 0 || m == 0) return R;
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(
      Eigen::Map<const RowMajor>(X.data(), rows, columns));
  const Eigen::Index kept = std::min(rows, columns);
  Eigen::Map<RowMajor>(R.data(), columns, columns).topRows(kept) =
      qr.matrixQR().topRows(kept).triangularView<Eigen::Upper>();
  return R;
}

std::vector<double> tsqr(std::size_t K, std::size_t m, std::span<const double> X,
                         std::size_t block_rows) {
  std::vector<double> R(m * m, 0.0);
  for (std::size_t first = 0; first < K; first += block_rows) {
    const std::size_t rows = std::min(block_rows, K - first);
    std::vector<double> stacked = R;
    const std::span<const double> block = X.subspan(first * m, rows * m);
    stacked.insert(stacked.end(), block.begin(), block.end());
    R = triangular_factor(m + rows, m, stacked);
  }
  return R;
}

}  // namespace weft::reference
