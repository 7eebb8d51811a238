#include "weft/codecs/truncated_svd.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "weft/codecs/btf_panels.hpp"
#include "weft/codecs/choose_svd.hpp"
#include "weft/codecs/scan_source.hpp"
#include "weft/codecs/streamed_svd.hpp"
#include "weft/codecs/svd_projection.hpp"
#include "weft/ops/gram.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/reals.hpp"

namespace weft {
namespace {

StreamShape stream_shape(const BtfShape& shape, StreamedRows rows, Arithmetic arithmetic) {
  const std::size_t n = shape.images() * shape.channels;
  const bool images = rows == StreamedRows::images;
  return {images ? n : shape.texels(), images ? shape.texels() : n, panel_granule(shape, rows),
          arithmetic};
}

// Bytes of the results in floats, beside those on the device: here, and again in a model.
std::size_t component_bytes(const BtfShape& shape) {
  return 2 * (shape.texels() + shape.images() * shape.channels) * sizeof(float);
}
std::size_t result_bytes(const BtfShape& shape, std::size_t rank) {
  const std::size_t n = shape.images() * shape.channels;
  return component_bytes(shape) * std::min({rank, shape.texels(), n}) + 2 * n * sizeof(float);
}

// With a goal, what the job does not hold otherwise bounds the rank.
SvdTarget make_target(Device& device, TileSource& source, const SvdOptions& options,
                      SvdMethod method, StreamedRows rows, const Job& job) {
  SvdTarget target;
  target.method = method;
  // The other way of a choice that is verified: planned with every job, and rarely taken.
  if (options.method == SvdMethod::automatic && !options.has_goal()) {
    target.workspace = ops::Tsqr::Workspace::lean;
  }
  target.rank = options.rank;
  target.tolerance = options.tolerance;
  target.energy = options.energy;
  if (target.has_goal()) {
    const BtfShape& shape = source.info().shape;
    std::size_t taken =
        btf_panels_bytes(device, source, rows, options.arithmetic) + result_bytes(shape, 0);
    for (const MemoryItem& item : job.held) taken += item.bytes;
    target.most_columns =
        columns_within(device, stream_shape(shape, rows, options.arithmetic), target,
                       component_bytes(shape), job.memory > taken ? job.memory - taken : 0);
  }
  return target;
}

MemoryPlan plan_method(Device& device, TileSource& source, const SvdOptions& options,
                       SvdMethod method, StreamedRows rows, const Job& job) {
  const BtfShape& shape = source.info().shape;
  const SvdTarget target = make_target(device, source, options, method, rows, job);
  MemoryPlan plan =
      plan_streamed_svd(device, stream_shape(shape, rows, options.arithmetic), target);
  plan.add("tile", btf_panels_bytes(device, source, rows, options.arithmetic));
  std::size_t most = options.rank > 0 ? options.rank : target.most_columns;
  if (target.has_goal()) most = std::min(most, target.most_columns);
  plan.add("model", result_bytes(shape, most));
  return plan;
}

// The factors of A = X, streamed by texels: U = XV (R D)^-1 with orthonormal columns, and
// A^T U = V (R D)^T, where (XV)^T XV = (R D)^T R D.
void read_texel_factors(Device& device, const PanelStream& stream, const StreamedSvd& svd,
                        TruncatedSvd& result) {
  const Arithmetic arithmetic = stream.arithmetic();
  const std::size_t k = svd.rank;
  const ops::Columns columns = ops::row_major_columns(device, svd.XV, svd.leading, k, arithmetic);
  const ScaledCholesky factor =
      scaled_cholesky(k, ops::gram(device, stream.rows(), columns, columns));
  std::vector<double> inverse(k * k, 0.0);  // (R D)^-1, upper triangular
  std::vector<double> transposed(k * k, 0.0);
  for (std::size_t j = 0; j < k; ++j) {
    for (std::size_t i = 0; i <= j; ++i) {
      transposed[j * k + i] = factor.R[i * k + j] * factor.lengths[j];
    }
    if (factor.R[j * k + j] == 0) continue;
    inverse[j * k + j] = 1 / factor.R[j * k + j];
    for (std::size_t i = j; i-- > 0;) {
      double sum = 0;
      for (std::size_t l = i + 1; l <= j; ++l) sum += factor.R[i * k + l] * inverse[l * k + j];
      if (factor.R[i * k + i] != 0) inverse[i * k + j] = -sum / factor.R[i * k + i];
    }
  }
  for (std::size_t i = 0; i < k; ++i) {
    for (std::size_t j = i; j < k; ++j) inverse[i * k + j] /= factor.lengths[i];
  }
  const Buffer U = times_small(device, stream.rows(), k, {&svd.XV, false, svd.leading}, inverse, k,
                               arithmetic, "left vectors");
  ops::read_reals(device, U, arithmetic, stream.rows(), k, svd.leading, 1.0,
                  std::span<float>(result.left));
  const Buffer right = times_small(device, stream.columns(), k, {&svd.V, false, svd.leading},
                                   transposed, k, arithmetic, "right vectors");
  ops::read_reals(device, right, arithmetic, stream.columns(), k, svd.leading, 1.0 / stream.scale(),
                  std::span<float>(result.right));
}

void read_factors(Device& device, const BtfShape& shape, StreamedRows rows,
                  const PanelStream& stream, const StreamedSvd& svd, TruncatedSvd& result) {
  result.rank = svd.rank;
  if (svd.rank == 0) return;
  const std::size_t n = shape.images() * shape.channels;
  result.left.resize(shape.texels() * svd.rank);
  result.right.resize(n * svd.rank);
  if (rows == StreamedRows::texels) {
    read_texel_factors(device, stream, svd, result);
    return;
  }
  ops::read_reals(device, svd.V, stream.arithmetic(), shape.texels(), svd.rank, svd.leading, 1.0,
                  std::span<float>(result.left));
  ops::read_reals(device, svd.XV, stream.arithmetic(), n, svd.rank, svd.leading,
                  1.0 / stream.scale(), std::span<float>(result.right));
}

double squares_of(const std::vector<float>& values) {
  double sum = 0;
  for (const float value : values) sum += double{value} * double{value};
  return sum;
}

}  // namespace

MemoryPlan plan_truncated_svd(Device& device, TileSource& source, const SvdOptions& options,
                              const Job& job) {
  ops::require_arithmetic(device, options.arithmetic);
  const SvdChoice choice = choose_svd(device, source, options);
  MemoryPlan plan = plan_method(device, source, options, choice.method, choice.rows, job);
  if (choice.verify) {
    MemoryPlan other = plan_method(device, source, options, SvdMethod::qr, choice.rows, job);
    if (other.total() > plan.total()) return other;
  }
  return plan;
}

TruncatedSvd truncated_svd(Device& device, TileSource& source, const SvdOptions& options,
                           Job& job) {
  ops::require_arithmetic(device, options.arithmetic);
  const BtfShape& shape = source.info().shape;
  SvdChoice choice = choose_svd(device, source, options);
  TruncatedSvd result;

  // means and range
  SourceScan scan = scan_source(device, source, job);
  result.mean = std::move(scan.means);
  const float scale = unit_scale(scan.largest);
  // |T|^2 - |A|^2; the largest values are taken near 1 before they are squared
  std::vector<float> scaled_mean(result.mean);
  for (float& value : scaled_mean) value *= scale;
  const double mean_squares = squares_of(scaled_mean) * static_cast<double>(shape.texels());

  const std::unique_ptr<PanelStream> stream =
      btf_panels(device, source, choice.rows, options.arithmetic, result.mean, scale, job);
  const auto factorise = [&](SvdMethod method) {
    SvdTarget target = make_target(device, source, options, method, choice.rows, job);
    target.constant_squares = mean_squares;
    target.noise = mean_noise(options.arithmetic) * std::sqrt(mean_squares);
    StreamedSvd svd = streamed_svd(device, *stream, target, job);
    result.passes += svd.passes;
    return svd;
  };
  StreamedSvd svd = factorise(choice.method);
  const double small = gram_safe_error(options.arithmetic) * std::sqrt(svd.squares);
  if (choice.verify && svd.squares > 0 && options.rank < stream->columns() &&
      svd.residual < small) {
    choice.method = SvdMethod::qr;
    choice.reason = fmt::format("a Gram matrix left {:.2g} of the norm, too near what it loses",
                                svd.residual / std::sqrt(svd.squares));
    svd = StreamedSvd();
    svd = factorise(SvdMethod::qr);
  }
  read_factors(device, shape, choice.rows, *stream, svd, result);
  const double unit = 1 / double{scale};
  result.squares = (svd.squares + mean_squares) * unit * unit;
  result.residual = svd.residual * unit;
  result.method = choice.method;
  result.reason = std::move(choice.reason);
  return result;
}

}  // namespace weft
