// Directions to light drawn from models of every codec: they follow the density that is stated with
// them, which integrates to 1.
#include "weft/reference/light_sampler.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "codecs/codec_runs.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/light_statistics.hpp"
#include "support/memory_btf.hpp"
#include "weft/reference/lookup.hpp"
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

TEST_P(LightSamplers, FollowTheirDensity) {
  for (const auto& [encoding, quantity] : {std::pair{Encoding::linear, Quantity::radiance},
                                           std::pair{Encoding::srgb, Quantity::brdf}}) {
    const auto source = glossy_source(encoding, quantity);
    const auto model = GetParam().encode(*source, {{"rank", "4"}}, Storage::f16);
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
  const auto model =
      GetParam().encode(*source, {{"rank", "1000"}, {"atoms", "1024"}}, Storage::f32);
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

TEST_P(LightSamplers, RefuseBadQueries) {
  const auto source = glossy_source(Encoding::linear, Quantity::radiance);
  const auto model = GetParam().encode(*source, {{"rank", "2"}}, Storage::f16);
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
