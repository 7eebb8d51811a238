// Slices made densities and drawn from on the device, against LightNodes in double, at sizes about
// the block of 64 entries.
#include "weft/ops/light_slices.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/btf/encoding.hpp"
#include "weft/ops/shade.hpp"
#include "weft/scene/light_nodes.hpp"

namespace weft::test {
namespace {

using Float4 = std::array<float, 4>;

// Rings down to the horizon, so that no light lies beyond them.
BtfInfo material(std::size_t channels, Encoding encoding, Quantity quantity) {
  BtfInfo info;
  for (int ring = 0; ring <= 3; ++ring) {
    for (int k = 0; k < std::max(6 * ring, 1); ++k) {
      info.light_directions.push_back(
          direction_from_degrees(30 * ring, 360.0 * k / std::max(6 * ring, 1)));
    }
  }
  info.view_directions = info.light_directions;
  const std::size_t n = info.light_directions.size();
  info.shape = {n, n, 3, 4, channels};
  info.encoding = encoding;
  info.quantity = quantity;
  return info;
}

// Slices as the reference has them.
struct Slices {
  std::vector<float> stored;  // [slices][lights][channels]
  std::vector<double> nodes;  // [slices][cells], 2 pi p
  std::vector<BilinearDensity> densities;
  std::vector<double> albedos;  // [slices][channels]
  double spread = 1;            // of the nodes of a slice, the largest over the least
};

Slices make_slices(const BtfInfo& info, const LightNodes& light_nodes, std::size_t count) {
  const std::size_t lights = info.shape.lights, channels = info.shape.channels;
  Slices slices;
  slices.stored = random_floats(count * lights * channels, 7, 0.5, 1);
  std::vector<double> luminances(lights), nodes(light_nodes.count()), linear(channels);
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<double> albedo(channels);
    for (std::size_t l = 0; l < lights; ++l) {
      for (std::size_t c = 0; c < channels; ++c) {
        const double value = slices.stored[(i * lights + l) * channels + c];
        linear[c] = decode_to_linear(info.encoding, value);
        albedo[c] += light_nodes.albedo_weights()[l] * linear[c];
      }
      luminances[l] = slice_luminance(linear);
    }
    light_nodes.gather(luminances, nodes);
    slices.densities.push_back(light_nodes.density(nodes));
    slices.albedos.insert(slices.albedos.end(), albedo.begin(), albedo.end());
    const std::size_t side = light_nodes.side();
    const auto [least, largest] = [&] {
      double low = 1e9, high = 0;
      for (std::size_t n = 0; n < light_nodes.count(); ++n) {
        const double at = slices.densities.back().at(
            {(static_cast<double>(n / side) + 0.5) / static_cast<double>(side),
             (static_cast<double>(n % side) + 0.5) / static_cast<double>(side)});
        slices.nodes.push_back(at);
        low = std::min(low, at);
        high = std::max(high, at);
      }
      return std::pair(low, high);
    }();
    slices.spread = std::max(slices.spread, largest / least);
  }
  return slices;
}

void check_slices(const BtfInfo& info, std::size_t count) {
  SCOPED_TRACE(testing::Message() << count << " slices of " << info.shape.channels << " channels, "
                                  << name_of(info.encoding));
  Device& device = shared_device();
  const LightNodes light_nodes(info.light_directions, info.quantity);
  const ops::DeviceLightNodes nodes(device, info, light_nodes);
  const std::size_t side = nodes.side(), cells = nodes.cells(), lights = nodes.lights();
  const Slices expected = make_slices(info, light_nodes, count);

  GuardedBuffer values(device, std::span<const float>(expected.stored), "values");
  GuardedBuffer luminances(device, count * lights * sizeof(float), "luminances");
  GuardedBuffer densities(device, count * cells * sizeof(float), "nodes");
  GuardedBuffer row_sums(device, count * side * sizeof(float), "row sums");
  if (is_simulator(device)) {
    // which takes a node's sum as uninitialised from the second term on: nodes are given
    const std::vector<float> given(expected.nodes.begin(), expected.nodes.end());
    std::vector<float> sums(count * side);
    for (std::size_t n = 0; n < given.size(); ++n) sums[n / side] += given[n];
    device.write(densities.buffer(), std::span<const float>(given));
    device.write(row_sums.buffer(), std::span<const float>(sums));
  } else {
    nodes.make_densities(device, count, values.buffer(), luminances.buffer(), densities.buffer(),
                         row_sums.buffer());
  }
  EXPECT_TRUE(luminances.intact());
  // sums of positive terms, of at most `lights` and `cells`, decoded within 16 ulps, or 32 of a sum
  // of three, and a dozen operations more
  const double relative = gamma(static_cast<double>(lights + cells + 64), float_roundoff);
  const double largest = *std::max_element(expected.nodes.begin(), expected.nodes.end());
  EXPECT_TRUE(all_near(densities.values<float>(), expected.nodes, relative * largest));
  EXPECT_TRUE(densities.intact());
  EXPECT_TRUE(row_sums.intact());

  GuardedBuffer albedos(device, count * info.shape.channels * sizeof(float), "albedos");
  nodes.albedos(device, count, values.buffer(), albedos.buffer());
  EXPECT_TRUE(all_near(albedos.values<float>(), expected.albedos, 4 * relative));
  EXPECT_TRUE(albedos.intact());

  // queries go through the slices more than once, in no order
  Random random(3);
  const std::size_t queries = 2 * count - 1;
  std::vector<std::uint32_t> slice_of;
  std::vector<std::array<float, 2>> numbers;
  std::vector<Float4> directions;
  for (std::size_t i = 0; i < queries; ++i) {
    slice_of.push_back(static_cast<std::uint32_t>(random.index(count)));
    numbers.push_back({static_cast<float>(random.index(1 << 24)) * 0x1p-24f,
                       static_cast<float>(random.index(1 << 24)) * 0x1p-24f});
    const auto d = direction_from_degrees(random.uniform(0, 89), random.uniform(0, 360));
    directions.push_back({d[0], d[1], i % 5 == 4 ? -d[2] : d[2], NAN});
  }
  GuardedBuffer slices(device, std::span<const std::uint32_t>(slice_of), "slices");
  GuardedBuffer asked(device, std::span<const std::array<float, 2>>(numbers), "numbers");
  GuardedBuffer drawn(device, queries * sizeof(Float4), "drawn");
  nodes.draw(device, queries, slices.buffer(), asked.buffer(), densities.buffer(),
             row_sums.buffer(), drawn.buffer());
  EXPECT_TRUE(drawn.intact());
  GuardedBuffer lit(device, std::span<const Float4>(directions), "directions");
  GuardedBuffer found(device, queries * sizeof(float), "densities");
  nodes.densities(device, queries, slices.buffer(), lit.buffer(), densities.buffer(),
                  found.buffer());
  EXPECT_TRUE(found.intact());

  // A share of the whole is rounded as sums of `side` terms are, and moves its place by that times
  // the mean over the least; the row's place moves the place in the row by its slope. A place's
  // error grows at most fourfold in the direction, and by the density's slope in the density.
  const double k = expected.spread, n = static_cast<double>(side);
  const double rounding = relative + gamma(static_cast<double>(4 * side + 20), float_roundoff);
  const double row = k * rounding, column = k * rounding + n * k * row;
  const double place_error = row + column + 4 * float_roundoff;
  const std::vector<Float4> draws = drawn.values<Float4>();
  const std::vector<float> stated = found.values<float>();
  for (std::size_t i = 0; i < queries; ++i) {
    const BilinearDensity& slice = expected.densities[slice_of[i]];
    const LightOfSlice light = draw_light(slice, {double{numbers[i][0]}, double{numbers[i][1]}});
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(draws[i][c], light.direction[c], 4 * place_error + 8 * float_roundoff) << i;
    }
    EXPECT_NEAR(draws[i][3], light.density, (relative + 2 * n * place_error) * largest) << i;
    const std::array<double, 3> d{double{directions[i][0]}, double{directions[i][1]},
                                  double{directions[i][2]}};
    EXPECT_NEAR(stated[i], light_density(slice, d),
                (relative + 2 * n * 16 * float_roundoff) * largest)
        << i;
  }
}

