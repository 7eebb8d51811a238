#include "weft/codecs/fit_lpca.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "weft/codecs/local_subspaces.hpp"
#include "weft/codecs/scan_source.hpp"
#include "weft/codecs/texel_basis.hpp"
#include "weft/codecs/truncated_svd.hpp"
#include "weft/error.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/cluster_seeds.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {

constexpr double least_gain = 1e-3;  // of the error, by which an iteration must improve it
constexpr std::size_t mean_iterations = 10;
constexpr std::size_t reduced_iterations = 30;
constexpr std::size_t reduced_starts = 3;    // of which the best goes on
constexpr std::size_t most_samples = 16384;  // texels that seeds are chosen from

std::size_t cluster_count(const BtfShape& shape, const LpcaOptions& options) {
  return std::min(options.clusters, shape.texels());
}

std::size_t cluster_rank(const BtfShape& shape, const LpcaOptions& options) {
  return std::min({options.rank, shape.texels(), shape.images() * shape.channels});
}

// Components of the global SVD: enough that what lies outside matters little to which texels are
// alike.
std::size_t reduced_rank(const BtfShape& shape, const LpcaOptions& options) {
  const std::size_t smaller = std::min(shape.texels(), shape.images() * shape.channels);
  const std::size_t wanted = std::max<std::size_t>(4 * cluster_rank(shape, options), 32);
  const std::size_t held = cluster_count(shape, options) * (cluster_rank(shape, options) + 1);
  return std::min({wanted, held, smaller});
}

SvdOptions svd_of_rank(std::size_t rank) {
  SvdOptions options;
  options.rank = rank;
  return options;
}

LocalSubspaces::Sizes reduced_sizes(const BtfShape& shape, const LpcaOptions& options,
                                    std::size_t components) {
  return {shape.texels(), components, components, cluster_count(shape, options),
          std::min(cluster_rank(shape, options), components)};
}

LocalSubspaces::Sizes full_sizes(const BtfShape& shape, const LpcaOptions& options) {
  return {shape.texels(), shape.images() * shape.channels, image_granule(shape) * shape.channels,
          cluster_count(shape, options), cluster_rank(shape, options)};
}

// What an alternation has come to.
struct Clustering {
  std::vector<std::uint32_t> labels;  // [P]
  std::vector<float> U;               // [P][k]
  std::vector<double> errors;         // squared, of each fit
};

// Fits and assigns in turn; `subspaces` is left with the last fit, which is the best.
void alternate(LocalSubspaces& subspaces, const RowStream& rows, std::size_t clusters,
               std::size_t k, std::size_t iterations, std::uint64_t seed, Clustering& state) {
  std::vector<std::uint32_t> best_labels;
  std::vector<float> best_U;
  for (std::size_t i = 0;; ++i) {
    const double error = subspaces.fit(rows, state.labels, state.U);
    if (i > 0 && error > state.errors.back()) {
      // Nothing but rounding is left: back to the best.
      state.labels = std::move(best_labels);
      state.U = std::move(best_U);
      subspaces.fit(rows, state.labels, state.U);
      return;
    }
    const bool improved =
        i == 0 || std::sqrt(error) < (1 - least_gain) * std::sqrt(state.errors.back());
    state.errors.push_back(error);
    if (!improved || i >= iterations) return;
    LocalSubspaces::Assignment next = subspaces.assign(rows, state.labels);
    fill_empty_clusters(next.labels, clusters, next.errors);
    best_labels = std::exchange(state.labels, std::move(next.labels));
    best_U =
        std::exchange(state.U, texel_basis(state.labels, clusters, k, next.coefficients, seed + i));
  }
}

// Texels of the reduced space: left [P][R] scaled by the singular values.
std::vector<double> reduced_points(const TruncatedSvd& svd, std::size_t texels, double scale) {
  const std::size_t n = svd.mean.size();
  std::vector<double> sigma(svd.rank, 0.0);
  for (std::size_t r = 0; r < n; ++r) {
    for (std::size_t j = 0; j < svd.rank; ++j) {
      const double value = double{svd.right[r * svd.rank + j]} * scale;
      sigma[j] += value * value;
    }
  }
  std::vector<double> points(texels * svd.rank);
  for (std::size_t p = 0; p < texels; ++p) {
    for (std::size_t j = 0; j < svd.rank; ++j) {
      points[p * svd.rank + j] = double{svd.left[p * svd.rank + j]} * std::sqrt(sigma[j]);
    }
  }
  return points;
}

