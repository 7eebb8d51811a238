// The search for list lengths and the rank of `sparse`: by itself, with an encoder whose errors are
// known, and on the device and by the reference.
#include "weft/codecs/sparse_goal.hpp"

#include <fmt/core.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "codecs/codec_runs.hpp"
#include "codecs/sparse_source.hpp"
#include "model/random_sparse.hpp"
#include "support/expect_error.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "weft/codecs/fit_sparse.hpp"
#include "weft/error.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/storage.hpp"

namespace weft::test {
namespace {

// Errors by formulas; its models have the lengths asked for, of random numbers.
class MadeUpEncoder final : public SparseEncoder {
 public:
  static constexpr BtfShape shape{5, 4, 10, 9, 3};
  static constexpr std::size_t light_atoms = 30;
  static constexpr std::size_t abrdf_atoms = 25;

  // |A - A_r| / |T|
  std::function<double(std::size_t rank)> projection = [](std::size_t) { return 0.01; };
  std::size_t data_rank = 5000;
  std::size_t most_rank_held = 5000;  // by the memory
  std::vector<std::size_t> ranks;     // asked for
  std::size_t refits = 0;

  static double view_squares(std::size_t k1) {
    return 0.3 * std::exp(-0.5 * static_cast<double>(k1));
  }
  static double texel_squares(std::size_t k2) { return 0.4 / static_cast<double>(k2 + 1); }
  static double squares(std::size_t k1, std::size_t k2) {
    return view_squares(k1) + texel_squares(k2);
  }
  static std::size_t list_bytes(std::size_t k1, std::size_t k2) {
    return 3 * (abrdf_atoms * shape.views * k1 + shape.texels() * k2);
  }

  void project(std::size_t rank) override {
    if (rank > most_rank_held) fail_input("{} components take too much", rank);
    ranks.push_back(rank);
  }
  std::size_t rank() const override { return std::min(ranks.back(), data_rank); }
  double projection_error() const override { return projection(rank()); }
  SparseFit fit(std::size_t k1, std::size_t k2, std::size_t iterations) override {
    longest_ = {k1, k2};
    --refits;
    return refit(k1, k2, iterations);
  }
  SparseLengthErrors length_errors() override {
    SparseLengthErrors errors;
    for (std::size_t k = 0; k <= longest_.first; ++k) errors.views.push_back(view_squares(k));
    for (std::size_t k = 0; k <= longest_.second; ++k) errors.texels.push_back(texel_squares(k));
    return errors;
  }
  SparseFit refit(std::size_t k1, std::size_t k2, std::size_t) override {
    ++refits;
    SparseFit fit;
    fit.model =
        std::make_unique<SparseModel>(random_sparse(shape, {light_atoms, abrdf_atoms, k1, k2}));
    fit.rank = rank();
    return fit;
  }

