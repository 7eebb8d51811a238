#include "weft/reference/factorise.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <limits>

namespace weft::reference {
namespace {
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Map<const RowMajor> view(std::size_t rows, std::size_t columns, std::span<const double> A) {
  return {A.data(), static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(columns)};
}

std::vector<double> to_row_major(const Eigen::MatrixXd& matrix) {
  std::vector<double> values(static_cast<std::size_t>(matrix.size()));
  Eigen::Map<RowMajor>(values.data(), matrix.rows(), matrix.cols()) = matrix;
  return values;
}
template <typename Svd>
ThinSvd to_thin(const Svd& svd) {
  const Eigen::VectorXd& values = svd.singularValues();
  return {to_row_major(svd.matrixU()), std::vector<double>(values.begin(), values.end()),
          to_row_major(svd.matrixV())};
}

// Whether A = U diag(values) V^T with orthonormal U and V, to within rounding. Eigen's divide and
// conquer (3.4.0) gives NaN, or wrong values, for some matrices with repeated singular values.
template <typename Svd>
bool decomposes(const Eigen::MatrixXd& A, const Svd& svd) {
  const Eigen::Index r = svd.singularValues().size();
  const double rounding = 10 * static_cast<double>(std::max(A.rows(), A.cols())) *
                          std::numeric_limits<double>::epsilon();
  const Eigen::MatrixXd product =
      svd.matrixU() * svd.singularValues().asDiagonal() * svd.matrixV().transpose();
  const auto orthonormal = [&](const Eigen::MatrixXd& Q) {
    return (Q.transpose() * Q - Eigen::MatrixXd::Identity(r, r)).norm() <= rounding;
  };
  // NaN is not within
  return (A - product).norm() <= rounding * A.norm() && orthonormal(svd.matrixU()) &&
         orthonormal(svd.matrixV());
}

}  // namespace

SymmetricEigen symmetric_eigen(std::size_t n, std::span<const double> A) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(view(n, n, A));
  // Eigen's values ascend.
  const Eigen::VectorXd values = solver.eigenvalues().reverse();
  return {std::vector<double>(values.begin(), values.end()),
          to_row_major(solver.eigenvectors().rowwise().reverse())};
}

ThinSvd thin_svd(std::size_t rows, std::size_t columns, std::span<const double> A) {
  constexpr unsigned thin = Eigen::ComputeThinU | Eigen::ComputeThinV;
  const Eigen::MatrixXd matrix = view(rows, columns, A);
  const Eigen::BDCSVD<Eigen::MatrixXd> divided(matrix, thin);
  if (decomposes(matrix, divided)) return to_thin(divided);
  // Jacobi rotations are many times slower, and never fail.
  return to_thin(Eigen::JacobiSVD<Eigen::MatrixXd>(matrix, thin));
}

Orthonormal orthonormal_basis(std::size_t rows, std::size_t columns, std::span<const double> A,
                              double tolerance) {
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr;
  qr.setThreshold(tolerance);
  qr.compute(view(rows, columns, A));
  const Eigen::Index rank = qr.maxPivot() > 0 ? qr.rank() : 0;
  const Eigen::MatrixXd Q =
      qr.householderQ() * Eigen::MatrixXd::Identity(static_cast<Eigen::Index>(rows), rank);
  return {static_cast<std::size_t>(rank), to_row_major(Q)};
}

std::vector<double> inverse(std::size_t n, std::span<const double> A) {
  return to_row_major(Eigen::MatrixXd(view(n, n, A)).partialPivLu().inverse());
}

}  // namespace weft::reference
