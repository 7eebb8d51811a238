#include "weft/reference/tensor_train.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "weft/reference/factorise.hpp"

namespace weft::reference {
namespace {
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using View = Eigen::Map<const RowMajor>;

constexpr std::size_t last = mode_count - 1;

Eigen::Index index(std::size_t i) {
  return static_cast<Eigen::Index>(i);
}

View view(const std::vector<double>& values, std::size_t rows) {
  return {values.data(), index(rows), index(values.size() / rows)};
}

std::vector<double> to_vector(const RowMajor& matrix) {
  return {matrix.data(), matrix.data() + matrix.size()};
}

// A truncated SVD U (diag(values) V^T) and the squares that it leaves.
struct Cut {
  RowMajor U;
  RowMajor rest;
  std::vector<double> values;
  double left_squares = 0;
};

// `allowed`: squares that may be left.
Cut truncate(const View& M, double allowed, std::size_t most) {
  Cut cut;
  const auto rows = static_cast<std::size_t>(M.rows());
  const auto columns = static_cast<std::size_t>(M.cols());
  // A QR first leaves the SVD a square.
  const bool tall = rows > 2 * columns;
  const bool wide = columns > 2 * rows;
  ThinSvd svd;
  RowMajor Q;
  if (tall || wide) {
    const Eigen::Index r = std::min(M.rows(), M.cols());
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(tall ? Eigen::MatrixXd(M)
                                                        : Eigen::MatrixXd(M.transpose()));
    Q = qr.householderQ() * Eigen::MatrixXd::Identity(std::max(M.rows(), M.cols()), r);
    RowMajor R = qr.matrixQR().topRows(r).triangularView<Eigen::Upper>();
    if (wide) R.transposeInPlace();
    svd = thin_svd(static_cast<std::size_t>(r), static_cast<std::size_t>(r), to_vector(R));
  } else {
    svd = thin_svd(rows, columns, std::span(M.data(), rows * columns));
  }
  // the fewest that leave no more than is allowed; what is below rounding is no direction
  std::size_t k = svd.values.size();
  const auto drops = [&](std::size_t j) {
    const double square = svd.values[j] * svd.values[j];
    return j >= most || svd.values[j] <= 1e-14 * svd.values[0] ||
           cut.left_squares + square <= allowed;
  };
  while (k > 1 && drops(k - 1)) {
    --k;
    cut.left_squares += svd.values[k] * svd.values[k];
  }
  const auto inner = static_cast<Eigen::Index>(svd.values.size());
  cut.U = View(svd.U.data(), index(svd.U.size()) / inner, inner).leftCols(index(k));
  cut.rest = View(svd.V.data(), index(svd.V.size()) / inner, inner).leftCols(index(k)).transpose();
  if (tall) cut.U = Q * cut.U;
  if (wide) cut.rest = cut.rest * Q.transpose();
  for (std::size_t j = 0; j < k; ++j) cut.rest.row(index(j)) *= svd.values[j];
  cut.values.assign(svd.values.begin(), svd.values.begin() + static_cast<std::ptrdiff_t>(k));
  return cut;
}

// Shares an error out over the cuts to come.
class Budget {
 public:
  Budget(const TrainRequest& request, double squares) : request_(request), squares_(squares) {}

  Cut cut(const View& M, std::size_t bond) {
    const double cuts_left = static_cast<double>(last - bond);
    const std::size_t asked = request_.ranks[bond];
    const double allowed = request_.tolerance * request_.tolerance * squares_ - lost_;
    Cut cut = truncate(M, std::max(allowed, 0.0) / cuts_left,
                       asked > 0 ? asked : static_cast<std::size_t>(M.size()));
    lost_ += cut.left_squares;
    return cut;
  }

  TrainFit fit(TensorTrain train) const {
    return {std::move(train), squares_, squares_ > 0 ? lost_ / squares_ : 0};
  }