TEST(LightSlices, SmallOfEveryKind) {
  check_slices(material(3, Encoding::linear, Quantity::radiance), 3);
  check_slices(material(1, Encoding::srgb, Quantity::radiance), 2);
}

TEST(LightSlices, AgreeWithReference) {
  for (const std::size_t count : Sizes{1, 63, 64, 65, 200}) {
    check_slices(material(3, Encoding::srgb, Quantity::radiance), count);
  }
  check_slices(material(2, Encoding::gamma22, Quantity::radiance), 65);
}

TEST(LightSlices, SmallLookUpsAreOfEveryLight) {
  Device& device = shared_device();
  const BtfInfo info = material(3, Encoding::linear, Quantity::radiance);
  const LightNodes light_nodes(info.light_directions, info.quantity);
  const ops::DeviceLightNodes nodes(device, info, light_nodes);
  for (const std::size_t count : Sizes{1, 63, 64, 65}) {
    if (is_simulator(device) && count > 1) break;
    std::vector<std::uint32_t> texels, views;
    for (std::size_t i = 0; i < count; ++i) {
      texels.push_back(static_cast<std::uint32_t>(100 + i));
      for (std::size_t k = 0; k < 8; ++k) views.push_back(static_cast<std::uint32_t>(1000 * i + k));
    }
    GuardedBuffer texel_buffer(device, std::span<const std::uint32_t>(texels), "texels");
    GuardedBuffer view_buffer(device, std::span<const std::uint32_t>(views), "views");
    GuardedBuffer lookups(device, count * nodes.lights() * 8 * sizeof(std::uint32_t), "look-ups");
    nodes.write_lookups(device, count, texel_buffer.buffer(), view_buffer.buffer(),
                        lookups.buffer());
    const std::vector<std::uint32_t> found = lookups.values<std::uint32_t>();
    EXPECT_TRUE(lookups.intact());
    std::vector<std::uint32_t> wanted;
    for (std::size_t i = 0; i < count; ++i) {
      const auto v = static_cast<std::uint32_t>(1000 * i);
      for (std::uint32_t l = 0; l < nodes.lights(); ++l) {
        const auto texel = static_cast<std::uint32_t>(100 + i);
        wanted.insert(wanted.end(), {texel, v, v + 1, v + 2, l, v + 3, v + 4, v + 5});
      }
    }
    EXPECT_EQ(found, wanted);
  }
}

