// The search for a goal over models whose errors and sizes are made up, and what goals are.
#include "weft/codecs/meet_goal.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "weft/codecs/least_error.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/pca.hpp"

namespace weft::test {
namespace {

constexpr double rms = 0.5;
const BtfShape shape{1, 1, 40, 1, 1};

// Models of ever more components; `errors` are those that measuring finds, of which the foreseen
// are some times as large.
class MadeModels final : public NestedModels {
 public:
  MadeModels(std::vector<double> errors, double foreseen, bool complete, bool cuts_lose = false)
      : errors_(std::move(errors)),
        foreseen_(foreseen),
        complete_(complete),
        cuts_lose_(cuts_lose) {}
  std::size_t count() const override { return errors_.size(); }
  std::unique_ptr<Model> model(std::size_t i) const override {
    auto model = std::make_unique<PcaModel>();
    model->info.codec = "pca";
    model->info.btf = make_info(shape, DType::f16);
    model->rank = i;
    model->mean.assign(1, 0.0f);
    model->coefficients.assign(i * shape.texels(), 1.0f);
    model->basis.assign(i, 1.0f);
    return model;
  }
  std::size_t values(std::size_t i) const override { return 1 + i * (1 + shape.texels()); }
  double error(std::size_t i) const override { return foreseen_ * errors_[i]; }
  bool complete() const override { return complete_; }
  std::string bound() const override { return "--rank 7"; }
  bool cuts_lose() const override { return cuts_lose_; }

 private:
  std::vector<double> errors_;
  double foreseen_;
  bool complete_;
  bool cuts_lose_;
};

ErrorReport report_of(double relative) {
  ErrorSums sums;
  sums.count = 100;
  sums.square_reference = 100 * rms * rms;
  sums.square_difference = relative * relative * sums.square_reference;
  sums.max_difference = 5 * relative * rms;
  sums.max_reference = 1;
  ErrorReport report = weft::report(sums, 1.0);
  report.ssim = 1 - relative * relative;
  return report;
}

// What a search over made models did.
struct Made {
  std::vector<double> errors;  // of all models there are, descending
  std::size_t held = 1000;     // of the first decomposition; twice as many each time
  bool complete = false;
  double foreseen = 1;
  double half = 0;  // relative error of rounding to half
  std::set<std::size_t> measured;
  std::size_t decompositions = 0;

