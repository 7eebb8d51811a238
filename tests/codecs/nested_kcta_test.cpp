// Models that are cut of one clustered fit: their errors as foreseen and as they are, their order,
// multiples of --align, modes that are whole, and what a goal takes over from one fit to the next.
#include "weft/codecs/nested_kcta.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "codecs/codec_runs.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "weft/codecs/fit_kcta.hpp"
#include "weft/codecs/kcta_options.hpp"
#include "weft/model/kcta.hpp"

namespace weft::test {
namespace {

const BtfShape shape{11, 4, 9, 7, 3};

const KctaModel& as_kcta(const Model& model) {
  return dynamic_cast<const KctaModel&>(model);
}

// Decaying values in every mode.
std::shared_ptr<MemorySource> decaying_source() {
  Random random(17);
  std::vector<double> values;
  for (std::size_t v = 0; v < shape.views; ++v) {
    for (std::size_t l = 0; l < shape.lights; ++l) {
      for (std::size_t y = 0; y < shape.height; ++y) {
        for (std::size_t x = 0; x < shape.width; ++x) {
          for (std::size_t c = 0; c < shape.channels; ++c) {
            const double at = static_cast<double>(v * (l + 1)) * 0.2 +
                              static_cast<double>(y * (v + 3)) * 0.07 +
                              static_cast<double>(x * (c + 2)) * 0.11;
            values.push_back(0.5 + 0.3 * std::sin(at) + 0.05 * random.normal());
          }
        }
      }
    }
  }
  return source_of(shape, DType::f32, values);
}

class NestedClusterModels : public testing::TestWithParam<bool> {
 protected:
  std::unique_ptr<NestedModels> nested(const char* codec, const Parameters& parameters,
                                       const NestedRequest& request) {
    Job job;
    return find_codec(codec).nested(GetParam() ? &shared_device() : nullptr, *source_, parameters,
                                    request, job);
  }
  double error(const Model& model) const {
    return relative(CodecRun{model.info.codec, GetParam()}.measure(model, *source_));
  }

