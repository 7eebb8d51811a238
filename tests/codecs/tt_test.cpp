// The codec `tt`: the promised error over several tensors and goals, exact recovery of trains by
// device and reference, streamed and resident fits, every order of modes, ranks, sizes, rounding.
#include "weft/model/tt.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "codecs/codec_runs.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "weft/codecs/fit_tt.hpp"
#include "weft/codecs/tt.hpp"
#include "weft/codecs/tt_goal.hpp"
#include "weft/reference/tt.hpp"

namespace weft::test {
namespace {

const CodecRun device_run{"tt", true};
const CodecRun reference_run{"tt", false};

const TtModel& as_tt(const Model& model) {
  return dynamic_cast<const TtModel&>(model);
}

// A tensor of the given ranks in an order of modes, as [V][L][Y][X][C].
std::vector<double> train_values(const BtfShape& shape, const ModeOrder& order,
                                 const std::array<std::size_t, mode_count + 1>& ranks,
                                 std::uint64_t seed) {
  TtModel model;
  model.info.btf = make_info(shape);
  model.order = order;
  model.ranks = ranks;
  for (std::size_t n = 0; n < mode_count; ++n) {
    model.cores[n] = random_floats(ranks[n] * model.size(n) * ranks[n + 1], seed + n, -1, 1);
  }
  std::vector<double> values(shape.values());
  reference::TtImages(model).decode(0, shape.images(), values);
  return values;
}

// A smooth tensor: its unfoldings' singular values fall off, but none is zero.
std::vector<double> smooth_values(const BtfShape& shape, std::uint64_t seed) {
  const std::vector<double> noise = random_values(shape.values(), seed, -0.5, 0.5);
  std::vector<double> values(shape.values());
  for (std::size_t i = 0; i < values.size(); ++i) {
    std::size_t rest = i;
    const auto next = [&](std::size_t size) {
      const double index = static_cast<double>(rest % size) / static_cast<double>(size);
      rest /= size;
      return index;
    };
    const double c = next(shape.channels), x = next(shape.width), y = next(shape.height);
    const double l = next(shape.lights), v = next(shape.views);
    values[i] = 1 / (0.3 + x * l + y * v + 0.4 * c * l + x * y) + 0.02 * noise[i];
  }
  return values;
}

Parameters goal(const std::string& text, const std::string& order = "x,y,c,v,l") {
  return {{"target", text}, {"order", order}};
}

// The promise: |T - T'| <= EPS |T| of the model as stored, for device and reference, and ranks that
// grow as EPS falls.
TEST(Tt, ErrorIsWithinTheGoal) {
  const BtfShape shape{5, 6, 9, 8, 3};
  const std::vector<std::shared_ptr<MemorySource>> sources{
      source_of(shape, DType::f32, smooth_values(shape, 1)), random_source(shape, DType::f16, 2),
      source_of(shape, DType::u8, smooth_values(shape, 3))};
  for (const CodecRun& run : {device_run, reference_run}) {
    for (const auto& source : sources) {
      std::size_t before = 0;
      for (const double eps : {0.5, 0.1, 0.03, 3e-3, 5e-4, 1e-4}) {
        const auto model = run.encode(*source, goal("rel=" + std::to_string(eps)), Storage::f16);
        EXPECT_LE(relative(run.measure(*model, *source)), eps);
        EXPECT_GE(as_tt(*model).coefficients(), before) << eps;
        before = as_tt(*model).coefficients();
        // Rounding to half alone is above the last goals.
        const auto& stored = as_tt(*model).stored;
        const bool all_half =
            std::all_of(stored.begin(), stored.end(), [](Storage s) { return s == Storage::f16; });
        EXPECT_TRUE(all_half || eps < 0.02) << eps;
        EXPECT_FALSE(all_half && eps < 2e-4) << eps;
      }
    }
  }
}

// No rank is larger than its unfolding needs: with one less the goal would be missed.
TEST(Tt, TrainsOfKnownRanksAreRecovered) {
  const BtfShape shape{5, 7, 8, 9, 3};
  for (const char* order : {"x,y,c,v,l", "l,v,c,y,x", "v,x,l,c,y", "c,x,y,v,l", "x,v,y,l,c"}) {
    const std::array<std::size_t, mode_count + 1> ranks{1, 3, 6, 5, 2, 1};
    const auto source =
        source_of(shape, DType::f32, train_values(shape, parse_order(order, "--order"), ranks, 4));
    for (const CodecRun& run : {device_run, reference_run}) {
      // as asked, and as found
      for (const Parameters& parameters :
           {Parameters{{"ranks", "3,6,5,2"}, {"order", order}}, goal("rel=3e-6", order)}) {
        const auto model = run.encode(*source, parameters, Storage::f32);
        EXPECT_EQ(as_tt(*model).ranks, ranks) << order;
        // values and cores in float, sums of up to 72 products five times over
        EXPECT_LE(relative(run.measure(*model, *source)), 5 * 72 * 0x1p-24) << order;
      }
    }
  }
}

// The input in slabs, whatever is streamed, is fitted as the same tensor in memory.
TEST(Tt, StreamedFitsKeepThePromise) {
  const BtfShape shape{6, 5, 8, 7, 3};
  const auto source = source_of(shape, DType::f16, smooth_values(shape, 5));
  for (const char* order : {"x,y,c,v,l", "l,v,c,y,x", "v,x,l,c,y", "c,y,v,l,x", "y,c,l,x,v"}) {
    for (const double eps : {0.1, 0.01, 1e-3}) {
      TtFitOptions options;
      options.order = parse_order(order, "--order");
      options.request.tolerance = eps;
      Job job;
      const TrainFit resident = fit_tt(shared_device(), *source, options, job);
      options.resident_values = 0;
      for (const std::size_t left : {std::size_t{0}, std::size_t{1} << 28}) {
        options.most_left = left;  // cut by spectra as long as can be, or not at all
        const TrainFit fit = fit_tt(shared_device(), *source, options, job);
        EXPECT_NEAR(fit.squares, resident.squares, 1e-5 * resident.squares);
        EXPECT_LE(std::sqrt(fit.lost), eps * (1 + 1e-4)) << order;
        const auto model = store_train(fit.train, options.order, source->info(), Storage::f32, 0);
        const double found = relative(device_run.measure(*model, *source));
        EXPECT_NEAR(found, std::sqrt(fit.lost), 1e-4 * eps + 2e-6) << order << ' ' << eps;
        // Both ends are cut in other turns; neither is much larger.
        EXPECT_LE(fit.train.coefficients(), resident.train.coefficients() * 3 / 2) << order;
      }
    }
  }
}

// What is lost is what the cuts say, and what rounding to half adds is what the weights say.
TEST(Tt, RoundingOfCoresIsForeseen) {
  const BtfShape shape{6, 5, 8, 7, 3};
  const auto source = source_of(shape, DType::f32, smooth_values(shape, 6));
  TtFitOptions options;
  options.request.tolerance = 0.02;
  Job job;
  for (const std::size_t resident : {std::size_t{0}, std::size_t{1} << 20}) {
    options.resident_values = resident;
    const TrainFit fit = fit_tt(shared_device(), *source, options, job);
    const auto exact = store_train(fit.train, options.order, source->info(), Storage::f32, 0);
    const auto half = store_train(fit.train, options.order, source->info(), Storage::f16, 1e30);
    const std::vector<double> one = reference_run.decode(*exact, shape.images());
    const std::vector<double> other = reference_run.decode(*half, shape.images());
    double squares = 0;
    for (std::size_t i = 0; i < one.size(); ++i) squares += std::pow(one[i] - other[i], 2);
    // Allowed a little more than that, all cores are half; a little less, some are not. Changes of
    // two cores are orthogonal but for the little that both make.
    const auto fits =
        store_train(fit.train, options.order, source->info(), Storage::f16, 1.2 * squares);
    EXPECT_EQ(fits->stored, half->stored);
    const auto tight =
        store_train(fit.train, options.order, source->info(), Storage::f16, 0.8 * squares);
    EXPECT_NE(tight->stored, half->stored);
  }
}

TEST(Tt, SizesAreMetAndUsed) {
  const BtfShape shape{8, 9, 16, 17, 3};
  const auto source = source_of(shape, DType::f16, smooth_values(shape, 7));
  for (const CodecRun& run : {device_run, reference_run}) {
    double before = 1;
    for (const std::size_t bytes : {6000, 9000, 20000}) {
      const auto model = run.meet(*source, "size=" + std::to_string(bytes));
      const std::size_t size = model_file_size(*model);
      EXPECT_LE(size, bytes);
      EXPECT_GE(size + 512, bytes * 9 / 10U);  // errors and selection have room kept
      const double error = relative(run.measure(*model, *source));
      EXPECT_LT(error, before);
      before = error;
    }
    expect_error(ErrorKind::unmet_goal, {"--target size=1000"},
                 [&] { run.meet(*source, "size=1000"); });
  }
}

TEST(Tt, RoundingOfATrainIsWithinItsTolerance) {
  const BtfShape shape{6, 5, 8, 7, 3};
  const auto source = source_of(shape, DType::f32, smooth_values(shape, 8));
  const auto fine = reference_run.encode(*source, goal("rel=1e-3"), Storage::f32);
  const TensorTrain train = reference::to_train(as_tt(*fine));
  const std::vector<double> exact = reference::tt_full(train);
  double squares = 0;
  for (const double value : exact) squares += value * value;
  EXPECT_NEAR(reference::tt_norm(train), std::sqrt(squares), 1e-9 * std::sqrt(squares));
  std::size_t before = train.coefficients();
  for (const double eps : {2e-3, 0.01, 0.1, 0.4}) {
    reference::TrainRequest request;
    request.tolerance = eps;
    const TrainFit cut = reference::tt_round(train, request);
    const std::vector<double> rounded = reference::tt_full(cut.train);
    double error = 0;
    for (std::size_t i = 0; i < exact.size(); ++i) error += std::pow(exact[i] - rounded[i], 2);
    EXPECT_LE(std::sqrt(error / squares), eps);
    EXPECT_NEAR(error / squares, cut.lost, 1e-9);
    EXPECT_LE(cut.train.coefficients(), before);
    before = cut.train.coefficients();
  }
}

TEST(Tt, ModelsAreRoundedWithoutDecoding) {
  const BtfShape shape{6, 5, 8, 7, 3};
  const auto source = source_of(shape, DType::f32, smooth_values(shape, 8));
  const auto fine = device_run.encode(*source, goal("rel=2e-3"), Storage::f16);
  const auto decoded = source_of(shape, DType::f32, reference_run.decode(*fine, shape.images()));
  Job job;
  for (const double eps : {0.01, 0.1}) {
    const auto coarse =
        round_tt(as_tt(*fine), {{"target", "rel=" + std::to_string(eps)}}, Storage::f16, job);
    EXPECT_LE(relative(reference_run.measure(*coarse, *decoded)), eps);
    EXPECT_LT(as_tt(*coarse).coefficients(), as_tt(*fine).coefficients());
  }
  expect_error(ErrorKind::input, {"--order l,v,c,y,x"},
               [&] { round_tt(as_tt(*fine), goal("rel=0.1", "l,v,c,y,x"), Storage::f16, job); });
}

TEST(Tt, RanksAreDroppedWhereLeastIsLost) {
  TensorTrain train;
  train.sizes = {4, 4, 4, 4, 4};
  train.ranks = {1, 2, 2, 2, 2, 1};
  train.values = {{{9, 5}, {9, 1}, {9, 4}, {9, 3}}};
  // 8 + 16 + 16 + 16 + 8 = 64 numbers; without the second of bond 2 they are 48
  const std::vector<TrainCut> cuts = train_cuts(train);
  ASSERT_EQ(cuts.size(), 5U);
  EXPECT_EQ(cuts[0].ranks, (reference::BondRanks{2, 2, 2, 2}));
  EXPECT_EQ(cuts[0].coefficients, 64U);
  EXPECT_EQ(cuts[0].lost, 0);
  EXPECT_EQ(cuts[1].ranks, (reference::BondRanks{2, 1, 2, 2}));
  EXPECT_EQ(cuts[1].coefficients, 48U);
  EXPECT_EQ(cuts[1].lost, 1);
  EXPECT_EQ(cuts[4].ranks, (reference::BondRanks{1, 1, 1, 1}));
  EXPECT_EQ(cuts[4].coefficients, 20U);
  EXPECT_EQ(cuts[4].lost, 1 + 9 + 16 + 25);
}

TEST(Tt, OrdersAreChosenAndNamed) {
  const auto source = source_of({6, 5, 8, 7, 3}, DType::f32, smooth_values({6, 5, 8, 7, 3}, 5));
  Job job;
  const auto model = device_run.encode(*source, goal("rel=0.02", "auto"), Storage::f16, job);
  EXPECT_LE(relative(device_run.measure(*model, *source)), 0.02);
  const std::string chosen = "order " + to_text(as_tt(*model).order) + ": the fewest numbers";
  EXPECT_TRUE(std::any_of(job.notes.begin(), job.notes.end(), [&](const std::string& line) {
    return line.find(chosen) != std::string::npos;
  }));
  expect_error(ErrorKind::input, {"--order auto"},
               [&] { reference_run.encode(*source, goal("rel=0.02", "auto"), Storage::f16); });
}

TEST(Tt, BadRequestsAreRefused) {
  const auto source = random_source({2, 3, 4, 5, 3}, DType::f16, 9);
  const auto expect_refused = [&](const Parameters& parameters,
                                  std::initializer_list<std::string_view> parts) {
    for (const CodecRun& run : {device_run, reference_run}) {
      expect_error(ErrorKind::input, parts, [&] { run.encode(*source, parameters, Storage::f16); });
    }
  };
  expect_refused(goal("rel=0"), {"--target rel=0"});
  expect_refused(goal("rel=1"), {"--target rel=1"});
  expect_refused(goal("rel=0.1", "x,y,c,v"), {"--order x,y,c,v"});
  expect_refused({{"ranks", "1,2,3"}}, {"--ranks 1,2,3"});
  expect_refused({{"ranks", "1,2,0,1"}}, {"--ranks 1,2,0,1", "'0'"});
  expect_refused({{"ranks", "6,2,3,1"}}, {"R1 = 6", "at most 5"});
  expect_refused({{"ranks", "5,19,3,1"}}, {"R2 = 19", "at most 18"});
  expect_refused({{"ranks", "5,2,3,1"}, {"rank", "2"}}, {"--rank 2"});
  expect_refused({{"ranks", "5,2,3,1"}, {"target", "rel=0.1"}}, {"--ranks 5,2,3,1", "rel=0.1"});
}

}  // namespace
}  // namespace weft::test
