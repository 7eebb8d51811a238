// Larger textures by patches of small ones: where texels come from, borders that are hard to see,
// and models whose planar index grows.
#include "weft/reference/enlarge_vq.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "model/random_vq.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "weft/codecs/codec.hpp"

namespace weft::test {
namespace {

using reference::PatchRequest;
using reference::synthesise_patches;

// Smooth noise: neighbours are alike.
std::vector<float> waves(std::size_t height, std::size_t width) {
  std::vector<float> values;
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      const auto at = [&](double fx, double fy) {
        return std::sin(fx * static_cast<double>(x) + fy * static_cast<double>(y));
      };
      values.push_back(static_cast<float>(at(0.4, 0.1) + at(-0.15, 0.35)));
      values.push_back(static_cast<float>(at(0.2, -0.3)));
    }
  }
  return values;
}

TEST(Patches, KeepNeighboursTogether) {
  const std::size_t side = 40;
  PatchRequest request = reference::patch_request(side, side);
  EXPECT_EQ(request.patch, 10U);
  EXPECT_EQ(request.overlap, 2U);
  request.height = 57;
  request.width = 91;
  const auto texels = synthesise_patches(side, side, waves(side, side), request);
  ASSERT_EQ(texels.size(), 57U * 91U);
  std::size_t together = 0;
  for (std::size_t y = 0; y < 57; ++y) {
    for (std::size_t x = 0; x < 91; ++x) {
      const std::size_t p = texels[y * 91 + x];
      ASSERT_LT(p, side * side);
      if (x > 0 && texels[y * 91 + x - 1] + 1 == p) ++together;
    }
  }
  // all but those at the borders of patches, one in eight
  EXPECT_GE(together, 57 * 90 * 3 / 4);
  // the same again, and another of another seed
  EXPECT_EQ(synthesise_patches(side, side, waves(side, side), request), texels);
  request.seed = 1;
  EXPECT_NE(synthesise_patches(side, side, waves(side, side), request), texels);
}

// Neighbours differ hardly more than in the source; without a choice of pieces they do.
TEST(Patches, BordersAreHardToSee) {
  const std::size_t side = 64;
  const std::vector<float> source = waves(side, side);
  const auto mean_step = [&](std::size_t width, const auto& texel_at, std::size_t count) {
    double sum = 0;
    std::size_t steps = 0;
    for (std::size_t i = 0; i + 1 < count; ++i) {
      if (i % width + 1 == width) continue;
      sum += std::abs(double{source[2 * texel_at(i)]} - double{source[2 * texel_at(i + 1)]});
      ++steps;
    }
    return sum / static_cast<double>(steps);
  };
  const double original = mean_step(
      side, [](std::size_t i) { return i; }, side * side);
  PatchRequest request = reference::patch_request(side, side);
  request.height = request.width = 150;
  const auto quilted = synthesise_patches(side, side, source, request);
  request.pieces = 1;
  const auto random = synthesise_patches(side, side, source, request);
  const auto of = [&](const std::vector<std::size_t>& texels) {
    return mean_step(
        150, [&](std::size_t i) { return texels[i]; }, texels.size());
  };
  EXPECT_LE(of(quilted), 1.1 * original);
  EXPECT_GE(of(random), of(quilted));
}

TEST(Patches, RefuseWhatDoesNotFit) {
  const std::vector<float> source(20 * 10, 0.0f);
  const auto synthesise = [&](PatchRequest request) {
    return [&source, request] { synthesise_patches(20, 10, source, request); };
  };
  PatchRequest good{30, 30, 6, 2, 10, 0.1, 0};
  synthesise(good)();
  PatchRequest bad = good;
  bad.patch = 11;
  expect_error(ErrorKind::input, {"patches of 11", "10"}, synthesise(bad));
  bad = good;
  bad.overlap = 3;
  expect_error(ErrorKind::input, {"overlap of 3"}, synthesise(bad));
  bad = good;
  bad.width = 0;
  expect_error(ErrorKind::input, {"0 x 30"}, synthesise(bad));
  // a source of one texel gives what it has
  PatchRequest one = reference::patch_request(1, 1);
  one.height = one.width = 3;
  EXPECT_EQ(synthesise_patches(1, 1, std::vector<float>{0.5f}, one),
            std::vector<std::size_t>(9, 0));
}

TEST(EnlargeVq, TexelsAreThoseOfTheModel) {
  const BtfShape shape{3, 4, 12, 10, 3};
  VqModel model = random_vq(shape, VqGrid::measured(shape), small_sizes, 7);
  model.info.btf.mask.assign(shape.views * shape.texels(), 1);
  model.info.btf.mask[shape.texels() + 5] = 0;
  PatchRequest request = reference::patch_request(shape.height, shape.width);
  request.height = 31;
  request.width = 17;
  const auto large = reference::enlarge(model, request);
  EXPECT_EQ(large->info.btf.shape, (BtfShape{3, 4, 31, 17, 3}));
  EXPECT_EQ(large->info.btf.mask.size(), 3U * 31U * 17U);
  // every texel is one of the source
  std::vector<double> texel(3), other(3);
  for (const std::size_t p : Sizes{0, 100, 526}) {
    large->fitted_texel(1, 2, p / 17, p % 17, texel);
    bool found = false;
    for (std::size_t q = 0; q < shape.texels() && !found; ++q) {
      model.fitted_texel(1, 2, q / 10, q % 10, other);
      found = other == texel;
    }
    EXPECT_TRUE(found) << p;
  }
  const TemporaryFolder folder;
  write_model(folder / "m.weft", *large);
  EXPECT_EQ(read_model(folder / "m.weft")->info.btf.shape, large->info.btf.shape);
}

}  // namespace
}  // namespace weft::test