 private:
  std::pair<std::size_t, std::size_t> longest_;
};

SparseOptions made_up_options(FitGoal::Kind kind, double value) {
  SparseOptions options;
  options.view_terms = 16;
  options.texel_terms = 20;
  options.light_atoms = MadeUpEncoder::light_atoms;
  options.abrdf_atoms = MadeUpEncoder::abrdf_atoms;
  options.most_rank = 1024;
  options.goal.kind = kind;
  options.goal.relative = value;
  options.goal.bytes = static_cast<std::size_t>(value);
  options.goal.text = fmt::format("goal={}", value);
  return options;
}

SparseFit search(MadeUpEncoder& encoder, const SparseOptions& options,
                 const std::function<double(std::size_t k1, std::size_t k2)>& error) {
  Job job;
  return fit_sparse(
      encoder, make_info(MadeUpEncoder::shape, DType::f16), options,
      [&](const SparseModel& model) { return error(model.views.length, model.texels.length); },
      job);
}

// Where fits are better or worse than foreseen, but in the same order, no smaller model meets it.
TEST(SparseSearch, ErrorsAreMetByTheFewestBytes) {
  for (const double part : {0.7, 1.0, 1.01, 1.15}) {
    const auto error = [&](std::size_t k1, std::size_t k2) {
      return part * std::sqrt(1e-4 + MadeUpEncoder::squares(k1, k2));
    };
    for (double goal = 0.85; goal > error(16, 20); goal *= 0.97) {
      SCOPED_TRACE(fmt::format("{} of what was foreseen, {}", part, goal));
      MadeUpEncoder encoder;
      const SparseFit fit = search(encoder, made_up_options(FitGoal::Kind::relative, goal), error);
      const std::size_t k1 = fit.model->views.length;
      const std::size_t k2 = fit.model->texels.length;
      EXPECT_LE(error(k1, k2), goal);
      std::size_t fewest = MadeUpEncoder::list_bytes(16, 20);
      for (std::size_t i = 1; i <= 16; ++i) {
        for (std::size_t j = 1; j <= 20; ++j) {
          if (error(i, j) <= goal) fewest = std::min(fewest, MadeUpEncoder::list_bytes(i, j));
        }
      }
      EXPECT_EQ(MadeUpEncoder::list_bytes(k1, k2), fewest);
      EXPECT_LE(encoder.refits, 3U);
    }
    // none meets it: the last was tried
    MadeUpEncoder encoder;
    expect_error(ErrorKind::unmet_goal,
                 {"k1 = 16, k2 = 20", fmt::format("{:.4g}", error(16, 20)), "--k1"}, [&] {
                   search(encoder, made_up_options(FitGoal::Kind::relative, error(16, 20) * 0.999),
                          error);
                 });
  }
}

// Errors that go up and down: the search ends, at a model that meets the goal.
TEST(SparseSearch, ErrorsThatDoNotFollowAreStillMet) {
  const auto error = [](std::size_t k1, std::size_t k2) {
    return std::sqrt(1e-4 + MadeUpEncoder::squares(k1, k2)) *
           (1 + 0.2 * std::sin(static_cast<double>(5 * k1 + 3 * k2)));
  };
  for (double goal = 0.7; goal > 0.25; goal *= 0.95) {
    MadeUpEncoder encoder;
    const SparseFit fit = search(encoder, made_up_options(FitGoal::Kind::relative, goal), error);
    EXPECT_LE(error(fit.model->views.length, fit.model->texels.length), goal);
    EXPECT_LE(encoder.refits, 10U);
  }
}

// The least error foreseen within the size.
TEST(SparseSearch, SizesTakeTheBestThatFits) {
  SparseModel shortest = random_sparse(
      MadeUpEncoder::shape, {MadeUpEncoder::light_atoms, MadeUpEncoder::abrdf_atoms, 1, 1});
  shortest.info.storage = Storage::f16;
  round_to_storage(shortest);
  const std::size_t fixed = model_file_size(shortest) - MadeUpEncoder::list_bytes(1, 1);
  for (std::size_t lists = 1400; lists < 11000; lists += 531) {
    MadeUpEncoder encoder;
    const std::size_t allowed = fixed + lists;
    const SparseFit fit =
        search(encoder, made_up_options(FitGoal::Kind::size, static_cast<double>(allowed)),
               [](std::size_t, std::size_t) { return 1.0; });
    const std::size_t k1 = fit.model->views.length;
    const std::size_t k2 = fit.model->texels.length;
    EXPECT_LE(model_file_size(*fit.model), allowed);
    EXPECT_EQ(encoder.refits, 1U);
    // 512 bytes are kept for the header
    for (std::size_t i = 1; i <= 16; ++i) {
      for (std::size_t j = 1; j <= 20; ++j) {
        if (MadeUpEncoder::list_bytes(i, j) + 640 <= lists) {
          EXPECT_LE(MadeUpEncoder::squares(k1, k2), MadeUpEncoder::squares(i, j));
        }
      }
    }
  }
}

// The rank is doubled while the projection makes more than half of the squared error, and no
// further.
TEST(SparseSearch, RanksFollowTheGoal) {
  const auto ranks = [](const SparseOptions& options, double at_300, double at_600, double at_1024,
                        std::size_t data_rank = 5000) {
    MadeUpEncoder encoder;
    encoder.data_rank = data_rank;
    encoder.projection = [=](std::size_t rank) {
      return rank <= 300 ? at_300 : rank <= 600 ? at_600 : at_1024;
    };
    try {
      search(encoder, options, [](std::size_t, std::size_t) { return 0.1; });
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::unmet_goal);
      encoder.ranks.push_back(0);
    }
    return encoder.ranks;
  };
  SparseOptions options = made_up_options(FitGoal::Kind::relative, 0.2);
  // half of 0.2^2 is 0.1414^2
  EXPECT_EQ(ranks(options, 0.1413, 0.1, 0.05), (Sizes{300}));
  EXPECT_EQ(ranks(options, 0.1415, 0.1, 0.05), (Sizes{300, 600}));
  EXPECT_EQ(ranks(options, 0.3, 0.1415, 0.05), (Sizes{300, 600, 1024}));
  // between half of the goal and the goal
  EXPECT_EQ(ranks(options, 0.3, 0.2, 0.199), (Sizes{300, 600, 1024}));
  EXPECT_EQ(ranks(options, 0.3, 0.25, 0.2), (Sizes{300, 600, 1024, 0}));
  // data of fewer components
  EXPECT_EQ(ranks(options, 0.3, 0.15, 0.05, 450), (Sizes{300, 600}));
  options.most_rank = 500;
  EXPECT_EQ(ranks(options, 0.3, 0.15, 0.05), (Sizes{300, 500}));
  options.most_rank = 0;
  EXPECT_EQ(ranks(options, 0.19, 0.15, 0.05), (Sizes{300}));