// Each texel to the nearest of the seeds, which are chosen among evenly spread texels.
std::vector<std::uint32_t> seeded_labels(const std::vector<double>& points, std::size_t dimension,
                                         std::size_t clusters, std::uint64_t seed) {
  const std::size_t texels = points.size() / dimension;
  const std::size_t samples = std::min(texels, std::max(most_samples, clusters));
  std::vector<double> sampled(samples * dimension);
  for (std::size_t i = 0; i < samples; ++i) {
    std::copy_n(points.data() + i * texels / samples * dimension, dimension,
                sampled.data() + i * dimension);
  }
  const std::vector<std::size_t> seeds =
      reference::cluster_seeds(dimension, sampled, clusters, seed);
  std::vector<std::uint32_t> labels(texels);
  for (std::size_t p = 0; p < texels; ++p) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t g = 0; g < seeds.size(); ++g) {
      double square = 0;
      for (std::size_t j = 0; j < dimension && square < least; ++j) {
        const double d = points[p * dimension + j] - sampled[seeds[g] * dimension + j];
        square += d * d;
      }
      if (square < least) {
        least = square;
        labels[p] = static_cast<std::uint32_t>(g);
      }
    }
  }
  return labels;
}

// Clusters the texels in the space of the global SVD.
Clustering cluster_reduced(Device& device, const BtfShape& shape, const LpcaOptions& options,
                           const TruncatedSvd& svd, double scale, std::uint64_t seed) {
  const std::size_t texels = shape.texels();
  const std::size_t dimension = svd.rank;
  const std::size_t clusters = cluster_count(shape, options);
  const std::vector<double> points = reduced_points(svd, texels, scale);
  // the points as a tile that stays
  const std::size_t width = ops::panel_width(device);
  std::vector<float> panels(ops::packed_elements(device, dimension, texels), 0.0f);
  for (std::size_t p = 0; p < texels; ++p) {
    for (std::size_t j = 0; j < dimension; ++j) {
      panels[(p / width * dimension + j) * width + p % width] =
          static_cast<float>(points[p * dimension + j]);
    }
  }
  Buffer tile(device, panels.size() * sizeof(float), "reduced texels");
  device.write(tile, std::span<const float>(panels));
  const RowStream rows = [&](const RowUser& use) {
    check_interrupt();
    use(tile, 0, dimension);
  };

  const LocalSubspaces::Sizes sizes = reduced_sizes(shape, options, dimension);
  const std::size_t k = sizes.rank;
  LocalSubspaces::Sizes mean_sizes = sizes;
  mean_sizes.rank = 0;  // k-means: subspaces of no dimension
  LocalSubspaces means(device, mean_sizes);
  LocalSubspaces subspaces(device, sizes);
  // bases begin with the leading components of all texels
  std::vector<float> leading(texels * k);
  for (std::size_t p = 0; p < texels; ++p) {
    for (std::size_t j = 0; j < k; ++j) {
      leading[p * k + j] = static_cast<float>(points[p * dimension + j]);
    }
  }
  Clustering best;
  const std::size_t starts = clusters > 1 ? reduced_starts : 1;
  for (std::size_t start = 0; start < starts; ++start) {
    Clustering state;
    state.labels = seeded_labels(points, dimension, clusters, reference::splitmix64(seed, start));
    alternate(means, rows, clusters, 0, mean_iterations, seed, state);
    state.errors.clear();
    state.U = texel_basis(state.labels, clusters, k, leading, seed);
    alternate(subspaces, rows, clusters, k, reduced_iterations, seed, state);
    if (start == 0 || state.errors.back() < best.errors.back()) best = std::move(state);
  }
  return best;
}