  std::shared_ptr<MemorySource> source_ = decaying_source();
};

INSTANTIATE_TEST_SUITE_P(Both, NestedClusterModels, testing::Bool(),
                         [](const auto& info) { return info.param ? "Device" : "Reference"; });

// Orthonormal bases and mixing matrices of slices that have one cluster each: what is cut is what
// is lost. Float arithmetic of the fit and of its squares resolves errors to about sqrt(n eps).
TEST_P(NestedClusterModels, HaveTheErrorsThatWereForeseen) {
  NestedRequest request;
  request.relative = 0.05;
  request.storage = Storage::f32;
  for (const Parameters& parameters :
       {Parameters{}, Parameters{{"global", "none"}}, Parameters{{"global", "lc,y"}},
        Parameters{{"merge", "none"}, {"mode", "l"}}, Parameters{{"mode", "y"}}}) {
    const auto models = nested("cta", parameters, request);
    ASSERT_GT(models->count(), 10U);
    for (std::size_t i = 0; i < models->count(); i += 5) {
      EXPECT_NEAR(error(*models->model(i)), models->error(i), 1e-3 * models->error(i) + 1e-4) << i;
    }
    EXPECT_NEAR(error(*models->model(models->count() - 1)), models->error(models->count() - 1),
                1e-3 * models->error(models->count() - 1) + 1e-4);
  }
}

TEST_P(NestedClusterModels, AreInOrder) {
  NestedRequest request;
  request.relative = 0.04;
  for (const char* codec : {"cta", "kcta"}) {
    const auto models = nested(codec, Parameters(), request);
    for (std::size_t i = 0; i < models->count(); ++i) {
      if (i > 0) {
        EXPECT_GE(models->values(i), models->values(i - 1));
        EXPECT_LE(models->error(i), models->error(i - 1));
      }
      const auto model = models->model(i);
      std::size_t numbers = 0;
      for (const std::span<float> values : model->real_values()) numbers += values.size();
      EXPECT_EQ(numbers, models->values(i)) << i;
      EXPECT_NE(model->info.parameters.find("\"ranks\""), std::string::npos);
    }
    // with mixtures the foreseen errors leave products of clusters out
    const auto middle = models->model(models->count() / 2);
    EXPECT_NEAR(error(*middle) / models->error(models->count() / 2), 1, 0.15) << codec;
  }
}

TEST_P(NestedClusterModels, KeepRanksThatAreGivenAndMultiples) {
  NestedRequest request;
  request.relative = 0.01;
  const auto models = nested("kcta", {{"ranks", "v=2,y=6"}, {"align", "2"}}, request);
  for (std::size_t i = 0; i < models->count(); ++i) {
    const auto made = models->model(i);
    const KctaModel& model = as_kcta(*made);
    const std::vector<std::size_t> sizes = model.groups.sizes();
    EXPECT_EQ(model.ranks[0], 2U);
    EXPECT_LE(model.ranks[2], 6U);
    for (std::size_t n = 1; n < sizes.size(); ++n) {
      EXPECT_TRUE(model.ranks[n] % 2 == 0 || model.ranks[n] == sizes[n]) << n;
    }
  }
  const auto clustered = nested("cta", {{"clusters", "3"}}, request);
  EXPECT_EQ(as_kcta(*clustered->model(0)).clusters, 3U);
  Job job;
  expect_error(ErrorKind::input, {"--threshold 0.2", "--target"}, [&] {
    nested("cta", {{"threshold", "0.2"}}, request);
  });
}

TEST_P(NestedClusterModels, SayWhatForbidsMore) {
  NestedRequest request;
  request.relative = 1e-9;
  request.growth = 100;
  const auto bound = nested("cta", {{"ranks", "y=5"}, {"clusters", "2"}}, request);
  EXPECT_TRUE(bound->complete());
  EXPECT_NE(bound->bound().find("y=5"), std::string::npos) << bound->bound();
  EXPECT_NE(bound->bound().find("--clusters 2"), std::string::npos) << bound->bound();
  const auto all = nested("cta", {}, request);
  EXPECT_TRUE(all->complete());
  EXPECT_LT(error(*all->model(all->count() - 1)), 1e-3);
  request.relative = 0.3;
  request.growth = 1;
  EXPECT_FALSE(nested("cta", {}, request)->complete());
}

// What is cut of a fit and fitted again, with ranks that stay and ranks that do not: errors are
// those that the fit says, and no larger than those of what it began with.
TEST_P(NestedClusterModels, FitsFromACutModelAreBetter) {
  Job job;
  bool lights_stay = false;
  bool lights_go = false;
  for (const Parameters& parameters :
       {Parameters{{"clusters", "3"}}, Parameters{{"clusters", "3"}, {"global", "lc,y"}},
        Parameters{{"clusters", "3"}, {"global", "none"}, {"merge", "none"}}}) {
    const Codec& codec = find_codec("kcta");
    KctaRequest request = kcta_options(codec, parameters, source_->info());
    const std::size_t lights = request.groups.group_of(Mode::light);
    request.ranks[lights] = 7 * request.groups.groups()[lights].size / 12;
    const auto encoder = GetParam() ? kcta_encoder(shared_device(), *source_, request, job)
                                    : reference::kcta_encoder(*source_, request, job);
    NestedClusters made;
    made.fit = encoder->fit();
    made.fit.model->info.codec = codec.name();
    made.fit.model->info.btf = source_->info();
    made.global = request.global_mode;
    made.parameters = [](const KctaModel&, double) { return std::string("{}"); };
    const auto models = nested_clusters(std::move(made));
    for (std::size_t i = 1; i < models->count(); i += models->count() / 5) {
      const auto start = models->model(i);
      (as_kcta(*start).ranks[lights] == request.ranks[lights] ? lights_stay : lights_go) = true;
      KctaFit fit = encoder->refit(as_kcta(*start), 4);
      fit.model->info = start->info;
      EXPECT_EQ(fit.model->ranks, as_kcta(*start).ranks);
      const double left =
          std::sqrt((fit.errors.lost + fit.errors.history.back()) / fit.errors.squares);
      EXPECT_NEAR(error(*fit.model), left, 1e-3 * left + 1e-4);
      EXPECT_LE(left, 1.01 * error(*start) + 1e-4);
    }
  }
  EXPECT_TRUE(lights_go);
  EXPECT_TRUE(lights_stay);
}

TEST_P(NestedClusterModels, TakeSpectraOver) {
  NestedRequest request;
  request.relative = 0.1;
  const auto first = nested("kcta", {}, request);
  ASSERT_NE(first->spectra(), nullptr);
  request.spectra = first->spectra();
  const auto again = nested("kcta", {}, request);
  EXPECT_EQ(again->spectra(), first->spectra());
  EXPECT_EQ(again->count(), first->count());
}

}  // namespace
}  // namespace weft::test
