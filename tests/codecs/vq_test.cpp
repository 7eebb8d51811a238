// Multi-level vector quantisation: the same code-books from the device and the reference,
// thresholds that bound what they are for, onion slices, and what the order of texels covers.
#include "weft/model/vq.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "codecs/codec_runs.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "weft/reference/vq.hpp"

namespace weft::test {
namespace {

// Texels of a few kinds under lights and views all over the hemisphere: a highlight of the kind's
// width and the texel's brightness about the mirrored view, on a diffuse ground of its colour.
std::shared_ptr<MemorySource> glossy_source(std::size_t views, std::size_t lights,
                                            std::size_t height, std::size_t width,
                                            std::size_t channels) {
  const BtfShape shape{views, lights, height, width, channels};
  const BtfInfo info = make_info(shape, DType::f32);
  std::vector<double> values;
  for (std::size_t v = 0; v < views; ++v) {
    for (std::size_t l = 0; l < lights; ++l) {
      const Direction& view = info.view_directions[v];
      const Direction& light = info.light_directions[l];
      Direction half{view[0] + light[0], view[1] + light[1], view[2] + light[2]};
      const double norm = std::hypot(half[0], half[1], half[2]);
      for (std::size_t p = 0; p < shape.texels(); ++p) {
        const std::size_t kind = p % 3;
        const double brightness = 0.5 + 0.5 * static_cast<double>(p) / 100;
        const double gloss = std::pow(half[2] / norm, 4.0 * static_cast<double>(kind + 1));
        for (std::size_t c = 0; c < channels; ++c) {
          const double colour = c == 0 ? 1 : 0.1 * static_cast<double>(kind + c);
          values.push_back(brightness * light[2] * (0.3 * colour + (c == 0 ? gloss : 0)));
        }
      }
    }
  }
  return source_of(shape, DType::f32, values);
}

const VqModel& as_vq(const Model& model) {
  return dynamic_cast<const VqModel&>(model);
}

std::unique_ptr<Model> encode(bool on_device, TileSource& source, const Parameters& parameters) {
  return CodecRun{"vq", on_device}.encode(source, parameters, Storage::f32);
}

TEST(Vq, DeviceAndReferenceFindTheSameCodeBooks) {
  const auto source = glossy_source(20, 18, 6, 7, 3);
  for (const auto& [similarity, grid] :
       {std::pair{"mse", "measured"}, {"mse", "onion"}, {"ssim", "measured"}, {"ssim", "onion"}}) {
    Parameters parameters{{"threshold", "0.05"}, {"grid", grid}, {"similarity", similarity}};
    if (grid == std::string("onion")) parameters["slices"] = "7,5,4,6";
    SCOPED_TRACE(similarity);
    const auto device = encode(true, *source, parameters);
    const auto reference = encode(false, *source, parameters);
    const VqModel& a = as_vq(*device);
    const VqModel& b = as_vq(*reference);
    EXPECT_EQ(a.sizes, b.sizes) << grid;
    EXPECT_TRUE(std::equal(a.p6.entries.indices().begin(), a.p6.entries.indices().end(),
                           b.p6.entries.indices().begin(), b.p6.entries.indices().end()))
        << grid;
    EXPECT_LT(a.sizes.p4, 42U) << grid;
    // products in float by matrices whose rows' magnitudes sum to a few
    EXPECT_TRUE(
        all_near(CodecRun{"vq", false}.decode(a, 20), CodecRun{"vq", false}.decode(b, 20), 1e-4))
        << grid;
  }
}

// A texel's luminance is its code-vector's scaled; with every texel in the code-books, its error is
// within the sum of the levels' thresholds.
TEST(Vq, ThresholdsBoundErrors) {
  const BtfShape shape{5, 6, 8, 9, 3};
  const auto source = random_source(shape, DType::f32, 5, 0.2, 1.0);
  const std::vector<double> values = decode_values(source->bytes(), DType::f32);
  for (const bool on_device : {true, false}) {
    std::size_t entries = shape.texels() + 1;
    for (const double threshold : {0.01, 0.1, 0.3, 1.0}) {
      const auto model = encode(on_device, *source, {{"threshold", std::to_string(threshold)}});
      const std::vector<double> decoded = CodecRun{"vq", false}.decode(*model, 30);
      double squares = 0;
      for (std::size_t i = 0; i < values.size(); i += 3) squares += values[i] * values[i];
      const double luminance =
          std::sqrt(squares / static_cast<double>(shape.images() * shape.texels()));
      double bound = 0;
      for (int level = 0; level < 6; ++level) bound += threshold * std::pow(0.4, level / 2.0);
      for (std::size_t p = 0; p < shape.texels(); ++p) {
        double difference = 0;
        for (std::size_t i = 0; i < shape.images(); ++i) {
          for (std::size_t c = 0; c < 3; ++c) {
            const std::size_t at = (i * shape.texels() + p) * 3 + c;
            difference += std::pow(values[at] - decoded[at], 2);
          }
        }
        EXPECT_LE(std::sqrt(difference / static_cast<double>(3 * shape.images())),
                  1.05 * bound * luminance)
            << threshold;
      }
      EXPECT_LE(as_vq(*model).sizes.p4, entries) << threshold;
      entries = as_vq(*model).sizes.p4;
    }
    EXPECT_LT(entries, 8U);
  }
}

// An isotropic material is the same from every azimuth: in slices that turn with the view, one
// function of the view's elevation stands for all.
TEST(Vq, OnionSlicesTurnWithTheView) {
  const auto source = glossy_source(60, 60, 1, 1, 1);
  const auto model = encode(true, *source, {{"threshold", "0.05"}, {"grid", "onion"}});
  EXPECT_LE(as_vq(*model).sizes.p3, 2U);
  EXPECT_LE(relative(CodecRun{"vq", true}.measure(*model, *source)), 0.06);
}

// A planar index keeps the mean luminance of every texel.
TEST(Vq, MeansAreKept) {
  const BtfShape shape{4, 5, 6, 7, 1};
  const auto source = random_source(shape, DType::f32, 8, 0.1, 1.0);
  const std::vector<double> values = decode_values(source->bytes(), DType::f32);
  const auto model = encode(true, *source, {{"threshold", "0.5"}});
  const std::vector<double> decoded = CodecRun{"vq", false}.decode(*model, 20);
  for (std::size_t p = 0; p < shape.texels(); ++p) {
    double mean = 0, kept = 0;
    for (std::size_t i = 0; i < shape.images(); ++i) {
      mean += values[i * shape.texels() + p];
      kept += decoded[i * shape.texels() + p];
    }
    EXPECT_NEAR(kept, mean, 1e-5 * mean);
  }
}

// Images with a difference about every texel, on a ground that is even or rough, and that differs
// from texel to texel by the same noise.
std::shared_ptr<MemorySource> noisy_source(double roughness) {
  const BtfShape shape{3, 10, 12, 12, 1};
  const std::vector<double> noise = random_values(shape.values(), 6, -0.01, 0.01);
  std::vector<double> values(shape.values());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t p = i % shape.texels();
    values[i] = 0.5 + noise[i] + ((p + p / 12) % 2 == 0 ? roughness : -roughness);
  }
  values[0] = 1;
  return source_of(shape, DType::f32, values);
}

// A threshold of dissimilarity asks for less where texture hides differences, and for nothing less
// than what it is for where 0.
TEST(Vq, SimilarityLooksAtTheTexture) {
  for (const bool on_device : {true, false}) {
    const Parameters parameters{{"similarity", "ssim"}, {"threshold", "0.02"}};
    const auto even = encode(on_device, *noisy_source(0), parameters);
    const auto rough = encode(on_device, *noisy_source(0.3), parameters);
    EXPECT_GT(as_vq(*even).sizes.p4, 4 * as_vq(*rough).sizes.p4);
    std::size_t entries = 145;
    for (const char* const threshold : {"0", "0.001", "0.01", "0.1", "1.5"}) {
      const auto model =
          encode(on_device, *noisy_source(0), {{"similarity", "ssim"}, {"threshold", threshold}});
      EXPECT_LE(as_vq(*model).sizes.p4, entries) << threshold;
      entries = as_vq(*model).sizes.p4;
      if (threshold == std::string("0")) {
        EXPECT_EQ(entries, 144U);
        EXPECT_LT(relative(CodecRun{"vq", on_device}.measure(*model, *noisy_source(0))), 1e-6);
      }
    }
    EXPECT_EQ(entries, 1U);
    // thresholds for a goal
    const auto goal =
        encode(on_device, *noisy_source(0), {{"similarity", "ssim"}, {"target", "rel=0.014"}});
    EXPECT_LE(relative(CodecRun{"vq", on_device}.measure(*goal, *noisy_source(0))), 0.014);
    EXPECT_LT(as_vq(*goal).sizes.p4, 144U);
    EXPECT_GT(as_vq(*goal).sizes.p4, 1U);
  }
}

TEST(Vq, TrainingCoversTheImage) {
  VqRequest request;
  const BtfShape shape{1, 1, 200, 300, 1};
  const VqTraining training = vq_training(shape, request);
  EXPECT_EQ(training.first, 600U);
  ASSERT_EQ(training.texels.size(), 3000U);
  EXPECT_EQ(std::set<std::size_t>(training.texels.begin(), training.texels.end()).size(), 3000U);
  // each of 5 x 5 parts has its share, within a fifth of it
  std::vector<std::size_t> counts(25, 0);
  for (const std::size_t p : training.texels) ++counts[p / 300 / 40 * 5 + p % 300 / 60];
  for (const std::size_t count : counts) EXPECT_NEAR(static_cast<double>(count), 120, 24);
  // small images are taken whole
  EXPECT_EQ(vq_training({1, 1, 10, 20, 1}, request).texels.size(), 200U);
}

TEST(Vq, CodeVectorsBeyondMemoryAreRefused) {
  const auto source = random_source({16, 16, 16, 16, 3}, DType::f32, 5);
  Job job;
  job.memory = std::size_t{6} << 20;
  EXPECT_THROW(CodecRun({"vq", false}).encode(*source, {{"threshold", "0"}}, Storage::f32, job),
               Error);
}

}  // namespace
}  // namespace weft::test
