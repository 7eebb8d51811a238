// Sums and products over clusters of texels, and the nearest subspaces, against double; clusters
// about the panel (24 slots) and about the block of 32 panels that is summed at once.
#include "weft/ops/cluster_products.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/decode_lpca.hpp"
#include "weft/ops/launch.hpp"

namespace weft::test {
namespace {

template <typename T>
Buffer upload(const std::vector<T>& values) {
  Buffer buffer(shared_device(), std::max<std::size_t>(values.size(), 1) * sizeof(T), "values");
  shared_device().write(buffer, std::span<const T>(values));
  return buffer;
}

// Rows of random texels in random clusters, the last of which is empty.
struct Clustering {
  std::size_t texels, rows, clusters;
  std::vector<std::uint32_t> label;
  std::vector<float> tile;  // [rows][texels]
  ops::ClusterPanels panels;
  ops::ClusterTables tables;

  Clustering(std::size_t texels_, std::size_t rows_, std::size_t clusters_)
      : texels(texels_), rows(rows_), clusters(clusters_), label(texels_) {
    Random random(7);
    const std::size_t used = std::max<std::size_t>(clusters - 1, 1);
    for (std::uint32_t& value : label) value = static_cast<std::uint32_t>(random.index(used));
    tile = random_floats(rows * texels, 3, -1, 1);
    panels = ops::cluster_panels(label, clusters, ops::panel_width(shared_device()));
    tables.clusters = clusters;
    tables.order = upload(panels.order);
    tables.table = upload(panels.panels);
    tables.first = upload(std::vector<std::uint32_t>(panels.first.begin(), panels.first.end()));
  }

