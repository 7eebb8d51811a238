#include "weft/reference/truncated_svd.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "weft/error.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/random.hpp"

namespace weft {

std::string_view name_of(SvdMethod method) {
  switch (method) {
    case SvdMethod::gram:
      return "gram";
    case SvdMethod::randomized:
      return "randomized";
    case SvdMethod::qr:
      return "qr";
    case SvdMethod::automatic:
      break;
  }
  return "auto";
}

}  // namespace weft

namespace weft::reference {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Index index(std::size_t i) {
  return static_cast<Eigen::Index>(i);
}

std::span<const double> span_of(const RowMajor& matrix) {
  return {matrix.data(), static_cast<std::size_t>(matrix.size())};
}

// Rows of X as a matrix, for every block.
template <typename Use>
void for_each_block(const EachRows& each, const std::string& stage, std::size_t m, const Use& use) {
  each(stage, [&](std::size_t first, std::span<const double> rows) {
    use(index(first), Eigen::Map<const RowMajor>(rows.data(), index(rows.size() / m), index(m)));
  });
}

// Singular values and right singular vectors of R, of any shape.
struct RightSvd {
  Eigen::VectorXd values;
  Eigen::MatrixXd V;
};
RightSvd right_svd(const RowMajor& R) {
  const ThinSvd svd =
      thin_svd(static_cast<std::size_t>(R.rows()), static_cast<std::size_t>(R.cols()), span_of(R));
  const Eigen::Index rank = index(svd.values.size());
  return {Eigen::Map<const Eigen::VectorXd>(svd.values.data(), rank),
          Eigen::Map<const RowMajor>(svd.V.data(), R.cols(), rank)};
}

// The triangular factor of A by Householder's reflections.
RowMajor triangle(const Eigen::MatrixXd& A) {
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(A);
  return qr.matrixQR().topRows(std::min(A.rows(), A.cols())).triangularView<Eigen::Upper>();
}

double wanted_squares(const SvdRequest& request, double squares) {
  double wanted = std::numeric_limits<double>::infinity();
  if (request.tolerance > 0) {
    wanted = std::pow(request.tolerance, 2) * (squares + request.constant_squares);
  }
  if (request.energy > 0) wanted = std::min(wanted, (1 - request.energy) * squares);
  return wanted;
}

// The fewest of `values` that leave at most `wanted`, where all of them leave `rest`; one more than
// there are if none do.
Eigen::Index fewest(const Eigen::VectorXd& values, double rest, double wanted) {
  if (rest > wanted) return values.size() + 1;
  Eigen::Index k = values.size();
  while (k > 0 && rest + values[k - 1] * values[k - 1] <= wanted) {
    --k;
    rest += values[k] * values[k];
  }
  return k;
}

[[noreturn]] void fail_unmet(const SvdRequest& request, double squares, double rest,
                             Eigen::Index rank) {
  fail(ErrorKind::unmet_goal, "{}: {:.3g} was reached with {} components, all that {} allows",
       request.tolerance > 0 ? fmt::format("--tolerance {:g}", request.tolerance)
                             : fmt::format("--energy {}", request.energy),
       request.tolerance > 0 ? std::sqrt(rest / (squares + request.constant_squares))
                             : 1 - rest / squares,
       rank, request.rank > 0 ? "--rank" : "the data");
}

TruncatedSvd make_result(const Eigen::VectorXd& values, const Eigen::MatrixXd& V,
                         const Eigen::MatrixXd& XV, std::size_t passes) {
  TruncatedSvd svd;
  svd.rank = static_cast<std::size_t>(values.size());
  svd.passes = passes;
  svd.values.assign(values.begin(), values.end());
  svd.V.resize(static_cast<std::size_t>(V.size()));
  svd.XV.resize(static_cast<std::size_t>(XV.size()));
  Eigen::Map<RowMajor>(svd.V.data(), V.rows(), V.cols()) = V;
  Eigen::Map<RowMajor>(svd.XV.data(), XV.rows(), XV.cols()) = XV;
  return svd;
}

// Of directions with the given lengths, those that are not rounding.
Eigen::Index significant(const Eigen::VectorXd& values, const SvdRequest& request) {
  const double floor = std::max(values.size() > 0 ? values[0] * 1e-12 : 0.0, request.noise);
  Eigen::Index count = 0;
  while (count < values.size() && values[count] > floor) ++count;
  return count;
}

// X on all directions of a complete basis of its row space, from its Gram matrix or its R.
TruncatedSvd project(std::size_t K, std::size_t m, const EachRows& each, const SvdRequest& request,
                     double squares, const RightSvd& spectrum) {
  Eigen::Index k = spectrum.V.cols();
  const Eigen::Index cap = request.rank > 0 ? std::min(index(request.rank), k) : k;
  if (!request.has_goal()) k = cap;
  const Eigen::MatrixXd V = spectrum.V.leftCols(k);
  Eigen::MatrixXd XV(index(K), k);
  double rest = 0;
  for_each_block(each, "pass 2", m, [&](Eigen::Index first, const auto& rows) {
    XV.middleRows(first, rows.rows()).noalias() = rows * V;
    rest += (rows - XV.middleRows(first, rows.rows()) * V.transpose()).squaredNorm();
  });
  // turned so that the columns of XV are orthogonal
  const RightSvd ritz = right_svd(triangle(XV));
  Eigen::Index kept = significant(ritz.values, request);
  if (request.has_goal()) {
    rest += ritz.values.tail(ritz.values.size() - kept).squaredNorm();
    const Eigen::VectorXd values = ritz.values.head(kept);
    const Eigen::Index enough = fewest(values, rest, wanted_squares(request, squares));
    if (enough > std::min(kept, cap)) {
      const Eigen::Index most = std::min(kept, cap);
      fail_unmet(request, squares, rest + values.tail(kept - most).squaredNorm(), most);
    }
    kept = enough;
  }
  return make_result(ritz.values.head(kept), V * ritz.V.leftCols(kept), XV * ritz.V.leftCols(kept),
                     2);
}

TruncatedSvd by_gram(std::size_t K, std::size_t m, const EachRows& each,
                     const SvdRequest& request) {
  RowMajor G = RowMajor::Zero(index(m), index(m));
  for_each_block(each, "pass 1", m,
                 [&](Eigen::Index, const auto& rows) { G.noalias() += rows.transpose() * rows; });
  const double squares = G.trace();
  if (squares == 0) return {};
  const SymmetricEigen eigen = symmetric_eigen(m, span_of(G));
  const Eigen::Index count = index(std::min(K, m));
  RightSvd spectrum;
  spectrum.values = Eigen::Map<const Eigen::VectorXd>(eigen.values.data(), count);
  spectrum.V = Eigen::Map<const RowMajor>(eigen.vectors.data(), index(m), index(m)).leftCols(count);
  return project(K, m, each, request, squares, spectrum);
}

TruncatedSvd by_qr(std::size_t K, std::size_t m, const EachRows& each, const SvdRequest& request) {
  RowMajor R(0, index(m));
  double squares = 0;
  for_each_block(each, "pass 1", m, [&](Eigen::Index, const auto& rows) {
    squares += rows.squaredNorm();
    Eigen::MatrixXd stacked(R.rows() + rows.rows(), index(m));
    stacked << R, rows;
    R = triangle(stacked);
  });
  if (squares == 0) return {};
  return project(K, m, each, request, squares, right_svd(R));
}

// Q spans the columns of the given matrix.
Eigen::MatrixXd orthonormal(const Eigen::MatrixXd& matrix, double tolerance) {
  const RowMajor rows = matrix;
  const Orthonormal basis =
      orthonormal_basis(static_cast<std::size_t>(rows.rows()),
                        static_cast<std::size_t>(rows.cols()), span_of(rows), tolerance);
  return Eigen::Map<const RowMajor>(basis.Q.data(), rows.rows(), index(basis.rank));
}

// What is still to be gained after these errors, by geometric extrapolation.
double foreseen_gain(const std::vector<double>& errors) {
  const std::size_t t = errors.size();
  if (t < 3) return std::numeric_limits<double>::infinity();
  const double last = errors[t - 2] - errors[t - 1];
  const double before = errors[t - 3] - errors[t - 2];
  if (last <= 0) return 0;
  return before > last ? last * last / (before - last) : std::numeric_limits<double>::infinity();
}

TruncatedSvd by_iteration(std::size_t K, std::size_t m, const EachRows& each,
                          const SvdRequest& request) {
  constexpr Eigen::Index most_blocks = 6;
  const std::size_t smaller = std::min(K, m);
  const std::size_t guess = request.has_goal() ? 64 : request.rank;
  const std::size_t block = std::min(std::min(guess, smaller) + 8, smaller);
  const Eigen::Index most = index(request.rank > 0 ? std::min(request.rank, smaller) : smaller);
  std::vector<float> random(m * block);
  fill_random(request.seed, random);
  Eigen::MatrixXd Q = orthonormal(
      Eigen::Map<const Eigen::MatrixXf>(random.data(), index(m), index(block)).cast<double>(),
      1e-12);
  Eigen::MatrixXd basis(index(m), 0);
  Eigen::MatrixXd W(index(K), 0);
  std::vector<Eigen::VectorXd> history;
  for (std::size_t pass = 1;; ++pass) {
    // one pass: W_t = X Q, Y = X^T W_t
    Eigen::MatrixXd product(index(K), Q.cols());
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(index(m), Q.cols());
    double squares = 0;
    for_each_block(each, fmt::format("pass {}", pass), m,
                   [&](Eigen::Index first, const auto& rows) {
                     product.middleRows(first, rows.rows()).noalias() = rows * Q;
                     Y.noalias() += rows.transpose() * product.middleRows(first, rows.rows());
                     squares += rows.squaredNorm();
                   });
    if (squares == 0) return {};
    basis.conservativeResize(Eigen::NoChange, basis.cols() + Q.cols());
    basis.rightCols(Q.cols()) = Q;
    W.conservativeResize(Eigen::NoChange, W.cols() + Q.cols());
    W.rightCols(Q.cols()) = product;

    // Rayleigh-Ritz: W = Z R, R = (left) diag(values) X^T
    const RightSvd ritz = right_svd(triangle(W));
    const Eigen::VectorXd& values = ritz.values;
    history.push_back(values);
    const auto error = [&](const Eigen::VectorXd& known, Eigen::Index k) {
      return std::sqrt(
          std::max(squares - known.head(std::min(k, known.size())).squaredNorm(), 0.0));
    };

    // stop when what is still to be gained is little, or the basis can't grow
    Eigen::Index kept = std::min(most, values.size());
    bool met = true;
    Eigen::Index decisive = kept;  // the rank whose error decides
    double wanted = 0;
    if (request.has_goal()) {
      wanted = wanted_squares(request, squares);
      const double rest = std::max(squares - values.squaredNorm(), 0.0);
      const Eigen::Index enough = fewest(values, rest, wanted);
      met = enough <= kept;
      if (met) kept = enough;
      decisive = met ? std::max<Eigen::Index>(enough - 1, 0) : kept;
    }
    std::vector<double> errors;
    for (const Eigen::VectorXd& known : history) {
      if (known.size() >= decisive) errors.push_back(error(known, decisive));
    }
    const double gain = foreseen_gain(errors);
    bool converged = errors.back() <= 1e-7 * std::sqrt(squares) || gain <= 0.002 * errors.back();
    if (request.has_goal()) {
      converged = converged || (met && errors.back() - gain > std::sqrt(wanted));
      converged = converged && (met || kept == most);
    }
    converged = converged || pass >= 24;
    const auto result = [&] {
      if (!met) fail_unmet(request, squares, std::pow(error(values, kept), 2), kept);
      const Eigen::Index k = std::min(kept, significant(values, request));
      return make_result(values.head(k), basis * ritz.V.leftCols(k), W * ritz.V.leftCols(k), pass);
    };
    if (converged || basis.cols() >= index(smaller + block)) return result();
    if (!request.has_goal() && basis.cols() + Q.cols() > most_blocks * index(block)) {
      // keep the best directions only
      const Eigen::Index best = std::min(index(block), values.size());
      basis = (basis * ritz.V.leftCols(best)).eval();
      W = (W * ritz.V.leftCols(best)).eval();
    }
    const double scale = Y.norm();
    for (int round = 0; round < 2; ++round) Y -= basis * (basis.transpose() * Y);
    if (Y.norm() <= 1e-13 * scale) return result();
    Q = orthonormal(Y, 1e-12);
    Q -= basis * (basis.transpose() * Q);
    Q = orthonormal(Q, 1e-3);
    if (Q.cols() == 0) return result();
  }
}

}  // namespace

TruncatedSvd truncated_svd(std::size_t K, std::size_t m, const EachRows& each,
                           const SvdRequest& request) {
  SvdMethod method = request.method;
  if (method == SvdMethod::automatic) method = m <= 512 ? SvdMethod::qr : SvdMethod::randomized;
  TruncatedSvd svd = method == SvdMethod::gram ? by_gram(K, m, each, request)
                     : method == SvdMethod::qr ? by_qr(K, m, each, request)
                                               : by_iteration(K, m, each, request);
  svd.method = method;
  return svd;
}

}  // namespace weft::reference
