#include "weft/reference/pca.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "weft/btf/texel_block.hpp"
#include "weft/error.hpp"
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

}  // namespace

PcaFit encode_pca(TileSource& source, SvdRequest request, Job& job) {
  const BtfShape& shape = source.info().shape;
  const std::size_t texels = shape.texels();
  const std::size_t n = shape.images() * shape.channels;
  const std::size_t smaller = std::min(texels, n);
  constexpr std::size_t most_dense = 4096;
  const bool dense = request.method == SvdMethod::gram || request.method == SvdMethod::qr;
  if (dense && smaller > most_dense) {
    fail_input(
        "--svd {}: the short side of {} texels x {} image channels is {}, at most {} are taken",
        name_of(request.method), texels, n, smaller, most_dense);
  }
  if (request.method == SvdMethod::automatic) {
    request.method = smaller <= 512 ? SvdMethod::qr : SvdMethod::randomized;
  }
  const bool by_texels = request.method != SvdMethod::randomized && n < texels;
  const std::size_t run = run_of_images(shape);
  const std::size_t block = texel_granule(shape);

  MemoryPlan plan;
  const std::size_t rank = request.rank > 0 ? std::min(request.rank, smaller) : smaller;
  plan.add("tile", 3 * std::max(run * shape.image_values(), block * n) * sizeof(double));
  const std::size_t columns =
      request.method == SvdMethod::randomized && !request.has_goal() ? 18 * (rank + 8) : 3 * rank;
  plan.add("basis", (texels + n) * columns * sizeof(double));
  if (request.method != SvdMethod::randomized) {
    plan.add("small problem", 6 * smaller * smaller * sizeof(double));
  }
  plan.add("model", (texels + n) * rank * sizeof(float));
  job.plan(plan);

  // mean ABRDF, rounded to float as the model stores it; none where a weighted one was taken
  const bool centred = !source.texel_scale().empty();
  std::vector<double> values(run * shape.image_values());
  const auto for_each_run = [&](const std::string& stage, const auto& use) {
    for (std::size_t first = 0; first < shape.images(); first += run) {
      check_interrupt();
      const std::size_t count = std::min(run, shape.images() - first);
      const std::span<double> tile = std::span(values).first(count * shape.image_values());
      read_tile(source, first, count, job.nan_zero, tile);
      use(first, count, tile);
      job.advance(stage, first + count, shape.images());
    }
  };
  std::vector<double> mean;
  double mean_squares = 0;
  double squares = 0;
  {
    const StageTimer timer(job, "scan");
    for_each_run("scan", [&](std::size_t, std::size_t count, std::span<const double> tile) {
      for (const double value : tile) squares += value * value;
      for (const double sum : scan_tile(count, texels, shape.channels, tile).sums) {
        const float rounded =
            centred ? 0.0f : static_cast<float>(sum / static_cast<double>(texels));
        mean.push_back(static_cast<double>(rounded));
        mean_squares += mean.back() * mean.back() * static_cast<double>(texels);
      }
    });
  }

  // rows of A^T by runs of images, or of A by blocks of texels
  const EachRows each_image = [&](const std::string& stage, const UseRows& use) {
    for_each_run(stage, [&](std::size_t first, std::size_t count, std::span<const double> tile) {
      const std::size_t row = first * shape.channels;
      use(row, convert_tile(count, texels, shape.channels, tile,
                            std::span(mean).subspan(row, count * shape.channels), 1.0));
    });
  };
  const EachRows each_texel = [&](const std::string& stage, const UseRows& use) {
    std::vector<std::byte> raw;
    for (std::size_t first = 0; first < texels; first += block) {
      check_interrupt();
      const std::size_t count = std::min(block, texels - first);
      raw.resize(count * n * size_of(source.info().dtype));
      read_texels(source, first, count, raw);
      std::vector<double> tile(count * n);
      to_double(source.info().dtype, raw, job.nan_zero, tile);
      const std::vector<double> columns =
          convert_tile(shape.images(), count, shape.channels, tile, mean, 1.0);
      for (std::size_t r = 0; r < n; ++r) {
        for (std::size_t p = 0; p < count; ++p) tile[p * n + r] = columns[r * count + p];
      }
      use(first, tile);
      job.advance(stage, first + count, texels);
    }
  };

  const StageTimer timer(job, "iteration");
  request.constant_squares = mean_squares;
  request.seed = job.seed;
  request.noise = request.mean_noise * std::sqrt(mean_squares);
  const TruncatedSvd svd = by_texels ? truncated_svd(texels, n, each_texel, request)
                                     : truncated_svd(n, texels, each_image, request);

  PcaFit fit;
  fit.method = svd.method;
  fit.passes = svd.passes;
  fit.squares = squares;
  fit.residual = std::sqrt(std::max(0.0, squares - mean_squares));
  fit.model = std::make_unique<PcaModel>();
  PcaModel& model = *fit.model;
  model.rank = svd.rank;
  model.mean.assign(mean.begin(), mean.end());
  model.coefficients.resize(texels * svd.rank);
  model.basis.resize(svd.rank * n);
  const Eigen::Index k = index(svd.rank);
  if (k == 0) return fit;
  Eigen::Map<Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> left(
      model.coefficients.data(), index(texels), k);
  Eigen::Map<Eigen::MatrixXf> right(model.basis.data(), index(n), k);
  // the columns of U are orthonormal
  const auto left_over = [&](const auto& B) {
    return std::sqrt(
        std::max(0.0, squares - mean_squares - B.template cast<double>().squaredNorm()));
  };
  const Eigen::Map<const RowMajor> V(svd.V.data(), index(by_texels ? n : texels), k);
  const Eigen::Map<const RowMajor> XV(svd.XV.data(), index(by_texels ? texels : n), k);
  if (!by_texels) {
    left = V.cast<float>();
    right = XV.cast<float>();
    fit.residual = left_over(right);
    return fit;
  }
  // XV = U R, A = U (V R^T)^T
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(XV);
  const Eigen::MatrixXd R = qr.matrixQR().topRows(k).triangularView<Eigen::Upper>();
  const Eigen::MatrixXd U = qr.householderQ() * Eigen::MatrixXd::Identity(XV.rows(), k);
  left = U.cast<float>();
  right = (V * R.transpose()).cast<float>();
  fit.residual = left_over(right);
  return fit;
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