// The model of the last fit; A = mean + scale^-1 (mu + W U^T), without empty clusters.
std::unique_ptr<LpcaModel> to_model(LocalSubspaces& subspaces, const Clustering& state,
                                    std::size_t clusters, std::size_t k,
                                    const std::vector<float>& mean, double scale) {
  const std::size_t n = mean.size();
  const std::size_t texels = state.labels.size();
  const std::vector<float> right = subspaces.right_side();
  const std::vector<LocalSubspaces::Rotation>& rotations = subspaces.rotations();
  std::vector<bool> used(clusters, false);
  for (const std::uint32_t label : state.labels) used[label] = true;
  auto model = std::make_unique<LpcaModel>();
  std::vector<std::uint32_t> number(clusters, 0);
  std::vector<std::uint32_t> ranks;
  std::size_t components = 0;
  for (const LocalSubspaces::Rotation& rotation : rotations) components += rotation.rank;
  model->mean.reserve(clusters * n);
  model->basis.reserve(components * n);
  for (std::size_t g = 0; g < clusters; ++g) {
    if (!used[g]) continue;
    number[g] = static_cast<std::uint32_t>(ranks.size());
    ranks.push_back(static_cast<std::uint32_t>(rotations[g].rank));
    model->rank = std::max(model->rank, rotations[g].rank);
    const float* column = right.data() + g * (k + 1);
    const std::size_t stride = clusters * (k + 1);
    for (std::size_t r = 0; r < n; ++r) {
      model->mean.push_back(
          static_cast<float>(double{mean[r]} + double{column[r * stride + k]} / scale));
    }
    for (std::size_t j = 0; j < rotations[g].rank; ++j) {
      for (std::size_t r = 0; r < n; ++r) {
        model->basis.push_back(static_cast<float>(double{column[r * stride + j]} / scale));
      }
    }
  }
  std::vector<std::uint32_t> labels(texels);
  model->coefficients.assign(texels * model->rank, 0.0f);
  for (std::size_t p = 0; p < texels; ++p) {
    labels[p] = number[state.labels[p]];
    const LocalSubspaces::Rotation& rotation = rotations[state.labels[p]];
    for (std::size_t j = 0; j < rotation.rank; ++j) {
      double sum = 0;
      for (std::size_t i = 0; i < k; ++i) {
        sum += double{state.U[p * k + i]} * rotation.X[i * rotation.rank + j];
      }
      model->coefficients[p * model->rank + j] = static_cast<float>(sum);
    }
  }
  model->clusters = IndexTensor(labels, ranks.size());
  model->ranks = IndexTensor(ranks, model->rank + 1);
  return model;
}

// Data that is its mean: one cluster of rank 0.
std::unique_ptr<LpcaModel> mean_model(const BtfShape& shape, std::vector<float> mean) {
  auto model = std::make_unique<LpcaModel>();
  model->mean = std::move(mean);
  model->clusters = IndexTensor(std::vector<std::uint32_t>(shape.texels(), 0), 1);
  model->ranks = IndexTensor(std::vector<std::uint32_t>{0}, 1);
  return model;
}

}  // namespace

MemoryPlan plan_lpca(Device& device, TileSource& source, const LpcaOptions& options) {
  const BtfInfo& info = source.info();
  const BtfShape& shape = info.shape;
  const std::size_t n = shape.images() * shape.channels;
  const std::size_t k = cluster_rank(shape, options);
  const std::size_t reduced = reduced_rank(shape, options);
  const std::size_t granule = image_granule(shape);
  const MemoryPlan svd = plan_truncated_svd(device, source, svd_of_rank(reduced));

  LocalSubspaces::Sizes sizes = reduced_sizes(shape, options, reduced);
  MemoryPlan in_space = LocalSubspaces::plan(device, sizes);
  sizes.rank = 0;
  in_space.add("means of the clusters", LocalSubspaces::plan(device, sizes).total());
  in_space.add("global SVD", (shape.texels() + n) * reduced * sizeof(float));
  in_space.add("reduced texels",
               shape.texels() * reduced * (3 * sizeof(float) + 2 * sizeof(double)));

  MemoryPlan on_data = LocalSubspaces::plan(device, full_sizes(shape, options));
  on_data.add("input buffers", TileStream(device, source, granule).buffer_bytes());
  on_data.add("tile", ops::panel_elements(
                          device, {granule, shape.texels(), shape.channels, info.dtype, false}) *
                          sizeof(float));
  on_data.add("means", 3 * n * sizeof(float));
  on_data.add("model", (cluster_count(shape, options) * n * (k + 1) + shape.texels() * (k + 1)) *
                           sizeof(float));
  const auto less = [](const MemoryPlan& a, const MemoryPlan& b) { return a.total() < b.total(); };
  return std::max({svd, in_space, on_data}, less);
}

