#include "numerics/reference_svd.hpp"

#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

namespace weft::numerics {
namespace {
using Long = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
}

ReferenceSvd reference_svd(const Matrix& matrix, std::size_t period) {
  const std::size_t rows = period > 0 ? period : matrix.rows;
  const std::size_t columns = matrix.columns;
  double largest = 0;
  for (const double value : matrix.values) largest = std::max(largest, std::abs(value));
  ReferenceSvd result;
  result.exponent = largest > 0 ? -std::ilogb(largest) : 0;
  // zero rows make a square of what is wide
  const auto m = static_cast<Eigen::Index>(columns);
  Long X = Long::Zero(static_cast<Eigen::Index>(std::max(rows, columns)), m);
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t j = 0; j < columns; ++j) {
      X(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) =
          std::ldexp(static_cast<long double>(matrix.values[i * columns + j]), result.exponent);
    }
  }
  const Eigen::HouseholderQR<Eigen::Ref<Long>> qr(X);
  const Long R = X.topRows(m).triangularView<Eigen::Upper>();
  const long double times =
      std::sqrt(static_cast<long double>(matrix.rows) / static_cast<long double>(rows));
  const Eigen::JacobiSVD<Long> svd(R, Eigen::ComputeFullV);
  const std::size_t count = std::min(matrix.rows, matrix.columns);
  for (std::size_t j = 0; j < count; ++j) {
    result.values.push_back(
        static_cast<double>(times * svd.singularValues()(static_cast<Eigen::Index>(j))));
  }
  for (Eigen::Index i = 0; i < m; ++i) {
    for (Eigen::Index j = 0; j < m; ++j) {
      result.V.push_back(static_cast<double>(svd.matrixV()(i, j)));
    }
  }
  return result;
}

}  // namespace weft::numerics
