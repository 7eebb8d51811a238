#include "weft/codecs/local_subspaces.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "weft/error.hpp"
#include "weft/ops/decode_lpca.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/gram.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/factorise.hpp"

namespace weft {
namespace {

constexpr std::size_t float_bytes = sizeof(float);

// Rounding of float sums, as a part of |a|^2: no texel moves for less, and less is no error.
constexpr float rounding = 0x1p-20f;

// Sizes of the device's matrices, in elements.
struct Elements {
  std::size_t panels, sorted, U, n_padded, leading, W, B, scores;
};

Elements elements_of(const Device& device, const LocalSubspaces::Sizes& sizes) {
  const std::size_t width = ops::panel_width(device);
  Elements e{};
  e.panels = ops::most_cluster_panels(sizes.texels, sizes.clusters, width);
  e.sorted = e.panels * sizes.tile_rows * width;
  e.U = e.panels * sizes.rank * width;
  // Each cluster's part of W is a buffer of its own to the Gram kernel, which reads 8 columns at
  // once.
  e.n_padded = ops::round_up(sizes.n, std::max<std::size_t>(device.limits().alignment / 4, 1));
  e.leading = ops::round_up(sizes.rank + 1, 8);
  e.W = sizes.clusters * e.n_padded * e.leading;
  e.B = sizes.n * sizes.clusters * (sizes.rank + 1);
  e.scores = sizes.clusters * (sizes.rank + 1) * ops::round_up(sizes.texels, width);
  return e;
}

}  // namespace

MemoryPlan LocalSubspaces::plan(const Device& device, const Sizes& sizes) {
  // The largest piece, in double, which no size overflows; then the exact sizes.
  const auto limit = static_cast<double>(device.limits().largest_allocation);
  const auto clusters = static_cast<double>(sizes.clusters);
  const auto rank = static_cast<double>(sizes.rank);
  const auto longer = static_cast<double>(std::max(sizes.n, sizes.texels));
  const double estimate = clusters * (rank + 1) * longer * float_bytes;
  const Elements e = estimate < 4 * limit ? elements_of(device, sizes) : Elements{};
  const auto exact =
      static_cast<double>(std::max({e.sorted, e.U, e.W, e.B, e.scores}) * float_bytes);
  if (std::max(exact, estimate) > limit) {
    fail_input(
        "{} clusters of rank {}: their products take {:.0f} bytes in one piece, {} gives at most "
        "{:.0f}",
        sizes.clusters, sizes.rank, std::max(exact, estimate), device.limits().name, limit);
  }
  const std::size_t columns = sizes.rank + 1;
  MemoryPlan plan;
  plan.add("tile sorted by cluster", e.sorted * float_bytes);
  plan.add("bases of the clusters", (e.W + 2 * e.B) * float_bytes);  // B read back at the end
  plan.add("scores of the texels", e.scores * float_bytes);
  // U on the device, made ready for it, made from coefficients, and in double while it is; the best
  // seen
  plan.add(
      "coefficients of the texels",
      2 * e.U * float_bytes +
          sizes.texels * (sizes.rank * (4 * float_bytes + 4 * sizeof(double)) + 8 * float_bytes));
  plan.add("sums of squares", 2 * sizes.n * sizes.clusters * float_bytes);
  plan.add("Gram matrices", 4 * sizes.clusters * columns * columns * sizeof(double) +
                                2 * ops::gram_bytes(sizes.n, columns, columns));
  return plan;
}

LocalSubspaces::LocalSubspaces(Device& device, const Sizes& sizes)
    : device_(device), sizes_(sizes) {
  const Elements e = elements_of(device, sizes);
  sorted_ = Buffer(device, e.sorted * float_bytes, "tile sorted by cluster");
  U_ = Buffer(device, e.U * float_bytes, "texel bases");
  W_ = Buffer(device, e.W * float_bytes, "cluster products");
  row_squares_ = Buffer(device, sizes.n * sizes.clusters * float_bytes, "sums of squares");
  B_ = Buffer(device, e.B * float_bytes, "cluster bases");
  scores_ = Buffer(device, e.scores * float_bytes, "scores");
  texel_squares_ =
      Buffer(device, ops::round_up(sizes.texels, ops::panel_width(device)) * float_bytes,
             "squares of texels");
  matrix_ = {&W_, e.n_padded, e.leading, sizes.rank};
  // columns past the last are read and not used
  device.fill_zero(W_, 0, W_.size());
}

double LocalSubspaces::fit(const RowStream& rows, std::span<const std::uint32_t> labels,
                           std::span<const float> U) {
  const std::size_t width = ops::panel_width(device_);
  const std::size_t k = sizes_.rank;
  // sort the texels by cluster
  const ops::ClusterPanels panels = ops::cluster_panels(labels, sizes_.clusters, width);
  panels_ = panels.count();
  counts_.assign(sizes_.clusters, 0);
  for (const std::uint32_t label : labels) ++counts_[label];
  tables_.clusters = sizes_.clusters;
  tables_.order = Buffer(device_, panels.order.size() * sizeof(std::uint32_t), "order of texels");
  tables_.table = Buffer(device_, panels.panels.size() * sizeof(std::uint32_t), "panels");
  tables_.first = Buffer(device_, panels.first.size() * sizeof(std::uint32_t), "clusters");
  device_.write(tables_.order, std::span<const std::uint32_t>(panels.order));
  device_.write(tables_.table, std::span<const std::uint32_t>(panels.panels));
  const std::vector<std::uint32_t> first(panels.first.begin(), panels.first.end());
  device_.write(tables_.first, std::span<const std::uint32_t>(first));
  std::vector<float> slots(panels_ * k * width, 0.0f);
  for (std::size_t panel = 0; panel < panels_; ++panel) {
    for (std::size_t slot = 0; slot < panels.panels[2 * panel + 1]; ++slot) {
      const std::size_t p = panels.order[panel * width + slot];
      for (std::size_t j = 0; j < k; ++j) {
        slots[(panel * k + j) * width + slot] = U[p * k + j];
      }
    }
  }
  if (k > 0) device_.write(U_, std::span<const float>(slots));

  // the pass
  rows([&](const Buffer& tile, std::size_t first_row, std::size_t count) {
    ops::centre_clusters(device_, tables_, count, first_row, tile, sorted_, matrix_, row_squares_);
    if (k > 0) ops::project_clusters(device_, tables_, count, first_row, sorted_, U_, matrix_);
  });
  device_.finish();

  // |A_g - mu_g|^2
  std::vector<float> squares(sizes_.n * sizes_.clusters);
  device_.read(row_squares_, std::span<float>(squares));
  std::vector<double> norms(sizes_.clusters, 0.0);
  for (std::size_t r = 0; r < sizes_.n; ++r) {
    for (std::size_t g = 0; g < sizes_.clusters; ++g) norms[g] += squares[r * sizes_.clusters + g];
  }

  // the singular values of the clusters
  grams_.assign(sizes_.clusters, std::vector<double>((k + 1) * (k + 1), 0.0));
  rotations_.assign(sizes_.clusters, {});
  lambdas_.assign(sizes_.clusters, {});
  const std::size_t part = matrix_.n_padded * matrix_.leading * float_bytes;
  double error = 0;
  double total = 0;
  for (std::size_t g = 0; g < sizes_.clusters; ++g) {
    if (counts_[g] == 0) continue;
    {
      const Buffer W = Buffer::part(device_, W_, g * part, part, "products of a cluster");
      const ops::Columns columns{&W, k + 1, width, matrix_.leading};
      grams_[g] = ops::gram(device_, sizes_.n, columns, columns);
    }
    std::vector<double> squared(k * k);
    for (std::size_t i = 0; i < k; ++i) {
      std::copy_n(grams_[g].data() + i * (k + 1), k, squared.data() + i * k);
    }
    const double mean_square = grams_[g].back() * static_cast<double>(counts_[g]);
    double explained = 0;
    if (k > 0) {
      const reference::SymmetricEigen eigen = reference::symmetric_eigen(k, squared);
      // What float rounding leaves of the cluster's texels is no component.
      const double floor = std::max(eigen.values[0] * 0x1p-46, mean_square * 0x1p-46);
      Rotation& rotation = rotations_[g];
      while (rotation.rank < k && eigen.values[rotation.rank] > floor) ++rotation.rank;
      for (std::size_t i = 0; i < k; ++i) {
        for (std::size_t j = 0; j < rotation.rank; ++j) {
          rotation.X.push_back(eigen.vectors[i * k + j]);
        }
      }
      lambdas_[g].assign(eigen.values.begin(),
                         eigen.values.begin() + static_cast<std::ptrdiff_t>(rotation.rank));
      for (const double lambda : lambdas_[g]) explained += lambda;
    }
    error += std::max(norms[g] - explained, 0.0);
    total += norms[g] + mean_square;
  }
  return error > total * rounding ? error : 0.0;
}

void LocalSubspaces::transform(const std::vector<std::vector<double>>& T) {
  const std::size_t k = sizes_.rank;
  const std::size_t columns = sizes_.clusters * (k + 1);
  const std::size_t part = matrix_.n_padded * matrix_.leading;
  for (std::size_t g = 0; g < sizes_.clusters; ++g) {
    // [T 0; 0 1]
    const std::size_t rank = rotations_[g].rank;
    std::vector<float> square((k + 1) * (k + 1), 0.0f);
    for (std::size_t i = 0; i < k; ++i) {
      for (std::size_t j = 0; j < rank; ++j) {
        square[i * (k + 1) + j] = static_cast<float>(T[g][i * rank + j]);
      }
    }
    square.back() = 1.0f;
    Buffer small(device_, square.size() * float_bytes, "basis change");
    device_.write(small, std::span<const float>(square));
    ops::gemm(device_, sizes_.n, k + 1, k + 1, 1.0f,
              ops::row_major(device_, W_, matrix_.leading, g * part),
              ops::row_major(device_, small, k + 1), 0.0f,
              ops::to_row_major(device_, B_, columns, g * (k + 1)));
    device_.finish();
  }
}

LocalSubspaces::Assignment LocalSubspaces::assign(const RowStream& rows,
                                                  std::span<const std::uint32_t> labels) {
  const std::size_t k = sizes_.rank;
  const std::size_t columns = sizes_.clusters * (k + 1);
  const std::size_t padded = ops::round_up(sizes_.texels, ops::panel_width(device_));
  // orthonormal bases, and where the means lie in them
  std::vector<std::vector<double>> whitening(sizes_.clusters);
  std::vector<float> offsets(columns, 0.0f);
  for (std::size_t g = 0; g < sizes_.clusters; ++g) {
    const Rotation& rotation = rotations_[g];
    for (std::size_t i = 0; i < k; ++i) {
      for (std::size_t j = 0; j < rotation.rank; ++j) {
        whitening[g].push_back(rotation.X[i * rotation.rank + j] / std::sqrt(lambdas_[g][j]));
      }
    }
    for (std::size_t j = 0; j < rotation.rank; ++j) {
      double product = 0;
      for (std::size_t i = 0; i < k; ++i) {
        product += whitening[g][i * rotation.rank + j] * grams_[g][i * (k + 1) + k];
      }
      offsets[g * (k + 1) + j] = static_cast<float>(product);
    }
    offsets[g * (k + 1) + k] = counts_[g] > 0 ? static_cast<float>(grams_[g].back())
                                              : std::numeric_limits<float>::infinity();
  }
  transform(whitening);

  // the pass
  rows([&](const Buffer& tile, std::size_t first, std::size_t count) {
    ops::gemm_packed(device_, columns, padded, count, 1.0f,
                     ops::transposed(device_, B_, columns, first * columns), tile,
                     first == 0 ? 0.0f : 1.0f, ops::to_row_major(device_, scores_, padded));
    if (!has_texel_squares_) {
      ops::add_texel_squares(device_, sizes_.texels, count, first, tile, texel_squares_);
    }
  });
  has_texel_squares_ = true;

  // the nearest
  Buffer offset_buffer(device_, offsets.size() * float_bytes, "offsets");
  device_.write(offset_buffer, std::span<const float>(offsets));
  Assignment result;
  result.labels.assign(padded, 0);
  std::copy(labels.begin(), labels.end(), result.labels.begin());
  Buffer label_buffer(device_, padded * sizeof(std::uint32_t), "labels");
  device_.write(label_buffer, std::span<const std::uint32_t>(result.labels));
  Buffer error_buffer(device_, padded * float_bytes, "errors of texels");
  Buffer coefficient_buffer(device_, padded * k * float_bytes, "coefficients");
  ops::assign_clusters(device_, {sizes_.clusters, k, padded, rounding}, scores_, offset_buffer,
                       texel_squares_, label_buffer, error_buffer, coefficient_buffer);
  result.errors.resize(sizes_.texels);
  result.coefficients.resize(sizes_.texels * k);
  result.labels.resize(sizes_.texels);
  device_.read(label_buffer, std::span<std::uint32_t>(result.labels));
  device_.read(error_buffer, std::span<float>(result.errors));
  if (k > 0) device_.read(coefficient_buffer, std::span<float>(result.coefficients));
  return result;
}

std::vector<float> LocalSubspaces::right_side() {
  std::vector<std::vector<double>> X;
  for (const Rotation& rotation : rotations_) X.push_back(rotation.X);
  transform(X);
  std::vector<float> values(sizes_.n * sizes_.clusters * (sizes_.rank + 1));
  device_.read(B_, std::span<float>(values));
  return values;
}

}  // namespace weft