  options = made_up_options(FitGoal::Kind::size, 1e6);
  const double left = std::sqrt(MadeUpEncoder::squares(16, 20));
  EXPECT_EQ(ranks(options, 0.999 * left, 0.1, 0.1), (Sizes{300}));
  EXPECT_EQ(ranks(options, 1.001 * left, 0.1, 0.1), (Sizes{300, 600}));
  EXPECT_EQ(ranks(options, 2 * left, 1.001 * left, 0.1), (Sizes{300, 600, 1024}));
}

TEST(SparseSearch, RanksBeyondTheMemoryAreRefused) {
  for (const auto& [kind, value] :
       {std::pair(FitGoal::Kind::relative, 0.5), std::pair(FitGoal::Kind::size, 1e6)}) {
    MadeUpEncoder encoder;
    encoder.projection = [](std::size_t) { return 0.4; };
    encoder.most_rank_held = 599;
    expect_error(ErrorKind::input, {"--target goal", "600 components", "--rank 300", "too much"},
                 [&] {
                   search(encoder, made_up_options(kind, value),
                          [](std::size_t, std::size_t) { return 0.1; });
                 });
  }
}

class SparseGoal : public testing::TestWithParam<bool> {
 protected:
  CodecRun run() const { return {"sparse", GetParam()}; }
  double reached_with(const Parameters& chosen, TileSource& source,
                      std::size_t* bytes = nullptr) const {
    const auto model = run().encode(source, chosen, Storage::f16);
    if (bytes != nullptr) *bytes = model_file_size(*model);
    return relative(run().measure(*model, source));
  }
};

INSTANTIATE_TEST_SUITE_P(Paths, SparseGoal, testing::Bool(), [](const auto& info) {
  return info.param ? std::string("Device") : std::string("Reference");
});

// The best that fits: within the size, and using it but for one more term.
TEST_P(SparseGoal, SizesAreKept) {
  const auto source = sparse_source(sparse_material);
  double before = 1;
  for (const std::size_t allowed : Sizes{9000, 12000, 16000}) {
    std::size_t bytes = 0;
    const double error = reached_with(
        {{"atoms", "24,20"}, {"iterations", "8"}, {"target", "size=" + std::to_string(allowed)}},
        *source, &bytes);
    EXPECT_LE(bytes, allowed);
    // k2 takes 3 bytes a texel, and the header some
    EXPECT_GT(bytes, allowed - 20 * 18 * 3 - 600);
    EXPECT_LT(error, before);
    before = error;
  }
}

TEST_P(SparseGoal, RelativeErrorsAreMet) {
  const auto source = sparse_source(sparse_material);
  std::size_t coarse = 0;
  std::size_t fine = 0;
  const double half =
      reached_with({{"atoms", "40"}, {"iterations", "4"}, {"target", "rel=0.5"}}, *source, &coarse);
  const double third =
      reached_with({{"atoms", "40"}, {"iterations", "4"}, {"target", "rel=0.3"}}, *source, &fine);
  EXPECT_LE(half, 0.5);
  EXPECT_LE(third, 0.3);
  EXPECT_LT(coarse, fine);
}

// Where errors fall slowly with the terms, what is reached is near the goal.
TEST_P(SparseGoal, RelativeErrorsAreNotFarBetterThanAsked) {
  const auto source = sparse_source(sparse_material, 1.0);
  for (const char* goal : {"0.7", "0.62"}) {
    const double wanted = std::stod(goal);
    const double reached = reached_with(
        {{"atoms", "40"}, {"iterations", "3"}, {"target", std::string("rel=") + goal}}, *source);
    EXPECT_LE(reached, wanted);
    EXPECT_GT(reached, 0.97 * wanted);
  }
}

TEST_P(SparseGoal, UnmetOnesSayWhatWasReached) {
  const auto source = sparse_source(sparse_material);
  expect_error(ErrorKind::unmet_goal, {"--target size=3000", "3000 are allowed", "--atoms"}, [&] {
    reached_with({{"atoms", "24,20"}, {"iterations", "2"}, {"target", "size=3000"}}, *source);
  });
  expect_error(ErrorKind::unmet_goal, {"--target rel=0.1", "k1 = 1, k2 = 1", "--atoms"}, [&] {
    reached_with(
        {{"atoms", "8"}, {"k1", "1"}, {"k2", "1"}, {"iterations", "2"}, {"target", "rel=0.1"}},
        *source);
  });
  expect_error(ErrorKind::unmet_goal, {"--target rel=0.02: ", "2 components", "--rank"}, [&] {
    reached_with({{"rank", "2"}, {"target", "rel=0.02"}}, *source);
  });
  const auto flat =
      source_of({2, 3, 4, 5, 3}, DType::f32, std::vector<double>(2 * 3 * 20 * 3, 0.5));
  expect_error(ErrorKind::unmet_goal, {"--target size=100", "mean", "100 are allowed"}, [&] {
    reached_with({{"target", "size=100"}}, *flat);
  });
  EXPECT_EQ(reached_with({{"target", "size=10000"}}, *flat), 0);
  EXPECT_EQ(reached_with({{"target", "rel=0.1"}}, *flat), 0);
}

TEST(SparseGoals, DoNotDependOnTheMemory) {
  const auto source = sparse_source(sparse_material);
  SparseOptions options;
  options.light_atoms = 24;
  options.abrdf_atoms = 20;
  options.iterations = 8;
  options.rank = 2;
  options.most_rank = 12;
  options.goal.kind = FitGoal::Kind::size;
  options.goal.bytes = 16000;
  options.goal.text = "size=16000";
  const auto fit = [&](std::size_t memory) {
    Job job;
    job.memory = memory;
    return fit_sparse(shared_device(), *source, options, job);
  };
  const auto needed = [&](std::size_t rank) {
    SparseOptions raised = options;
    raised.rank = rank;
    return plan_sparse(shared_device(), *source, raised, Job()).total();
  };
  const SparseFit plenty = fit(std::size_t{2} << 30);
  ASSERT_GT(plenty.rank, 2U);
  const SparseFit scarce = fit(needed(plenty.rank));
  EXPECT_EQ(scarce.rank, plenty.rank);
  EXPECT_EQ(scarce.model->dictionary, plenty.model->dictionary);
  EXPECT_EQ(scarce.model->texels.coefficients, plenty.model->texels.coefficients);
  ASSERT_LT(needed(2), needed(4));
  expect_error(ErrorKind::input, {"--target size=16000", "4 components", "--rank 2"},
               [&] { fit(needed(2)); });
}

}  // namespace
}  // namespace weft::test
