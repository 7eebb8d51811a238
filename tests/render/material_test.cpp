// Every preset of the library of materials, rendered on the device and by the reference.
#include "weft/scene/material.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "render/render_support.hpp"
#include "support/shared_device.hpp"

namespace weft::test {
namespace {

std::vector<std::string> preset_names() {
  std::vector<std::string> names;
  for (const MaterialPreset& preset : material_presets()) names.emplace_back(preset.name);
  return names;
}

class RenderedPreset : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Materials, RenderedPreset, testing::ValuesIn(preset_names()),
                         [](const auto& instance) { return instance.param; });

// Positions in single precision are off by about 1e-3 cells at the far end of a march. Over a cell
// of these reliefs a normal turns by up to 1, which a lobe of roughness 0.2 answers with 1/0.2 of
// its value: 5e-3 of it, and half as much again for the rest. At an outline the ray may pass on the
// other side: one in a hundred rays meets one of ten outlines on its way that near.
TEST_P(RenderedPreset, DeviceAndReferenceAgree) {
  const Material material = find_material(GetParam(), "--material");
  constexpr std::size_t side = 12;
  const Surface surface = make_surface(material, side, side);
  const BtfInfo info = render_info(side, side, even_directions(3), even_directions(4));
  Device& device = shared_device();
  const SurfaceRenderOptions options = render_options(1, 5);
  const std::vector<double> values = render_on_device(device, surface, info, options);
  const std::vector<double> expected = render_on_reference(surface, info, options);
  ASSERT_EQ(values.size(), expected.size());
  double sum = 0;
  std::size_t other = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    ASSERT_TRUE(std::isfinite(values[i]) && values[i] >= 0) << i << ": " << values[i];
    sum += expected[i];
    if (std::abs(values[i] - expected[i]) > 7.5e-3 * (expected[i] + 0.01)) ++other;
  }
  EXPECT_GT(sum, 0);
  EXPECT_LE(static_cast<double>(other), 0.01 * static_cast<double>(values.size()));
}

// Another seed is another piece of the same material: other pictures, and much the same light.
TEST_P(RenderedPreset, SeedChangesThePictureButNotTheMaterial) {
  Material material = find_material(GetParam(), "--material");
  const BtfInfo info = render_info(12, 12, even_directions(2), even_directions(3));
  Device& device = shared_device();
  const auto mean_of = [&] {
    const std::vector<double> values =
        render_on_device(device, make_surface(material, 12, 12), info, render_options(4));
    double sum = 0;
    for (const double value : values) sum += value;
    return sum;
  };
  const double first = mean_of();
  EXPECT_EQ(mean_of(), first);
  material.set_seed(material.seed() + 1);
  const double second = mean_of();
  EXPECT_NE(second, first);
  // Highlights of metal are few and strong.
  EXPECT_NEAR(second / first, 1, 0.35);
}

}  // namespace
}  // namespace weft::test
