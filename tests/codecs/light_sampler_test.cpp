// Directions to light drawn from models of every codec: they follow the density that is stated with
// them, which integrates to 1.
#include "weft/reference/light_sampler.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "codecs/codec_runs.hpp"
#include "model/random_vq.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/light_statistics.hpp"
#include "support/memory_btf.hpp"
#include "weft/reference/lookup.hpp"
#include "weft/reference/vq_light_sampler.hpp"
#include "weft/scene/light_sampling.hpp"

namespace weft::test {
namespace {

class LightSamplers : public testing::TestWithParam<CodecRun> {
 protected:
  Device* device() const { return GetParam().on_device ? &shared_device() : nullptr; }
};

INSTANTIATE_TEST_SUITE_P(Table, LightSamplers, testing::ValuesIn(every_run()), run_name);

// A matt ground and, about the mirror direction of each view, a highlight; one texel is black.
std::shared_ptr<MemorySource> glossy_source(Encoding encoding, Quantity quantity,
                                            DType dtype = DType::f32) {
  constexpr BtfShape shape{19, 37, 2, 3, 3};
  BtfInfo info = make_info(shape, dtype);
  info.encoding = encoding;
  info.quantity = quantity;
  std::vector<double> values;
  Random random(11);
  for (const Direction& v : info.view_directions) {
    for (const Direction& l : info.light_directions) {
      const double mirror = double{v[2] * l[2]} - double{v[0] * l[0]} - double{v[1] * l[1]};
      for (std::size_t texel = 0; texel < shape.texels(); ++texel) {
        const double gloss = std::pow(std::max(mirror, 0.0), 10 + 20 * static_cast<double>(texel));
        for (std::size_t c = 0; c < 3; ++c) {
          const double value = 0.05 + 0.1 * random.uniform() + 0.8 * gloss;
          values.push_back(texel == 4 ? 0 : value);
        }
      }
    }
  }
  return std::make_shared<MemorySource>(info, encode_values(values, dtype));
}

std::array<float, 3> view_at(double theta, double phi) {
  return direction_from_degrees(theta, phi);
}

// Of a few components; of vq, few nodes.
Parameters small_parameters(const std::string& codec) {
  if (codec == "vq") return {{"threshold", "0.1"}, {"slices", "6,5,3,6"}};
  return {{"rank", "4"}};
}

TEST_P(LightSamplers, FollowTheirDensity) {
  for (const auto& [encoding, quantity] : {std::pair{Encoding::linear, Quantity::radiance},
                                           std::pair{Encoding::srgb, Quantity::brdf}}) {
    const auto source = glossy_source(encoding, quantity);
    const auto model = GetParam().encode(*source, small_parameters(GetParam().codec), Storage::f16);
    const auto sampler = GetParam().get().light_sampler(device(), *model);
    for (const LightQuery& query :
         {LightQuery{view_at(0, 0), 0}, LightQuery{view_at(70, 200), 5}}) {
      SCOPED_TRACE(testing::Message() << name_of(encoding) << ", texel " << query.texel);
      expect_follows_density(*sampler, query);
    }
  }
}

// The sampler draws from what look-ups give: a model that holds the data as it is draws as the data
// do.
TEST_P(LightSamplers, AgreeWithRawData) {
  const auto source = glossy_source(Encoding::linear, Quantity::radiance);
  Parameters parameters{{"rank", "1000"}, {"atoms", "1024"}};
  if (GetParam().codec == "vq") parameters = {{"threshold", "0"}, {"grid", "measured"}};
  const auto model = GetParam().encode(*source, parameters, Storage::f32);
  EXPECT_EQ(GetParam().get().direct_light_sampler(device(), *model), nullptr);
  const double error = GetParam().measure(*model, *source).max_difference;
  const auto raw = reference::slice_light_sampler(source->info(), reference::tile_sampler(*source));
  const auto sampler = GetParam().get().light_sampler(device(), *model);
  Random random(5);
  std::vector<LightQuery> queries;
  std::vector<std::array<float, 3>> lights;
  for (int i = 0; i < 50; ++i) {
    queries.push_back({view_at(random.uniform(0, 90), random.uniform(0, 360)),
                       static_cast<std::uint32_t>(random.index(4))});
    lights.push_back(view_at(random.uniform(0, 90), random.uniform(0, 360)));
  }
  std::vector<float> expected(queries.size()), found(queries.size());
  raw->densities(queries, lights, expected);
  sampler->densities(queries, lights, found);
  // nodes move by the error at most, relative to their mean, which is that of 0.05 at least
  const double bound = 2 * error / 0.05 + 1e-4;
  for (std::size_t i = 0; i < queries.size(); ++i) {
    EXPECT_NEAR(found[i], expected[i], bound * (expected[i] + 1));
  }
  std::vector<float> albedos(3 * queries.size()), found_albedos(3 * queries.size());
  raw->albedos(queries, albedos);
  sampler->albedos(queries, found_albedos);
  for (std::size_t i = 0; i < albedos.size(); ++i) {
    EXPECT_GT(albedos[i], 0.05 * std::numbers::pi);
    EXPECT_NEAR(found_albedos[i], albedos[i], 2 * std::numbers::pi * error + 1e-4 * albedos[i]);
  }
}

// Drawn from code-books as they are: about where slices that are looked up say, too.
TEST(VqLightSampler, FollowsItsDensity) {
  for (const auto& [encoding, quantity] : {std::pair{Encoding::linear, Quantity::radiance},
                                           std::pair{Encoding::srgb, Quantity::brdf}}) {
    const auto source = glossy_source(encoding, quantity, DType::u8);
    Job job;
    const Codec& codec = find_codec("vq");
    const auto model = codec.encode_reference(
        *source, {{"threshold", "0.002"}, {"grid", "onion"}, {"slices", "9,9,4,8"}}, Storage::f32,
        job);
    const auto sampler = codec.light_sampler(nullptr, *model);
    const auto slices =
        reference::slice_light_sampler(model->info.btf, codec.reference_sampler(*model));
    for (const LightQuery& query : {LightQuery{view_at(0, 0), 0}, LightQuery{view_at(50, 200), 1},
                                    LightQuery{view_at(70, 100), 4}}) {
      SCOPED_TRACE(testing::Message() << name_of(encoding) << ", texel " << query.texel);
      expect_follows_density(*sampler, query);
      const std::vector<double> own = bin_shares(*sampler, query, 2, 4, 16);
      const std::vector<double> looked_up = bin_shares(*slices, query, 2, 4, 16);
      double distance = 0;
      for (std::size_t i = 0; i < own.size(); ++i) distance += std::abs(own[i] - looked_up[i]) / 2;
      EXPECT_LT(distance, 0.25);
    }
  }
}

// A model of onion slices under u8's sRGB.
std::unique_ptr<Model> onion_model(const OnionSizes& sizes, const BtfShape& shape) {
  auto model =
      std::make_unique<VqModel>(random_vq(shape, {VqGrid::Kind::onion, sizes}, small_sizes, 7));
  model->info.btf.encoding = Encoding::srgb;
  return model;
}

// Grids of few nodes, of many, and without some angles.
TEST(VqLightSampler, FollowsItsDensityInAnyGrid) {
  for (const OnionSizes& sizes : {OnionSizes{8, 4, 5, 6}, OnionSizes{1, 3, 2, 2},
                                  OnionSizes{5, 1, 9, 4}, OnionSizes{3, 2, 23, 17}}) {
    for (const std::size_t channels : Sizes{1, 3}) {
      const auto model = onion_model(sizes, {3, 4, 2, 2, channels});
      const auto sampler = find_codec("vq").direct_light_sampler(nullptr, *model);
      ASSERT_NE(sampler, nullptr);
      for (const LightQuery& query : {LightQuery{view_at(40, 350), 3}, LightQuery{{0, 0, 2}, 0},
                                      LightQuery{{1, 0, -1}, 1}, LightQuery{{0, 0, -1}, 2}}) {
        SCOPED_TRACE(testing::Message()
                     << sizes.alpha << " x " << sizes.beta << ", texel " << query.texel);
        expect_follows_density(*sampler, query);
      }
    }
  }
}

// Magnitudes of scales do not matter, nor do negative values; what is black is drawn by the cosine.
TEST(VqLightSampler, TakesAnyMagnitude) {
  const OnionSizes sizes{8, 4, 5, 6};
  const auto model = onion_model(sizes, {3, 4, 2, 2, 3});
  auto& vq = dynamic_cast<VqModel&>(*model);
  const auto densities = [&](const LightQuery& query) {
    return bin_shares(*find_codec("vq").direct_light_sampler(nullptr, vq), query, 2, 3, 8);
  };
  const LightQuery query{view_at(40, 350), 3};
  const std::vector<double> expected = densities(query);
  for (float& value : vq.p1) value *= 1e-30f;
  for (float& scale : vq.p4.scales) scale *= 1e30f;
  const std::vector<double> found = densities(query);
  for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 1e-4);
  for (float& value : vq.p1) value = -1;
  const std::vector<double> black = densities(query);
  const std::vector<double> elsewhere = densities({view_at(40, 350), 0});
  for (std::size_t i = 0; i < black.size(); ++i) EXPECT_EQ(black[i], elsewhere[i]);
  EXPECT_GT(black.back(), 1.3 * black.front());  // above, and on the horizon
}

// The threads of a large batch, and the batch, do not matter.
TEST(VqLightSampler, SameBitsWhateverTheThreads) {
  const auto model = onion_model({8, 4, 5, 6}, {3, 4, 2, 2, 3});
  const auto& vq = dynamic_cast<const VqModel&>(*model);
  Random random(2);
  constexpr std::size_t count = 9000;
  std::vector<LightQuery> queries;
  std::vector<std::array<float, 2>> numbers;
  for (std::size_t i = 0; i < count; ++i) {
    const auto texel = static_cast<std::uint32_t>(random.index(4));
    queries.push_back(i % 5 == 1 ? queries.back()
                                 : LightQuery{view_at(random.uniform(0, 90), 4.0 * texel), texel});
    numbers.push_back(
        {static_cast<float>(random.uniform(0, 0.99)), static_cast<float>(random.uniform(0, 0.99))});
  }
  std::vector<DrawnLight> expected(count), found(count);
  reference::vq_light_sampler(vq, 1)->sample(queries, numbers, expected);
  for (const std::size_t threads : Sizes{2, 3, 7}) {
    const auto sampler = reference::vq_light_sampler(vq, threads);
    sampler->sample(queries, numbers, found);
    for (std::size_t i = 0; i < count; ++i) {
      ASSERT_EQ(found[i].direction, expected[i].direction) << i;
      ASSERT_EQ(found[i].density, expected[i].density) << i;
    }
    sampler->sample(std::span(queries).last(1), std::span(numbers).last(1), found);
    EXPECT_EQ(found[0].direction, expected.back().direction);
  }
}

// Directions move little with their numbers: a small step of one moves them by no more than it
// takes where the density is least. Of either number, that is at least 0.1 x 0.1 of the defensive
// part in a range of which it takes at most 2 + pi / 10: the angle's slope is at most 240, and that
// of the other angle, which the shares of rows along it differ by, less than the square.
TEST(VqLightSampler, IsContinuousInItsNumbers) {
  constexpr std::size_t steps = std::size_t{1} << 19;
  const double largest = 240.0 * 240.0 / static_cast<double>(steps);
  const auto source = glossy_source(Encoding::srgb, Quantity::radiance, DType::u8);
  const auto model = CodecRun{"vq", true}.encode(
      *source, {{"threshold", "0.02"}, {"grid", "onion"}, {"slices", "9,9,4,8"}}, Storage::f32);
  const auto sampler = find_codec("vq").direct_light_sampler(nullptr, *model);
  ASSERT_NE(sampler, nullptr);
  const std::vector<LightQuery> queries(steps, LightQuery{view_at(50, 200), 5});
  std::vector<std::array<float, 2>> numbers(steps);
  std::vector<DrawnLight> drawn(steps);
  for (const std::size_t which : Sizes{0, 1}) {
    for (const float other : {0.05f, 0.37f, 0.9f}) {
      for (std::size_t i = 0; i < steps; ++i) {
        const float number = static_cast<float>(i) / static_cast<float>(steps);
        numbers[i] = which == 0 ? std::array{number, other} : std::array{other, number};
      }
      sampler->sample(queries, numbers, drawn);
      double jump = 0, range = 0;
      for (std::size_t i = 1; i < steps; ++i) {
        const auto distance = [&](const DrawnLight& a, const DrawnLight& b) {
          return std::hypot(a.direction[0] - b.direction[0], a.direction[1] - b.direction[1],
                            a.direction[2] - b.direction[2]);
        };
        jump = std::max(jump, double{distance(drawn[i], drawn[i - 1])});
        range = std::max(range, double{distance(drawn[i], drawn[0])});
      }
      EXPECT_LT(jump, std::min(largest, 0.12)) << which << ' ' << other;
      EXPECT_GT(range, 0.5) << which << ' ' << other;
    }
  }
}

TEST_P(LightSamplers, RefuseBadQueries) {
  const auto source = glossy_source(Encoding::linear, Quantity::radiance);
  const auto model = GetParam().encode(*source, small_parameters(GetParam().codec), Storage::f16);
  const auto sampler = GetParam().get().light_sampler(device(), *model);
  const auto draw = [&](const LightQuery& query, std::array<float, 2> numbers) {
    DrawnLight out;
    sampler->sample(std::span(&query, 1), std::span(&numbers, 1), std::span(&out, 1));
  };
  expect_error(ErrorKind::input, {"query 0", "texel 6 of 6"}, [&] {
    draw({view_at(0, 0), 6}, {0.5f, 0.5f});
  });
  expect_error(ErrorKind::input, {"query 0", "view (0, 0, 0)"}, [&] {
    draw({{0, 0, 0}, 0}, {0.5f, 0.5f});
  });
  expect_error(ErrorKind::input, {"query 0", "number 1"}, [&] {
    draw({view_at(0, 0), 0}, {0.5f, 1});
  });
  expect_error(ErrorKind::input, {"query 0", "number nan"}, [&] {
    draw({view_at(0, 0), 0}, {std::nanf(""), 0});
  });
}

}  // namespace
}  // namespace weft::test
