#include "weft/reference/pca.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "weft/error.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/random.hpp"
#include "weft/reference/tile.hpp"

namespace weft::reference {
namespace {
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Index index(std::size_t i) {
  return static_cast<Eigen::Index>(i);
}

// Images that fit in about 64 MiB of doubles.
std::size_t run_of_images(const BtfShape& shape) {
  constexpr std::size_t values = std::size_t{8} << 20;
  return std::clamp<std::size_t>(values / shape.image_values(), 1, shape.images());
}

// Q spans the columns of the given matrix.
Eigen::MatrixXd orthonormal(const Eigen::MatrixXd& matrix, double tolerance) {
  const RowMajor rows = matrix;
  const Orthonormal basis = orthonormal_basis(
      static_cast<std::size_t>(rows.rows()), static_cast<std::size_t>(rows.cols()),
      std::span(rows.data(), static_cast<std::size_t>(rows.size())), tolerance);
  return Eigen::Map<const RowMajor>(basis.Q.data(), rows.rows(), index(basis.rank));
}

}  // namespace

std::unique_ptr<PcaModel> encode_pca(TileSource& source, std::size_t rank, Job& job) {
  const BtfShape& shape = source.info().shape;
  const std::size_t texels = shape.texels();
  const std::size_t n = shape.images() * shape.channels;
  const std::size_t smaller = std::min(texels, n);
  const std::size_t run = run_of_images(shape);
  const std::size_t block = std::min(std::min(rank, smaller) + 8, smaller);
  constexpr std::size_t most_blocks = 6;

  MemoryPlan plan;
  plan.add("tile", 2 * run * shape.image_values() * sizeof(double));
  plan.add("Krylov basis", 3 * most_blocks * (texels + n) * block * sizeof(double));
  plan.add("model", (texels + n) * std::min(rank, smaller) * sizeof(float));
  job.plan(plan);

  std::vector<double> values(run * shape.image_values());
  // Calls use(first row, A^T of these rows as [rows][P]) for every run of images.
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(index(n));
  const auto for_each_run = [&](const std::string& stage, const auto& use) {
    for (std::size_t first = 0; first < shape.images(); first += run) {
      check_interrupt();
      const std::size_t count = std::min(run, shape.images() - first);
      const std::span<double> tile = std::span(values).first(count * shape.image_values());
      read_tile(source, first, count, job.nan_zero, tile);
      Eigen::MatrixXd rows(index(count * shape.channels), index(texels));
      for (std::size_t image = 0; image < count; ++image) {
        rows.middleRows(index(image * shape.channels), index(shape.channels)) =
            Eigen::Map<const Eigen::MatrixXd>(tile.data() + image * shape.image_values(),
                                              index(shape.channels), index(texels));
      }
      use(index(first * shape.channels), rows);
      job.advance(stage, first + count, shape.images());
    }
  };

  // mean ABRDF, rounded to float as the model stores it
  {
    const StageTimer timer(job, "scan");
    for_each_run("scan", [&](Eigen::Index row, const Eigen::MatrixXd& rows) {
      mean.segment(row, rows.rows()) = rows.rowwise().mean().cast<float>().cast<double>();
    });
  }

  const double mean_rounding = 0x1p-24 * mean.norm() * std::sqrt(static_cast<double>(texels));

  // Krylov iteration
  const StageTimer timer(job, "iteration");
  std::vector<float> random(texels * block);
  fill_random(job.seed, random);
  Eigen::MatrixXd Q = orthonormal(
      Eigen::Map<const Eigen::MatrixXf>(random.data(), index(texels), index(block)).cast<double>(),
      1e-12);
  Eigen::MatrixXd K(index(texels), 0);
  Eigen::MatrixXd W(index(n), 0);
  Eigen::VectorXd sigma;
  Eigen::MatrixXd X;
  double previous = -1;
  double before = -1;
  for (std::size_t pass = 1;; ++pass) {
    // one pass: W_t = A^T Q, Y = A W_t
    Eigen::MatrixXd product(index(n), Q.cols());
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(index(texels), Q.cols());
    double squares = 0;
    for_each_run(fmt::format("pass {}", pass), [&](Eigen::Index row, const Eigen::MatrixXd& rows) {
      const Eigen::MatrixXd centred = rows.colwise() - mean.segment(row, rows.rows());
      product.middleRows(row, rows.rows()).noalias() = centred * Q;
      Y.noalias() += centred.transpose() * product.middleRows(row, rows.rows());
      squares += centred.squaredNorm();
    });
    K.conservativeResize(Eigen::NoChange, K.cols() + Q.cols());
    K.rightCols(Q.cols()) = Q;
    W.conservativeResize(Eigen::NoChange, W.cols() + Q.cols());
    W.rightCols(Q.cols()) = product;

    // Rayleigh-Ritz: W = Z R, R = (left) sigma X^T
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(W);
    const Eigen::Index small = std::min(W.rows(), W.cols());
    const RowMajor R = qr.matrixQR().topRows(small).triangularView<Eigen::Upper>();
    const ThinSvd svd =
        thin_svd(static_cast<std::size_t>(small), static_cast<std::size_t>(W.cols()),
                 std::span(R.data(), static_cast<std::size_t>(R.size())));
    sigma = Eigen::Map<const Eigen::VectorXd>(svd.values.data(), index(svd.values.size()));
    X = Eigen::Map<const RowMajor>(svd.V.data(), W.cols(), sigma.size());

    // stop when what is still to be gained is little, or the basis can't grow
    const Eigen::Index kept = std::min(index(rank), sigma.size());
    const double error = std::sqrt(std::max(squares - sigma.head(kept).squaredNorm(), 0.0));
    const bool exact = error <= 1e-7 * std::sqrt(squares);
    bool converged = exact || pass >= 24;
    if (before >= 0) {
      const double last = previous - error;
      const double earlier = before - previous;
      const double ratio = earlier > 0 ? last / earlier : 0;
      converged = converged || (ratio < 1 && last * ratio / (1 - ratio) <= 0.002 * error);
    }
    before = previous;
    previous = error;
    if (converged || K.cols() >= index(smaller) + index(block)) break;
    if (K.cols() + Q.cols() > index(most_blocks * block)) {
      // keep the best directions only
      const Eigen::Index best = std::min(index(block), sigma.size());
      K = (K * X.leftCols(best)).eval();
      W = (W * X.leftCols(best)).eval();
    }
    const double scale = Y.norm();
    for (int round = 0; round < 2; ++round) Y -= K * (K.transpose() * Y);
    if (Y.norm() <= 1e-13 * scale) break;
    Q = orthonormal(Y, 1e-12);
    Q -= K * (K.transpose() * Q);
    Q = orthonormal(Q, 1e-3);
    if (Q.cols() == 0) break;
  }

  // leading components that the data holds
  // What the mean's rounding to float leaves is not a component.
  const double largest = sigma.size() > 0 ? sigma[0] : 0;
  const double floor = std::max(largest * 1e-12, mean_rounding);
  Eigen::Index k = 0;
  while (k < std::min(index(rank), sigma.size()) && sigma[k] > floor) ++k;
  auto model = std::make_unique<PcaModel>();
  model->rank = static_cast<std::size_t>(k);
  model->mean.resize(n);
  Eigen::Map<Eigen::VectorXf>(model->mean.data(), index(n)) = mean.cast<float>();
  model->coefficients.resize(texels * model->rank);
  Eigen::Map<Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      model->coefficients.data(), index(texels), k) = (K * X.leftCols(k)).cast<float>();
  model->basis.resize(model->rank * n);
  Eigen::Map<Eigen::MatrixXf>(model->basis.data(), index(n), k) = (W * X.leftCols(k)).cast<float>();
  return model;
}

void decode_pca(const PcaModel& model, std::size_t first, std::size_t count,
                std::span<double> out) {
  const BtfShape& shape = model.info.btf.shape;
  const Eigen::Index k = index(model.rank);
  const Eigen::Index n = index(model.mean.size());
  const Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> A(
      model.coefficients.data(), index(shape.texels()), k);
  const Eigen::Map<const Eigen::MatrixXf> B(model.basis.data(), n, k);
  const Eigen::Map<const Eigen::VectorXf> mean(model.mean.data(), n);
  const Eigen::MatrixXd A_double = A.cast<double>();
  const Eigen::Index channels = index(shape.channels);
  for (std::size_t image = 0; image < count; ++image) {
    const Eigen::Index row = index(first + image) * channels;
    // [C][P] column-major is [P][C] row-major
    Eigen::Map<Eigen::MatrixXd> texels(out.data() + image * shape.image_values(), channels,
                                       index(shape.texels()));
    texels.noalias() = B.middleRows(row, channels).cast<double>() * A_double.transpose();
    texels.colwise() += mean.segment(row, channels).cast<double>();
  }
}

}  // namespace weft::reference