  GoalResult meet(const std::string& text, bool may_widen = false) {
    GoalSource source;
    source.bytes = 1 << 20;
    source.squares = 100 * rms * rms;
    source.root_mean_square = rms;
    source.may_widen = may_widen;
    GoalSteps steps;
    steps.decompose = [&](const NestedRequest&) {
      const std::size_t count = std::min(errors.size(), held << decompositions++);
      return std::make_unique<MadeModels>(
          std::vector<double>(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(count)),
          foreseen, complete);
    };
    steps.store = [](Model& model, Storage storage) {
      model.info.storage = storage;
      // rounded values are others
      if (storage == Storage::f16) dynamic_cast<PcaModel&>(model).mean[0] = 0.5f;
    };
    steps.measure = [&](const Model& model) {
      const std::size_t i = dynamic_cast<const PcaModel&>(model).rank;
      measured.insert(i);
      const double rounding = model.info.storage == Storage::f16 ? half : 0;
      return MeasuredModel{report_of(std::hypot(errors[i], rounding))};
    };
    Job job;
    return meet_goal(parse_goal(text, make_info(shape, DType::f16)), source, steps, job);
  }
};

std::vector<double> falling(std::size_t count, double ratio, std::uint64_t seed) {
  Random random(seed);
  std::vector<double> errors{0.9};
  while (errors.size() < count) errors.push_back(errors.back() * random.uniform(ratio, 1.0));
  return errors;
}

std::size_t rank_of(const GoalResult& result) {
  return dynamic_cast<const PcaModel&>(*result.model).rank;
}

TEST(MeetGoal, FindsTheSmallestThatMeetsAndMeasuresTheNextSmaller) {
  std::uint64_t seed = 0;
  for (const double ratio : {0.5, 0.95, 0.999}) {
    for (const double foreseen : {1.0, 0.7, 1.5}) {
      for (const char* text : {"psnr=30", "snr=12.5", "rel=0.21", "rmse=0.05", "max=0.4",
                               "ssim=0.97", "rel=0.89", "snr=45"}) {
        Made made;
        made.errors = falling(300, ratio, ++seed);
        made.errors.back() = 1e-4;
        made.foreseen = foreseen;
        const GoalResult result = made.meet(text);
        const Goal goal = parse_goal(text, make_info(shape, DType::f16));
        const std::size_t found = rank_of(result);
        EXPECT_TRUE(goal.met(report_of(made.errors[found]))) << text;
        EXPECT_EQ(result.reached, goal.reached(result.measured.errors));
        if (found > 0) {
          EXPECT_FALSE(goal.met(report_of(made.errors[found - 1]))) << text << " " << found;
          EXPECT_TRUE(made.measured.contains(found - 1)) << text;
        }
        EXPECT_EQ(result.decompositions, 1U);
        EXPECT_EQ(result.trials, made.measured.size());
        EXPECT_LE(result.trials, 16U) << text << " " << ratio << " " << foreseen;
      }
    }
  }
}

TEST(MeetGoal, FewTrialsWhereErrorsAreForeseen) {
  Made made;
  made.errors = falling(5000, 0.999, 5);
  made.held = 5000;
  EXPECT_LE(made.meet("snr=20").trials, 3U);
}

TEST(MeetGoal, DecomposesFurtherWhereTheLargestMisses) {
  Made made;
  made.errors = falling(300, 0.95, 8);
  made.held = 20;
  const GoalResult result = made.meet("snr=25");
  EXPECT_GT(result.decompositions, 1U);
  EXPECT_GE(result.measured.errors.snr, 25);
  EXPECT_LT(report_of(made.errors[rank_of(result) - 1]).snr, 25);
}

TEST(MeetGoal, SaysWhatWasReachedAndWhatForbidsMore) {
  Made made;
  made.errors = falling(8, 0.8, 3);
  made.complete = true;
  const double reached = report_of(made.errors.back()).snr;
  expect_error(ErrorKind::unmet_goal,
               {"--target snr=60", fmt::format("{:.6g} was reached", reached), "--rank 7"},
               [&] { made.meet("snr=60"); });
  EXPECT_EQ(made.decompositions, 1U);

  Made flat;  // further decompositions come to nothing more
  flat.errors.assign(4000, 0.5);
  flat.held = 5;
  expect_error(ErrorKind::unmet_goal, {"rel=0.1", "0.5 was reached"},
               [&] { flat.meet("rel=0.1"); });
  EXPECT_LE(flat.decompositions, 3U);
}

TEST(MeetGoal, FloatTakesThePlaceOfHalfWhereItMay) {
  for (const bool may : {false, true}) {
    Made made;
    made.errors = falling(300, 0.9, 4);
    made.half = 1e-3;
    if (!may) {
      expect_error(ErrorKind::unmet_goal, {"rel=0.0005"}, [&] { made.meet("rel=0.0005"); });
      continue;
    }
    const GoalResult result = made.meet("rel=0.0005", true);
    EXPECT_EQ(result.model->info.storage, Storage::f32);
    EXPECT_LE(result.measured.errors.relative, 0.0005);
    EXPECT_GT(made.errors[rank_of(result) - 1], 0.0005);
    // but not where half has room
    Made roomy;
    roomy.errors = falling(300, 0.9, 4);
    roomy.held = 30;
    roomy.half = 1e-3;
    EXPECT_EQ(roomy.meet("rel=0.01", true).model->info.storage, Storage::f16);
  }
}

TEST(MeetGoal, FindsTheLargestFileThatIsSmallEnough) {
  const auto size_of = [](std::size_t rank) {
    auto model = MadeModels(std::vector<double>(rank + 1, 1.0), 1, false).model(rank);
    model->info.errors = report_of(0.123456789);
    return model_file_size(*model);
  };
  for (const std::size_t bytes : {4000U, 5000U, 20000U, 20001U, 60000U}) {
    Made made;
    made.errors = falling(1000, 0.99, 2);
    made.held = 50;
    const GoalResult result = made.meet("size=" + std::to_string(bytes));
    const std::size_t rank = rank_of(result);
    EXPECT_LE(size_of(rank), bytes);
    EXPECT_LE(result.reached, static_cast<double>(bytes));
    // by one component, and the room that is kept for the errors' digits
    EXPECT_GT(size_of(rank + 1) + 256, bytes);
    EXPECT_EQ(result.trials, 1U);
    EXPECT_EQ(result.measured.errors.relative, report_of(made.errors[rank]).relative);
  }
  Made made;
  made.errors = falling(10, 0.9, 2);
  expect_error(ErrorKind::unmet_goal, {"--target size=100", "100 are allowed"},
               [&] { made.meet("size=100"); });
  // all of it, where there is no more
  made.complete = true;
  EXPECT_EQ(rank_of(made.meet("size=1MiB")), 9U);
}

// Errors that fall with the components and rise with what quantisation takes: every model is stored
// in the same number of bytes.
struct Traded {
  std::size_t best = 0;  // the components that err least
  std::size_t small_enough = std::numeric_limits<std::size_t>::max();
  std::map<std::size_t, std::size_t> asked;