  std::vector<std::size_t> members(std::size_t g) const {
    std::vector<std::size_t> list;
    for (std::size_t p = 0; p < texels; ++p) {
      if (label[p] == g) list.push_back(p);
    }
    return list;
  }
  double value(std::size_t row, std::size_t p) const { return tile[row * texels + p]; }
};

void expect_projected(std::size_t texels, std::size_t rows, std::size_t clusters, std::size_t k) {
  SCOPED_TRACE(testing::Message() << texels << " texels, " << rows << " rows, " << clusters
                                  << " clusters, " << k << " columns");
  Device& device = shared_device();
  const std::size_t width = ops::panel_width(device);
  const Clustering c(texels, rows, clusters);
  const std::size_t before = 2;  // rows of W that others fill
  const std::size_t n_padded = before + rows + 1;
  const std::size_t leading = k + 2;

  GuardedBuffer tile(device, std::span<const float>(panels_of(c.tile, rows, texels, width, 0.0f)),
                     "tile");
  GuardedBuffer sorted(device, c.panels.count() * rows * width * sizeof(float), "sorted tile");
  const std::vector<float> untouched(clusters * n_padded * leading, 7.0f);
  GuardedBuffer W(device, std::span<const float>(untouched), "W");
  GuardedBuffer squares(
      device, std::span<const float>(std::vector<float>((before + rows) * clusters, 7.0f)),
      "squares");
  const ops::ClusterMatrix matrix{&W.buffer(), n_padded, leading, k};
  ops::centre_clusters(device, c.tables, rows, before, tile.buffer(), sorted.buffer(), matrix,
                       squares.buffer());
  // U in the slots of its texels
  const std::vector<float> U = random_floats(texels * k, 5, -1, 1);
  std::vector<float> slots(std::max<std::size_t>(c.panels.count() * k * width, 1), 0.0f);
  for (std::size_t panel = 0; panel < c.panels.count(); ++panel) {
    for (std::size_t slot = 0; slot < c.panels.panels[2 * panel + 1]; ++slot) {
      for (std::size_t j = 0; j < k; ++j) {
        slots[(panel * k + j) * width + slot] = U[c.panels.order[panel * width + slot] * k + j];
      }
    }
  }
  GuardedBuffer u(device, std::span<const float>(slots), "U");
  ops::project_clusters(device, c.tables, rows, before, sorted.buffer(), u.buffer(), matrix);

  const std::vector<float> found = W.values<float>();
  const std::vector<float> found_sorted = sorted.values<float>();
  const std::vector<float> found_squares = squares.values<float>();
  EXPECT_TRUE(W.intact());
  EXPECT_TRUE(sorted.intact());
  EXPECT_TRUE(squares.intact());
  // Sums of at most 24 * 32 values at once, then of the blocks.
  const double terms = 24.0 * 32 + static_cast<double>(texels) / (24 * 32) + 8;
  const double unit = gamma(terms, float_roundoff);
  std::vector<float> rest = found;
  for (std::size_t g = 0; g < clusters; ++g) {
    const std::vector<std::size_t> members = c.members(g);
    for (std::size_t r = 0; r < rows; ++r) {
      double mean = 0, largest = 0;
      for (const std::size_t p : members) {
        mean += c.value(r, p);
        largest = std::max(largest, std::abs(c.value(r, p)));
      }
      if (!members.empty()) mean /= static_cast<double>(members.size());
      const std::size_t at = (g * n_padded + before + r) * leading;
      ASSERT_NEAR(found[at + k], mean, unit * largest);
      rest[at + k] = 7.0f;
      double square = 0;
      for (const std::size_t p : members) square += std::pow(c.value(r, p) - mean, 2);
      // each term is off by the mean's error too
      ASSERT_NEAR(found_squares[(before + r) * clusters + g], square,
                  4 * unit * (square + static_cast<double>(members.size()) * largest * largest));
      for (std::size_t j = 0; j < k; ++j) {
        double sum = 0, size = 0;
        for (const std::size_t p : members) {
          sum += (c.value(r, p) - mean) * double{U[p * k + j]};
          size += 2 * largest * std::abs(double{U[p * k + j]});
        }
        ASSERT_NEAR(found[at + j], sum, 2 * unit * size) << "cluster " << g << ", column " << j;
        rest[at + j] = 7.0f;
      }
    }
    for (std::size_t panel = c.panels.first[g]; panel < c.panels.first[g + 1]; ++panel) {
      for (std::size_t slot = c.panels.panels[2 * panel + 1]; slot < width; ++slot) {
        ASSERT_EQ(found_sorted[panel * rows * width + slot], 0.0f) << "padding";
      }
    }
  }
  EXPECT_EQ(rest, untouched) << "W beside its rows";
  EXPECT_TRUE(std::all_of(found_squares.begin(),
                          found_squares.begin() + static_cast<long>(before * clusters),
                          [](float value) { return value == 7.0f; }));
}

TEST(ClusterProducts, SmallSums) {
  expect_projected(30, 5, 3, 2);
  expect_projected(24, 1, 2, 0);
}

TEST(ClusterProducts, StraddlePanelsBlocksAndColumns) {
  for (const std::size_t texels : Sizes{1, 23, 24, 25, 49, 767, 768, 769, 1600}) {
    expect_projected(texels, 7, 1, 3);
    expect_projected(texels, 4, 4, 5);
  }
  for (const std::size_t rows : Sizes{1, 3, 4, 5, 8, 9}) expect_projected(60, rows, 3, 4);
  for (const std::size_t k : Sizes{0, 1, 2, 3, 4, 6, 7, 24}) expect_projected(70, 6, 3, k);
}

TEST(ClusterProducts, SmallTexelSquares) {
  Device& device = shared_device();
  const std::size_t width = ops::panel_width(device);
  for (const std::size_t texels : Sizes{1, 24, 50}) {
    const std::size_t rows = 5;
    const auto tile = random_floats(rows * texels, 3, -1, 1);
    const Buffer panels = upload(panels_of(tile, rows, texels, width, 0.0f));
    GuardedBuffer squares(device, ops::round_up(texels, width) * sizeof(float), "squares");
    ops::add_texel_squares(device, texels, rows, 0, panels, squares.buffer());
    ops::add_texel_squares(device, texels, rows, rows, panels, squares.buffer());
    const std::vector<float> found = squares.values<float>();
    EXPECT_TRUE(squares.intact());
    for (std::size_t p = 0; p < texels; ++p) {
      double sum = 0;
      for (std::size_t r = 0; r < rows; ++r) sum += 2 * std::pow(double{tile[r * texels + p]}, 2);
      EXPECT_NEAR(found[p], sum, gamma(rows + 2, float_roundoff) * sum);
    }
  }
}

// Integers, so that distances are exact: the nearest, its own where that is as near, and never an
// excluded one.
void expect_assigned(std::size_t texels, std::size_t clusters, std::size_t k, float margin) {
  SCOPED_TRACE(testing::Message() << texels << " texels, " << clusters << " clusters, " << k
                                  << " columns, margin " << margin);
  Device& device = shared_device();
  const std::size_t leading = ops::round_up(texels, ops::panel_width(device));
  const auto scores = random_integers(clusters * (k + 1) * leading, 5, 4);
  auto offsets = random_integers(clusters * (k + 1), 6, 4);
  const std::size_t excluded = clusters - 1;
  if (clusters > 1) offsets[excluded * (k + 1) + k] = std::numeric_limits<float>::infinity();
  const std::vector<float> squares(leading, 1000.0f);
  std::vector<std::uint32_t> before(leading, 0);
  Random random(3);
  for (std::size_t p = 0; p < texels; ++p) {
    before[p] = static_cast<std::uint32_t>(random.index(std::max<std::size_t>(clusters - 1, 1)));
  }
  GuardedBuffer label(device, std::span<const std::uint32_t>(before), "labels");
  GuardedBuffer error(device, leading * sizeof(float), "errors");
  GuardedBuffer coefficients(device, std::max<std::size_t>(leading * k, 1) * sizeof(float),
                             "coefficients");
  ops::assign_clusters(device, {clusters, k, leading, margin}, upload(scores), upload(offsets),
                       upload(squares), label.buffer(), error.buffer(), coefficients.buffer());
  const auto found = label.values<std::uint32_t>();
  const auto found_error = error.values<float>();
  const auto found_coefficients = coefficients.values<float>();
  EXPECT_TRUE(label.intact());
  EXPECT_TRUE(error.intact());
  EXPECT_TRUE(coefficients.intact());
  for (std::size_t p = 0; p < texels; ++p) {
    std::vector<double> distance(clusters);
    for (std::size_t g = 0; g < clusters; ++g) {
      const std::size_t at = g * (k + 1);
      distance[g] = double{offsets[at + k]} - 2 * double{scores[(at + k) * leading + p]};
      for (std::size_t j = 0; j < k; ++j) {
        distance[g] -=
            std::pow(double{scores[(at + j) * leading + p]} - double{offsets[at + j]}, 2);
      }
    }
    const auto least = static_cast<std::size_t>(std::min_element(distance.begin(), distance.end()) -
                                                distance.begin());
    const std::size_t expected =
        distance[least] < distance[before[p]] - double{margin} * 1000 ? least : before[p];
    ASSERT_EQ(found[p], expected) << "texel " << p;
    const double squared = 1000 + distance[expected];
    ASSERT_EQ(found_error[p], squared > double{margin} * 1000 ? squared : 0.0);
    for (std::size_t j = 0; j < k; ++j) {
      const std::size_t at = expected * (k + 1) + j;
      ASSERT_EQ(found_coefficients[p * k + j], scores[at * leading + p] - offsets[at]);
    }
  }
}

TEST(ClusterProducts, SmallAssignment) {
  for (const std::size_t clusters : Sizes{1, 2, 5}) expect_assigned(30, clusters, 3, 0);
}

TEST(ClusterProducts, AssignsToTheNearest) {
  for (const std::size_t texels : Sizes{1, 8, 23, 24, 25, 100}) {
    for (const std::size_t k : Sizes{0, 1, 5}) {
      expect_assigned(texels, 7, k, 0);
      expect_assigned(texels, 7, k, 0.0078125f);
    }
  }
}

}  // namespace
}  // namespace weft::test