LpcaFit fit_lpca(Device& device, TileSource& source, const LpcaOptions& options, Job& job) {
  const BtfInfo& info = source.info();
  const BtfShape& shape = info.shape;
  const std::size_t n = shape.images() * shape.channels;
  const std::size_t k = cluster_rank(shape, options);
  const std::size_t clusters = cluster_count(shape, options);
  LpcaFit result;

  // in the space of a global SVD
  Clustering state;
  std::vector<float> mean;
  double scale = 1;
  {
    const TruncatedSvd svd =
        truncated_svd(device, source, svd_of_rank(reduced_rank(shape, options)), job);
    result.reduced_rank = svd.rank;
    result.svd = fmt::format("{}: {}", name_of(svd.method), svd.reason);
    mean = svd.mean;
    if (svd.rank == 0) {
      result.model = mean_model(shape, std::move(mean));
      return result;
    }
    scale = static_cast<double>(unit_scale(scan_source(device, source, job).largest));
    const StageTimer timer(job, "clustering in the reduced space");
    state = cluster_reduced(device, shape, options, svd, scale, job.seed);
    result.reduced_errors = state.errors;
    state.errors.clear();
    // further columns than the space has dimensions
    const std::size_t had = state.U.size() / shape.texels();
    std::vector<float> wider(shape.texels() * k, 0.0f);
    for (std::size_t p = 0; p < shape.texels(); ++p) {
      std::copy_n(state.U.data() + p * had, had, wider.data() + p * k);
    }
    state.U =
        had == k ? std::move(state.U) : texel_basis(state.labels, clusters, k, wider, job.seed);
  }

  // on the data
  Buffer mean_buffer(device, n * sizeof(float), "mean");
  device.write(mean_buffer, std::span<const float>(mean));
  TileStream stream(device, source, image_granule(shape));
  Buffer tile(device,
              ops::panel_elements(device, tile_shape(info, stream.granule(), job)) * sizeof(float),
              "tile");
  double squares = 0;  // of the data without its mean, scaled
  std::size_t pass = 0;
  const RowStream rows = [&](const RowUser& use) {
    ++pass;
    // two products per fit, and one with every cluster per assignment
    const bool assigns = pass % 2 == 0;
    const double columns = static_cast<double>(assigns ? clusters * (k + 1) : k + 1);
    const StageTimer timer(job, assigns ? "assignment" : "fit",
                           2.0 * static_cast<double>(shape.values()) * columns,
                           static_cast<double>(info.bytes()));
    stream.for_each([&](std::size_t first, std::size_t count, const Buffer& raw) {
      ops::convert_tile(device, tile_shape(info, count, job), raw, mean_buffer,
                        first * shape.channels, static_cast<float>(scale), tile,
                        pass == 1 ? &squares : nullptr);
      use(tile, first * shape.channels, count * shape.channels);
      job.advance(fmt::format("{} {}", assigns ? "assignment" : "fit", (pass + 1) / 2),
                  first + count, shape.images());
    });
    device.finish();
  };
  LocalSubspaces subspaces(device, full_sizes(shape, options));
  alternate(subspaces, rows, clusters, k, options.iterations, job.seed, state);

  // relative to the data with its mean
  double mean_squares = 0;
  for (const float value : mean) mean_squares += std::pow(double{value} * scale, 2);
  const double total = squares + mean_squares * static_cast<double>(shape.texels());
  for (const double error : state.errors) result.errors.push_back(std::sqrt(error / total));
  for (double& error : result.reduced_errors) error = std::sqrt(error / total);

  const StageTimer timer(job, "model");
  result.model = to_model(subspaces, state, clusters, k, mean, scale);
  return result;
}

}  // namespace weft
