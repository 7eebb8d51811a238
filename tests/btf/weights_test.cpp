// Weights of views, lights and texels, and the source that is multiplied with their roots.
#include "weft/btf/weights.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "weft/btf/view_source.hpp"
#include "weft/btf/weighted_source.hpp"

namespace weft::test {
namespace {

using List = std::vector<double>;

BtfInfo info_with_angles(Quantity quantity, Layout layout) {
  BtfInfo info =
      make_info({3, layout == Layout::paired ? std::size_t{1} : std::size_t{2}, 2, 2, 1});
  info.quantity = quantity;
  info.layout = layout;
  info.view_directions = {direction_from_degrees(0, 0), direction_from_degrees(60, 40),
                          direction_from_degrees(90, 10)};
  info.light_directions = {direction_from_degrees(60, 0), direction_from_degrees(90, 200)};
  if (layout == Layout::paired) info.light_directions.push_back(direction_from_degrees(0, 0));
  return info;
}

TEST(Weights, CosineIsTheProjectedArea) {
  const Weights radiance = cosine_weights(info_with_angles(Quantity::radiance, Layout::grid));
  EXPECT_TRUE(all_near(radiance.views, List{1, 0.5, 0}, 1e-7));
  EXPECT_EQ(radiance.views[2], 0) << "at 90 degrees";
  EXPECT_TRUE(radiance.lights.empty());
  const Weights brdf = cosine_weights(info_with_angles(Quantity::brdf, Layout::grid));
  EXPECT_TRUE(all_near(brdf.lights, List{0.25, 0}, 1e-7));
  EXPECT_EQ(brdf.lights[1], 0) << "at 90 degrees";
  const Weights pairs = cosine_weights(info_with_angles(Quantity::brdf, Layout::paired));
  EXPECT_TRUE(all_near(pairs.views, List{0.25, 0, 0}, 1e-7));
  EXPECT_TRUE(pairs.lights.empty());
}

TEST(Weights, ProductsAreElementWise) {
  const Weights a{{1, 2}, {}, {1, 2, 3, 4}};
  const Weights b{{3, 5}, {7, 8}, {}};
  const Weights product = a * b;
  EXPECT_EQ(product.views, (List{3, 10}));
  EXPECT_EQ(product.lights, (List{7, 8}));
  EXPECT_EQ(product.texels, a.texels);
}

TEST(Weights, SelectionsHaveTheMeanOne) {
  const BtfInfo info = make_info({4, 3, 2, 3, 1});
  const Weights weights{{1, 2, 3, 4}, {5, 5, 5}, {1, 2, 3, 4, 5, 6}};
  Selection selection;
  selection.views = {{3, 1}};
  selection.region = Region{1, 0, 2, 2};
  const Weights part = select(weights, info, selection);
  EXPECT_TRUE(all_near(part.views, List{4.0 / 3, 2.0 / 3}, 1e-15));
  EXPECT_TRUE(part.lights.empty()) << "equal weights are none";
  EXPECT_TRUE(all_near(part.texels, List{0.5, 0.75, 1.25, 1.5}, 1e-15));
  selection.level = 1;
  EXPECT_TRUE(select(weights, info, selection).texels.empty()) << "one texel";
  Selection level;
  level.level = 1;  // texels 0 1 3 4, and 2 5
  EXPECT_TRUE(all_near(select(weights, info, level).texels, List{3 / 3.75, 4.5 / 3.75}, 1e-7));
}

TEST(Weights, ZerosAreNotSelected) {
  const BtfInfo info = make_info({4, 3, 3, 4, 1});
  Weights weights;
  weights.views = {0, 1, 0, 2};
  weights.texels = {0, 0, 0, 0,  //
                    0, 2, 1, 0,  //
                    0, 4, 3, 0};
  const Selection all = without_zeros(weights, info, {});
  EXPECT_EQ(*all.views, (std::vector<std::size_t>{1, 3}));
  EXPECT_FALSE(all.lights);
  EXPECT_EQ(*all.region, (Region{1, 1, 2, 2}));
  Selection asked;
  asked.views = {{3, 2, 1}};
  asked.region = Region{2, 0, 2, 3};
  const Selection some = without_zeros(weights, info, asked);
  EXPECT_EQ(*some.views, (std::vector<std::size_t>{3, 1}));
  EXPECT_EQ(*some.region, (Region{2, 1, 1, 2}));
  // nothing to take out leaves a selection as it is
  EXPECT_TRUE(without_zeros({{1, 2, 3, 4}, {}, {}}, info, {}).selects_all());
}

TEST(Weights, ZerosMustLeaveSomething) {
  const BtfInfo info = make_info({2, 2, 3, 3, 1});
  Selection first;
  first.views = {{0}};
  expect_error(ErrorKind::input, {"weights", "views", "zero"}, [&] {
    without_zeros({{0, 1}, {}, {}}, info, first);
  });
  Weights hole;
  hole.texels = {1, 1, 1, 1, 0, 1, 1, 1, 1};
  expect_error(ErrorKind::input, {"row 1", "column 1", "rectangle"},
               [&] { without_zeros(hole, info, {}); });
  Selection centre;
  centre.region = Region{1, 1, 1, 1};
  expect_error(ErrorKind::input, {"texels", "zero"}, [&] { without_zeros(hole, info, centre); });
}

TEST(Weights, RowsAndColumnsOfProducts) {
  const std::vector<double> rows{2, 3, 0.5};
  const std::vector<double> columns{1, 4};
  std::vector<double> texels;
  for (const double row : rows) {
    for (const double column : columns) texels.push_back(row * column);
  }
  const auto split = rows_and_columns(texels, 3, 2);
  ASSERT_TRUE(split);
  for (std::size_t p = 0; p < texels.size(); ++p) {
    EXPECT_DOUBLE_EQ(split->first[p / 2] * split->second[p % 2], texels[p]);
  }
  texels[5] *= 1.0001;
  EXPECT_FALSE(rows_and_columns(texels, 3, 2));
}

// s (T - m), and where nothing is to be taken, s T; in runs of any length.
TEST(WeightedSource, MultipliesWithRoots) {
  const BtfShape shape{2, 3, 4, 5, 2};
  const Weights weights{{4, 0.25}, {1, 9, 16}, random_values(20, 3, 0.5, 2)};
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    const std::vector<std::byte> bytes = encode_values(random_values(shape.values(), 5), dtype);
    const std::vector<double> T = decode_values(bytes, dtype);
    MemorySource raw(make_info(shape, dtype), bytes, dtype == DType::f16);
    for (const bool centred : {false, true}) {
      WeightedSource source(raw, weights, centred, false);
      EXPECT_EQ(source.info().dtype, DType::f32);
      EXPECT_EQ(source.texel_scale().size(), centred ? shape.texels() : 0U);
      EXPECT_EQ(ViewSource(source, 1).texel_scale().size(), source.texel_scale().size());
      std::vector<std::byte> out(source.info().bytes());
      const std::size_t image = source.info().image_bytes();
      source.read(0, 4, std::span(out).first(4 * image));
      source.read(4, 2, std::span(out).subspan(4 * image));
      std::vector<double> expected(T.size());
      for (std::size_t i = 0; i < T.size(); ++i) {
        const std::size_t p = i / 2 % shape.texels();
        const std::size_t n = i / shape.image_values();
        double mean = 0;
        double sum = 0;
        for (std::size_t q = 0; q < shape.texels(); ++q) {
          mean += weights.texels[q] * T[n * shape.image_values() + q * 2 + i % 2];
          sum += weights.texels[q];
        }
        mean /= sum;
        const double w = weights.views[n / 3] * weights.lights[n % 3] * weights.texels[p];
        expected[i] = std::sqrt(w) * (T[i] - (centred ? mean : 0.0));
        if (centred) {
          EXPECT_NEAR(double{source.means()[n * 2 + i % 2]}, mean, 1e-7);
        }
      }
      // five roundings of values of at most 1, times the root
      EXPECT_TRUE(all_near(decode_values(out, DType::f32), expected,
                           5 * float_roundoff * std::sqrt(4.0 * 16.0 * 2.0)));
    }
  }
}

TEST(WeightedSource, EqualTexelsAreLeftToTheCodec) {
  MemorySource raw(make_info({1, 2, 2, 2, 1}), encode_values(random_values(8, 5), DType::f32));
  EXPECT_TRUE(WeightedSource(raw, {{}, {1, 2}, {}}, true, false).texel_scale().empty());
}

// A NaN stays one, to be named, and does not spread through the mean; or it counts as zero.
TEST(WeightedSource, NanHasNoPartInMeans) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  MemorySource raw(make_info({1, 1, 2, 2, 1}), encode_values(List{1, nan, 2, 3}, DType::f32));
  const Weights weights{{}, {}, {1, 1, 2, 4}};
  std::vector<std::byte> out(4 * sizeof(float));
  WeightedSource source(raw, weights, true, false);
  source.read(0, 1, out);
  const std::vector<double> kept = decode_values(out, DType::f32);
  EXPECT_TRUE(std::isnan(kept[1]));
  EXPECT_TRUE(std::isfinite(kept[0]) && std::isfinite(kept[3]));
  WeightedSource zeroed(raw, weights, true, true);
  zeroed.read(0, 1, out);
  const double mean = (1 + 0 + 4 + 12) / 8.0;
  EXPECT_TRUE(all_near(decode_values(out, DType::f32),
                       List{1 - mean, -mean, std::sqrt(2.0) * (2 - mean), 2 * (3 - mean)}, 1e-6));
}

}  // namespace
}  // namespace weft::test
