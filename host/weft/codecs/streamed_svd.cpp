#include "weft/codecs/streamed_svd.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "weft/codecs/krylov_basis.hpp"
#include "weft/codecs/scan_source.hpp"
#include "weft/error.hpp"
#include "weft/ops/decode_pca.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"

namespace weft {
namespace {

// Errors below this part of the norm are measured: a difference of sums of squares in float
// products no longer resolves 1 % of them.
constexpr double resolved_error = 1e-2;
// Relative error of float rounding: nothing better is to be had.
constexpr double rounding_error = 1e-6;
constexpr double wanted_excess = 0.004;  // of the error, foreseen; the promise is 0.01
constexpr double measured_gain = 0.0025;
constexpr std::size_t most_passes = 24;

std::size_t block_size(const Device& device, const BtfShape& shape, std::size_t rank) {
  constexpr std::size_t oversampling = 8;
  const std::size_t smaller = std::min(shape.texels(), shape.images() * shape.channels);
  return std::min(ops::round_up(std::min(rank, smaller) + oversampling, ops::panel_width(device)),
                  smaller);
}

// What is still to be gained, from the errors of the passes so far, by geometric extrapolation.
double foreseen_gain(const std::vector<double>& errors) {
  const std::size_t t = errors.size();
  if (t < 3) return std::numeric_limits<double>::infinity();
  const double last = errors[t - 2] - errors[t - 1];
  const double before = errors[t - 3] - errors[t - 2];
  if (last <= 0) return 0;
  const double ratio = last / before;
  return before > 0 && ratio < 1 ? last * ratio / (1 - ratio)
                                 : std::numeric_limits<double>::infinity();
}

double squares_of(const std::vector<float>& values) {
  double sum = 0;
  for (const float value : values) sum += double{value} * double{value};
  return sum;
}

// Relative error of the current approximation, by decoding it.
double measured_error(Device& device, TileStream& stream, const BtfInfo& info,
                      const StreamedSvd& svd, float scale, double squares, Job& job) {
  const BtfShape& shape = info.shape;
  const double flops = 2.0 * static_cast<double>(shape.values()) * static_cast<double>(svd.rank);
  const StageTimer timer(job, "convergence check", flops, static_cast<double>(info.bytes()));
  Buffer left(device, svd.left.size() * sizeof(float), "left vectors");
  Buffer right(device, svd.right.size() * sizeof(float), "right vectors");
  Buffer mean(device, svd.mean.size() * sizeof(float), "mean");
  Buffer panels(device, ops::packed_elements(device, svd.rank, shape.texels()) * sizeof(float),
                "left vectors");
  Buffer decoded(device, stream.granule() * shape.image_values() * sizeof(float), "decoded images");
  device.write(left, std::span<const float>(svd.left));
  device.write(right, std::span<const float>(svd.right));
  device.write(mean, std::span<const float>(svd.mean));
  ops::pack_panels(device, ops::transposed(device, left, svd.rank), svd.rank, shape.texels(),
                   panels);
  ErrorSums sums;
  stream.for_each([&](std::size_t first, std::size_t count, const Buffer& raw) {
    ops::decode_pca(device, {first, count, shape.texels(), shape.channels, svd.rank}, panels, right,
                    mean, decoded);
    sums.merge(ops::error_sums(device, tile_shape(info, count, job), raw, decoded, scale));
  });
  const double unscaled = squares / (static_cast<double>(scale) * static_cast<double>(scale));
  return std::sqrt(sums.square_difference / unscaled);
}

}  // namespace

MemoryPlan plan_streamed_svd(Device& device, TileSource& source, std::size_t rank) {
  const BtfInfo& info = source.info();
  const BtfShape& shape = info.shape;
  const std::size_t n = shape.images() * shape.channels;
  const std::size_t block = block_size(device, shape, rank);
  const std::size_t granule = image_granule(shape);
  MemoryPlan plan;
  plan.add("input buffers", TileStream(device, source, granule).buffer_bytes());
  plan.add("tile", ops::panel_elements(
                       device, {granule, shape.texels(), shape.channels, info.dtype, false}) *
                       sizeof(float));
  plan.add("Krylov basis", KrylovBasis::bytes(device, shape.texels(), n, block));
  // on the device while it is made, and on the host as result and as model
  plan.add("model", 3 * (shape.texels() + n) * std::min(rank, block) * sizeof(float));
  plan.add("means", 3 * n * sizeof(float));
  plan.add("decoded images", granule * shape.image_values() * sizeof(float));
  // No driver gives more in one piece, whatever the plan allows.
  const std::size_t padded = ops::round_up(block, ops::panel_width(device));
  const std::size_t piece = std::max(shape.texels(), n) * padded * sizeof(float);
  if (piece > device.limits().largest_allocation) {
    fail_input("rank {}: a block of the basis takes {} bytes in one piece, {} gives at most {}",
               rank, piece, device.limits().name, device.limits().largest_allocation);
  }
  return plan;
}

StreamedSvd streamed_svd(Device& device, TileSource& source, std::size_t rank, Job& job) {
  const BtfInfo& info = source.info();
  const BtfShape& shape = info.shape;
  const std::size_t texels = shape.texels();
  const std::size_t n = shape.images() * shape.channels;
  StreamedSvd svd;

  // means and range
  SourceScan scan = scan_source(device, source, job);
  svd.mean = std::move(scan.means);
  const float scale = unit_scale(scan.largest);
  Buffer mean(device, n * sizeof(float), "mean");
  device.write(mean, std::span<const float>(svd.mean));

  TileStream stream(device, source, image_granule(shape));
  const std::size_t block = block_size(device, shape, rank);
  KrylovBasis basis(device, texels, n, block, job.seed);
  Buffer panels(
      device, ops::panel_elements(device, tile_shape(info, stream.granule(), job)) * sizeof(float),
      "tile");
  double squares = 0;  // |A|^2, scaled
  std::vector<double> errors;
  double measured = std::numeric_limits<double>::infinity();

  while (true) {
    // one pass: W_t and Y_t
    {
      const double flops = 4.0 * static_cast<double>(shape.values()) * static_cast<double>(block);
      const StageTimer timer(job, "products", flops, static_cast<double>(info.bytes()));
      ++svd.passes;
      basis.begin_pass();
      stream.for_each([&](std::size_t first, std::size_t count, const Buffer& raw) {
        ops::convert_tile(device, tile_shape(info, count, job), raw, mean, first * shape.channels,
                          scale, panels, svd.passes == 1 ? &squares : nullptr);
        basis.multiply(panels, first * shape.channels, count * shape.channels);
        job.advance(fmt::format("pass {}", svd.passes), first + count, shape.images());
      });
      device.finish();
    }
    if (squares == 0) return svd;  // the data is its mean

    // the best approximation in the basis
    std::vector<double> energies;
    {
      const StageTimer timer(job, "basis");
      energies = basis.energies();
    }
    const std::size_t kept = std::min({rank, texels, n, energies.size()});
    double residual = squares;
    for (std::size_t i = 0; i < kept; ++i) residual -= energies[i];
    errors.push_back(std::sqrt(std::max(residual, 0.0) / squares));
    const double mean_squares =
        static_cast<double>(texels) * squares_of(svd.mean) * std::pow(double{scale}, 2);
    svd.error = std::sqrt(std::max(residual, 0.0) / (squares + mean_squares));
    bool done = svd.passes >= most_passes;
    if (errors.back() >= resolved_error) {
      done = done || foreseen_gain(errors) <= wanted_excess * errors.back();
    } else if (svd.passes >= 2) {
      // too small to be known from norms: measure, until it no longer falls
      {
        const StageTimer timer(job, "basis");
        svd.rank = basis.result(kept, 1.0 / static_cast<double>(scale), svd.left, svd.right);
      }
      const double now = measured_error(device, stream, info, svd, scale, squares, job);
      done = done || now <= rounding_error || measured - now <= measured_gain * now;
      measured = now;
      if (done) return svd;
    }
    const StageTimer timer(job, "basis");
    // Where the basis can't grow, it holds all there is.
    if (done || !basis.grow()) {
      svd.rank = basis.result(kept, 1.0 / static_cast<double>(scale), svd.left, svd.right);
      return svd;
    }
  }
}

}  // namespace weft