  double error(std::size_t i) {
    ++asked[i];
    if (i > small_enough) return std::numeric_limits<double>::infinity();
    const double x = static_cast<double>(i + 1) / static_cast<double>(best + 1);
    return x + 1 / x;
  }
};

TEST(LeastError, IsFoundNearWhereverItIs) {
  const MadeModels models(std::vector<double>(500, 1.0), 1, true);
  for (const std::size_t best : {0U, 1U, 17U, 100U, 380U, 499U}) {
    for (const std::size_t start : {0U, 1U, 30U, 200U, 499U}) {
      Traded made;
      made.best = best;
      const std::size_t found =
          least_error(models, start, [&](std::size_t i) { return made.error(i); });
      // by less than 2 % of the least
      EXPECT_LE(made.error(found), 2.04) << best << " from " << start << ": " << found;
      made.asked.erase(found);
      for (const auto& [i, times] : made.asked) EXPECT_EQ(times, 1U) << i;
      EXPECT_LE(made.asked.size(), 24U);
    }
  }
}

TEST(LeastError, GoesDownToWhatFits) {
  const MadeModels models(std::vector<double>(500, 1.0), 1, true);
  for (const std::size_t most : {0U, 3U, 40U}) {
    Traded made;
    made.best = 499;
    made.small_enough = most;
    const std::size_t found =
        least_error(models, 300, [&](std::size_t i) { return made.error(i); });
    EXPECT_LE(found, most);
    EXPECT_GE(1.25 * static_cast<double>(found + 1), static_cast<double>(most + 1));
  }
}

// Steps that are as fine as a size allows: more components until the error stops falling, a larger
// decomposition where it falls up to the last, and an unmet goal where nothing is small enough.
TEST(MeetGoal, TradesComponentsForSteps) {
  const BtfInfo info = make_info(shape, DType::f16);
  for (const std::size_t best : {4U, 60U, 150U}) {
    Traded made;
    made.best = best;
    std::size_t decompositions = 0;
    bool fits = true;
    GoalSource source;
    source.bytes = 1 << 20;
    source.squares = 100 * rms * rms;
    source.root_mean_square = rms;
    source.storage = Storage::f32;
    GoalSteps steps;
    steps.decompose = [&](const NestedRequest& request) {
      EXPECT_TRUE(request.steps);
      return std::make_unique<MadeModels>(
          std::vector<double>(std::size_t{50} << decompositions++, 1.0), 1, false);
    };
    steps.store_to_size = [&](Model& model) {
      model.info.storage = Storage::f32;
      return fits;
    };
    steps.measure = [&](const Model& model) {
      return MeasuredModel{report_of(0.01 * made.error(dynamic_cast<const PcaModel&>(model).rank))};
    };
    Job job;
    job.notes = {"before"};
    const GoalResult result = meet_goal(parse_goal("size=9000", info), source, steps, job);
    EXPECT_EQ(result.decompositions, best < 49 ? 1U : best < 99 ? 2U : 3U);
    EXPECT_LE(result.measured.errors.relative, 0.0204);
    EXPECT_NEAR(result.measured.errors.relative, 0.01 * made.error(rank_of(result)), 1e-12);
    EXPECT_EQ(job.notes, std::vector<std::string>{"before"});
    EXPECT_TRUE(job.held.empty());
    fits = false;
    expect_error(ErrorKind::unmet_goal, {"--target size=9000", "9000 are allowed"},
                 [&] { meet_goal(parse_goal("size=9000", info), source, steps, job); });
  }
}

// Where the models of smaller decompositions are better, these are made while they are.
TEST(MeetGoal, DecomposesNearerWhereCutsLose) {
  const BtfInfo info = make_info(shape, DType::f16);
  for (const bool lose : {false, true}) {
    std::size_t held = 0;  // models of the last decomposition
    const auto error = [&](std::size_t i) {
      return 0.02 + 0.01 * std::abs(std::log2(static_cast<double>(i + 1) / 22)) +
             0.2 * static_cast<double>(held - 1 - i) / static_cast<double>(held);
    };
    GoalSource source;
    source.bytes = 1 << 20;
    source.squares = 100 * rms * rms;
    source.root_mean_square = rms;
    GoalSteps steps;
    steps.decompose = [&](const NestedRequest& request) {
      held = static_cast<std::size_t>(100 * request.growth);
      return std::make_unique<MadeModels>(std::vector<double>(held, 1.0), 1, true, lose);
    };
    steps.store_to_size = [&](Model& model) {
      model.info.storage = Storage::f32;
      // models of other decompositions are others
      dynamic_cast<PcaModel&>(model).mean[0] = static_cast<float>(held);
      return true;
    };
    steps.measure = [&](const Model& model) {
      return MeasuredModel{report_of(error(dynamic_cast<const PcaModel&>(model).rank))};
    };
    Job job;
    const GoalResult result = meet_goal(parse_goal("size=9000", info), source, steps, job);
    // of 100, 50, 25 and 12 the third is best
    EXPECT_EQ(result.decompositions, lose ? 4U : 1U);
    EXPECT_EQ(dynamic_cast<const PcaModel&>(*result.model).mean[0], lose ? 25.0f : 100.0f);
  }
}

// What a size's models will take is in the plan of the decomposition, before it starts.
TEST(MeetGoal, CountsWhatItWillTryBeforehand) {
  const BtfInfo info = make_info(shape, DType::f16);
  GoalSource source;
  source.bytes = 1 << 20;
  source.squares = 100 * rms * rms;
  source.root_mean_square = rms;
  source.storing_bytes = 16;
  Job job;
  job.memory = 100000;
  job.held = {{"weights", 10}};
  bool decomposed = false;
  GoalSteps steps;
  steps.decompose = [&](const NestedRequest&) -> std::unique_ptr<NestedModels> {
    job.plan({});
    decomposed = true;
    return nullptr;
  };
  expect_error(ErrorKind::input, {"--memory 100000", "models that are tried"},
               [&] { meet_goal(parse_goal("size=30000", info), source, steps, job); });
  EXPECT_FALSE(decomposed);
  EXPECT_EQ(job.held.size(), 1U);
}

TEST(Goal, ReadsEveryKind) {
  const BtfInfo info = make_info({2, 3, 4, 5, 3}, DType::f16);
  EXPECT_EQ(parse_goal("psnr=38.5", info).kind, GoalKind::psnr);
  EXPECT_EQ(parse_goal("psnr=38.5", info).value, 38.5);
  EXPECT_EQ(parse_goal("size=3KiB", info).bytes, 3072U);
  EXPECT_EQ(parse_goal("ratio=4", info).bytes, std::size_t{2 * 3 * 4 * 5 * 3 * 2 / 4});
  // psnr, snr, rmse and rel are each other's
  const double relative = 0.03;
  const ErrorReport errors = report_of(relative);
  for (const Goal& goal : {parse_goal(fmt::format("psnr={}", errors.psnr), info),
                           parse_goal(fmt::format("snr={}", errors.snr), info),
                           parse_goal(fmt::format("rmse={}", errors.rmse), info),
                           parse_goal(fmt::format("rel={}", errors.relative), info)}) {
    EXPECT_NEAR(goal.relative(rms, 1.0), relative, 1e-15);
    EXPECT_TRUE(goal.met(errors));
    EXPECT_FALSE(goal.met(report_of(1.001 * relative)));
    EXPECT_NEAR(goal.missing_factor(report_of(2 * relative)), 0.5, 1e-12);
  }
}

TEST(Goal, RefusesNonsense) {
  for (const char* text :
       {"psnr",      "psnr=",  "psnr=nan", "psnr=inf", "psnr=-3",  "psnr=0",    "psnr=40dB",
        "snr=0",     "rmse=0", "rmse=-1",  "rel=0",    "rel=1",    "max=0",     "ssim=2",
        "ssim=1",    "ssim=0", "size=0",   "size=",    "size=big", "ratio=0.5", "ratio=1e30",
        "ratio=nan", "=3",     "speed=3",  "rel 0.1"}) {
    expect_error(ErrorKind::input, {"--target"}, [&] {
      parse_goal(text, make_info({2, 3, 4, 5, 3}, DType::f16));
    });
  }
}

}  // namespace
}  // namespace weft::test
