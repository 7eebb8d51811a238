// Images from a local PCA model: clusters about the panel (24 slots), empty ones, one of all texels
// and one per texel; neighbouring texels and scattered ones.
#include "weft/ops/decode_lpca.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/launch.hpp"

namespace weft::test {
namespace {

struct Case {
  std::size_t images = 2;
  std::size_t channels = 3;
  std::size_t rank = 2;
  std::size_t clusters = 1;
  std::vector<std::uint32_t> label;
};

// Labels drawn at random: most texels' neighbours are in other clusters.
std::vector<std::uint32_t> scattered(std::size_t texels, std::size_t clusters) {
  Random random(5);
  std::vector<std::uint32_t> label(texels);
  for (std::uint32_t& value : label) value = static_cast<std::uint32_t>(random.index(clusters));
  return label;
}

// Runs of texels in one cluster.
std::vector<std::uint32_t> in_runs(std::size_t texels, std::size_t clusters, std::size_t run) {
  std::vector<std::uint32_t> label(texels);
  for (std::size_t p = 0; p < texels; ++p) {
    label[p] = static_cast<std::uint32_t>(p / run % clusters);
  }
  return label;
}

// All values and their sums of magnitudes, term by term.
void expect_decoded(const Case& c, std::size_t first, std::size_t count, double size = 1.0) {
  Device& device = shared_device();
  const std::size_t texels = c.label.size();
  const std::size_t n = c.images * c.channels;
  SCOPED_TRACE(testing::Message() << "images " << first << " to " << first + count << " of "
                                  << texels << " texels in " << c.clusters << " clusters, "
                                  << c.channels << " channels, rank " << c.rank);
  const std::vector<float> A = random_floats(texels * c.rank, 2, -1, 1);
  const std::vector<float> B = random_floats(c.clusters * n * c.rank, 3, -size, size);
  const std::vector<float> means = random_floats(c.clusters * n, 4, -size, size);

  const std::size_t width = ops::panel_width(device);
  const ops::ClusterPanels panels = ops::cluster_panels(c.label, c.clusters, width);
  EXPECT_LE(panels.count(), ops::most_cluster_panels(texels, c.clusters, width));
  std::vector<float> sorted(std::max<std::size_t>(panels.count() * c.rank * width, 1), 0.0f);
  for (std::size_t panel = 0; panel < panels.count(); ++panel) {
    for (std::size_t slot = 0; slot < panels.panels[2 * panel + 1]; ++slot) {
      for (std::size_t j = 0; j < c.rank; ++j) {
        sorted[(panel * c.rank + j) * width + slot] =
            A[panels.order[panel * width + slot] * c.rank + j];
      }
    }
  }
  // At rank 0 there is nothing in A and B; the kernel must not look there.
  std::vector<float> right = B;
  right.resize(std::max<std::size_t>(right.size(), 1), unused);
  GuardedBuffer slots(device, std::span<const std::uint32_t>(panels.slots), "slots");
  GuardedBuffer table(device, std::span<const std::uint32_t>(panels.panels), "panels");
  GuardedBuffer a(device, std::span<const float>(sorted), "A");
  GuardedBuffer b(device, std::span<const float>(right), "B");
  GuardedBuffer mean(device, std::span<const float>(means), "mean");
  GuardedBuffer out(device, count * texels * c.channels * sizeof(float), "images");
  const ops::DecodeLpcaShape shape{c.images,   first,  count,         texels,
                                   c.channels, c.rank, panels.count()};
  const std::vector<float> zeros(ops::decode_lpca_bytes(device, shape) / sizeof(float), 0.0f);
  GuardedBuffer scratch(device, std::span<const float>(zeros), "sorted texels");
  ops::decode_lpca(device, shape, table.buffer(), slots.buffer(), a.buffer(), b.buffer(),
                   mean.buffer(), scratch.buffer(), out.buffer());
  EXPECT_TRUE(scratch.intact());
  const std::vector<float> values = out.values<float>();
  EXPECT_TRUE(out.intact());

  std::vector<double> expected(values.size());
  std::vector<double> magnitude(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t channel = i % c.channels;
    const std::size_t p = i / c.channels % texels;
    const std::size_t image = first + i / c.channels / texels;
    const std::size_t row = c.label[p] * n + image * c.channels + channel;
    expected[i] = means[row];
    magnitude[i] = std::abs(double{means[row]});
    for (std::size_t j = 0; j < c.rank; ++j) {
      const double term = double{A[p * c.rank + j]} * double{B[row * c.rank + j]};
      expected[i] += term;
      magnitude[i] += std::abs(term);
    }
  }
  const double unit = gamma(static_cast<double>(c.rank) + 1, float_roundoff);
  EXPECT_TRUE(all_near(values, expected, [&](std::size_t i) { return unit * magnitude[i]; }));
}

TEST(ClusterPanels, SmallHoldEveryTexelOnceClusterByCluster) {
  for (const std::size_t texels : Sizes{1, 23, 24, 25, 100}) {
    for (const std::size_t clusters : Sizes{1, 2, 7, 120}) {
      const auto label = scattered(texels, clusters);
      const ops::ClusterPanels panels = ops::cluster_panels(label, clusters, 24);
      EXPECT_LE(panels.count(), ops::most_cluster_panels(texels, clusters, 24));
      ASSERT_EQ(panels.order.size(), panels.count() * 24);
      ASSERT_EQ(panels.first.size(), clusters + 1);
      EXPECT_EQ(panels.first.back(), panels.count());
      std::set<std::uint32_t> seen;
      for (std::size_t g = 0; g < clusters; ++g) {
        for (std::size_t panel = panels.first[g]; panel < panels.first[g + 1]; ++panel) {
          EXPECT_EQ(panels.panels[2 * panel], g);
          for (std::size_t slot = 0; slot < 24; ++slot) {
            const std::uint32_t p = panels.order[panel * 24 + slot];
            EXPECT_EQ(label[p], g);
            if (slot < panels.panels[2 * panel + 1]) {
              EXPECT_EQ(panels.slots[p], panel * 24 + slot);
            }
            if (slot < panels.panels[2 * panel + 1]) {
              EXPECT_TRUE(seen.insert(p).second);
            }
          }
        }
      }
      EXPECT_EQ(seen.size(), texels);
    }
  }
}

TEST(DecodeLpca, SmallOfEachShape) {
  for (const std::size_t channels : Sizes{1, 2, 3}) {
    expect_decoded({3, channels, 2, 3, scattered(60, 3)}, 1, 2);
    expect_decoded({3, channels, 2, 2, in_runs(60, 2, 10)}, 0, 3);
  }
}

TEST(DecodeLpca, StraddlesVectorsPanelsAndBlocks) {
  for (const std::size_t channels : Sizes{1, 3, 4}) {
    for (const std::size_t texels : Sizes{1, 7, 8, 9, 23, 24, 25, 95, 97, 193}) {
      expect_decoded({3, channels, 5, 1, in_runs(texels, 1, 1)}, 0, 3);
      expect_decoded({3, channels, 5, 3, in_runs(texels, 3, 8)}, 0, 3);
      expect_decoded({3, channels, 5, 9, scattered(texels, 9)}, 0, 3);
      expect_decoded({3, channels, 5, texels, in_runs(texels, texels, 1)}, 0, 3);
    }
    for (const std::size_t images : Sizes{15, 16, 17, 33}) {
      expect_decoded({images, channels, 3, 4, scattered(50, 4)}, 0, images);
      expect_decoded({images, channels, 3, 4, scattered(50, 4)}, 2, images - 5);
    }
  }
}

TEST(DecodeLpca, AnyRank) {
  for (const std::size_t rank : Sizes{0, 1, 23, 24, 25, 64}) {
    expect_decoded({2, 3, rank, 4, scattered(70, 4)}, 0, 2);
  }
}

TEST(DecodeLpca, AnyMagnitude) {
  for (const double size : {1e-30, 1e30}) {
    expect_decoded({2, 3, 10, 4, scattered(70, 4)}, 0, 2, size);
  }
}

}  // namespace
}  // namespace weft::test