// Black slices, and values whose sums are beyond float.
TEST(LightSlices, ExtremesAreDrawnFrom) {
  Device& device = shared_device();
  const BtfInfo info = material(1, Encoding::linear, Quantity::radiance);
  const LightNodes light_nodes(info.light_directions, info.quantity);
  const ops::DeviceLightNodes nodes(device, info, light_nodes);
  const std::size_t lights = nodes.lights(), cells = nodes.cells();
  const std::vector<float> magnitudes{0.0f, 1e-44f, 1e-30f, 3e38f, -1.0f};
  std::vector<float> values;
  for (const float magnitude : magnitudes) values.insert(values.end(), lights, magnitude);
  GuardedBuffer stored(device, std::span<const float>(values), "values");
  GuardedBuffer luminances(device, values.size() * sizeof(float), "luminances");
  GuardedBuffer densities(device, magnitudes.size() * cells * sizeof(float), "nodes");
  GuardedBuffer row_sums(device, magnitudes.size() * nodes.side() * sizeof(float), "row sums");
  nodes.make_densities(device, magnitudes.size(), stored.buffer(), luminances.buffer(),
                       densities.buffer(), row_sums.buffer());
  const std::vector<float> found = densities.values<float>();
  std::vector<double> even(cells, 1.0);
  for (std::size_t i = 0; i < magnitudes.size(); ++i) {
    const bool black = !(magnitudes[i] > 1e-40f);
    const BilinearDensity expected = light_nodes.density(black ? std::vector<double>(cells) : even);
    const double side = static_cast<double>(nodes.side());
    for (std::size_t n = 0; n < cells; ++n) {
      const double row = static_cast<double>(n / nodes.side()) + 0.5;
      const double column = static_cast<double>(n % nodes.side()) + 0.5;
      EXPECT_NEAR(found[i * cells + n], expected.at({row / side, column / side}),
                  2 * gamma(static_cast<double>(lights + cells + 20), float_roundoff))
          << magnitudes[i];
    }
  }
}

}  // namespace
}  // namespace weft::test