 private:
  const TrainRequest& request_;
  double squares_;
  double lost_ = 0;
};

}  // namespace

TensorTrain to_train(const TtModel& model) {
  TensorTrain train;
  train.ranks = model.ranks;
  for (std::size_t n = 0; n < mode_count; ++n) {
    train.sizes[n] = model.size(n);
    train.cores[n].assign(model.cores[n].begin(), model.cores[n].end());
  }
  return train;
}

TrainFit tt_svd(const std::array<std::size_t, mode_count>& sizes, std::span<const double> tensor,
                const TrainRequest& request) {
  TensorTrain train;
  train.sizes = sizes;
  std::vector<double> rest(tensor.begin(), tensor.end());
  Budget budget(request, view(rest, 1).squaredNorm());
  for (std::size_t n = 0; n < last; ++n) {
    Cut cut = budget.cut(view(rest, train.ranks[n] * sizes[n]), n);
    train.ranks[n + 1] = static_cast<std::size_t>(cut.U.cols());
    train.cores[n] = to_vector(cut.U);
    train.values[n] = std::move(cut.values);
    rest = to_vector(cut.rest);
  }
  train.cores[last] = std::move(rest);
  train.center = last;
  return budget.fit(std::move(train));
}

TrainFit tt_round(TensorTrain train, const TrainRequest& request) {
  // cores 2 .. 5 with orthonormal rows
  for (std::size_t n = last; n > 0; --n) {
    const View core = view(train.cores[n], train.ranks[n]);
    const Eigen::Index r = std::min(core.rows(), core.cols());
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(core.transpose());
    const RowMajor Q = qr.householderQ() * Eigen::MatrixXd::Identity(core.cols(), r);
    const Eigen::MatrixXd R = qr.matrixQR().topRows(r).triangularView<Eigen::Upper>();
    const RowMajor left =
        view(train.cores[n - 1], train.ranks[n - 1] * train.sizes[n - 1]) * R.transpose();
    train.cores[n - 1] = to_vector(left);
    train.cores[n] = to_vector(RowMajor(Q.transpose()));
    train.ranks[n] = static_cast<std::size_t>(r);
  }
  // The norm is now in the first core.
  Budget budget(request, view(train.cores[0], 1).squaredNorm());
  for (std::size_t n = 0; n < last; ++n) {
    Cut cut = budget.cut(view(train.cores[n], train.ranks[n] * train.sizes[n]), n);
    const RowMajor right = cut.rest * view(train.cores[n + 1], train.ranks[n + 1]);
    train.ranks[n + 1] = static_cast<std::size_t>(cut.U.cols());
    train.cores[n] = to_vector(cut.U);
    train.cores[n + 1] = to_vector(right);
    train.values[n] = std::move(cut.values);
  }
  train.center = last;
  return budget.fit(std::move(train));
}

std::vector<double> tt_full(const TensorTrain& train) {
  RowMajor product = RowMajor::Ones(1, 1);
  for (std::size_t n = 0; n < mode_count; ++n) {
    const RowMajor next = product * view(train.cores[n], train.ranks[n]);
    product = Eigen::Map<const RowMajor>(next.data(), next.size() / index(train.ranks[n + 1]),
                                         index(train.ranks[n + 1]));
  }
  return to_vector(product);
}

double tt_inner(const TensorTrain& one, const TensorTrain& other) {
  // sum over the left indices of the products of their cores, bond by bond
  RowMajor products = RowMajor::Ones(1, 1);
  for (std::size_t n = 0; n < mode_count; ++n) {
    const RowMajor next = products * view(other.cores[n], other.ranks[n]);
    const Eigen::Index rows = index(one.ranks[n] * one.sizes[n]);
    const Eigen::Map<const RowMajor> tall(next.data(), rows, index(other.ranks[n + 1]));
    products = view(one.cores[n], one.ranks[n] * one.sizes[n]).transpose() * tall;
  }
  return products(0, 0);
}

double tt_norm(const TensorTrain& train) {
  return std::sqrt(std::max(tt_inner(train, train), 0.0));
}

}  // namespace weft::reference
