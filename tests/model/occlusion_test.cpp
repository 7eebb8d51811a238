// Visibility and opacity of decoded masks, and error texels.
#include "weft/model/occlusion.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "support/expect_error.hpp"
#include "support/generators.hpp"

namespace weft::test {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

TEST(Occlusion, MapsAsEquation26Says) {
  const VisibilityMapping mapping{0.05, 12};
  EXPECT_EQ(mapping.alpha(-1), 0);
  EXPECT_EQ(mapping.alpha(0), 0);
  EXPECT_EQ(mapping.alpha(0.01), 0.12);
  EXPECT_EQ(mapping.alpha(std::nextafter(0.05, 0)), 12 * std::nextafter(0.05, 0));
  EXPECT_EQ(mapping.alpha(0.05), 1);
  EXPECT_EQ(mapping.alpha(3), 1);
  // never above 1, nor anything between 0 and 1 without a threshold
  EXPECT_EQ((VisibilityMapping{1, 4}.alpha(0.5)), 1);
  EXPECT_EQ((VisibilityMapping{0, 1}.alpha(1e-30)), 1);
  EXPECT_EQ((VisibilityMapping{0, 1}.alpha(-1e-30)), 0);
}

TEST(Occlusion, DefaultsAreThoseOfFigure7) {
  EXPECT_EQ(default_mapping(OcclusionKind::mask), (VisibilityMapping{0.5, 1}));
  EXPECT_EQ(default_mapping(OcclusionKind::distance), (VisibilityMapping{0.05, 12}));
}

TEST(Occlusion, MappingsThatMakeNoSenseAreRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  validate(VisibilityMapping{0, 1e-9}, "m");
  for (const double threshold : {-0.1, nan, infinity}) {
    expect_error(ErrorKind::input, {"net.weft", "threshold"}, [&] {
      validate(VisibilityMapping{threshold, 1}, "net.weft");
    });
  }
  for (const double weight : {0.0, -1.0, nan, infinity}) {
    expect_error(ErrorKind::input, {"net.weft", "weight"}, [&] {
      validate(VisibilityMapping{0.5, weight}, "net.weft");
    });
  }
}

TEST(Occlusion, KindsHaveNames) {
  for (const OcclusionKind kind : {OcclusionKind::mask, OcclusionKind::distance}) {
    EXPECT_EQ(occlusion_kind_from_name(name_of(kind), ""), kind);
  }
  expect_error(ErrorKind::input, {"--occlusion-of", "depth", "mask, distance"},
               [] { occlusion_kind_from_name("depth", "--occlusion-of"); });
}

// Counted by the definition of each kind, one by one.
TEST(Occlusion, CountsErrorTexels) {
  Random random(7);
  for (const std::size_t texels : {0, 1, 2, 97, 1000}) {
    std::vector<std::uint8_t> mask(texels);
    std::vector<float> values(texels);
    std::size_t by_sign = 0;
    std::size_t by_half = 0;
    for (std::size_t i = 0; i < texels; ++i) {
      mask[i] = random.uniform() < 0.6 ? 1 : 0;
      values[i] = i % 5 == 0 ? 0.5f : static_cast<float>(2 * random.uniform() - 1);
      if (i % 7 == 0) values[i] = 0;
      if ((values[i] > 0 ? 1 : 0) != mask[i]) ++by_sign;
      if ((values[i] < 0.5f ? 0 : 1) != mask[i]) ++by_half;
    }
    const ErrorTexels distances = count_error_texels(mask, values, OcclusionKind::distance);
    EXPECT_EQ(distances, (ErrorTexels{texels, by_sign}));
    EXPECT_EQ(count_error_texels(mask, values, OcclusionKind::mask),
              (ErrorTexels{texels, by_half}));
    EXPECT_EQ(distances.share(),
              texels == 0 ? 0 : static_cast<double>(by_sign) / static_cast<double>(texels));
  }
  EXPECT_EQ(count_error_texels({}, {}, OcclusionKind::mask).share(), 0);
  expect_error(ErrorKind::input, {"3 decoded values", "mask of 2"}, [] {
    count_error_texels(std::vector<std::uint8_t>(2), std::vector<float>(3), OcclusionKind::mask);
  });
}

}  // namespace
}  // namespace weft::test
