// The ways and goals of a truncated SVD through the codec `pca`, on the device and by the
// reference, for images of more texels than there are image channels and of fewer.
#include "weft/codecs/truncated_svd.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/shared_device.hpp"
#include "weft/codecs/choose_svd.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/codecs/pca.hpp"
#include "weft/error.hpp"
#include "weft/model/pca.hpp"
#include "weft/reference/factorise.hpp"

namespace weft::test {
namespace {

// P = 390 of 45 image channels, and P = 30 of 300.
const BtfShape many_texels{3, 5, 15, 26, 3};
const BtfShape few_texels{10, 10, 5, 6, 3};

// T = 0.1 + A, A about of the given singular values, as float.
std::shared_ptr<MemorySource> graded_source(const BtfShape& shape, double ratio,
                                            bool mapped = false) {
  const std::size_t texels = shape.texels();
  const std::size_t n = shape.images() * shape.channels;
  std::vector<double> values(std::min(texels, n));
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = std::pow(ratio, i);
  const std::vector<double> A = matrix_with_singular_values(texels, n, values, 3);
  std::vector<double> tensor(shape.values());
  for (std::size_t r = 0; r < n; ++r) {
    const std::size_t image = r / shape.channels;
    for (std::size_t p = 0; p < texels; ++p) {
      tensor[(image * texels + p) * shape.channels + r % shape.channels] = 0.1 + A[p * n + r];
    }
  }
  return std::make_shared<MemorySource>(make_info(shape, DType::f32),
                                        encode_values(tensor, DType::f32), mapped);
}

// Singular values of the mean-removed values as stored, and |T|.
struct Exact {
  std::vector<double> sigma;
  double norm = 0;

  // Relative error of the best rank-k approximation.
  double best(std::size_t k) const {
    double sum = 0;
    for (std::size_t i = k; i < sigma.size(); ++i) sum += sigma[i] * sigma[i];
    return std::sqrt(sum) / norm;
  }
  double energy(std::size_t k) const { return 1 - std::pow(best(k) / best(0), 2); }
};

Exact exact(const MemorySource& source) {
  const BtfShape& shape = source.info().shape;
  const std::size_t texels = shape.texels();
  const std::size_t n = shape.images() * shape.channels;
  const std::vector<double> tensor = decode_values(source.bytes(), DType::f32);
  std::vector<double> A(texels * n);
  Exact result;
  for (std::size_t r = 0; r < n; ++r) {
    const auto at = [&](std::size_t p) {
      return tensor[(r / shape.channels * texels + p) * shape.channels + r % shape.channels];
    };
    double mean = 0;
    for (std::size_t p = 0; p < texels; ++p) {
      mean += at(p) / static_cast<double>(texels);
      result.norm += at(p) * at(p);
    }
    for (std::size_t p = 0; p < texels; ++p) A[p * n + r] = at(p) - mean;
  }
  result.norm = std::sqrt(result.norm);
  result.sigma = reference::thin_svd(texels, n, A).values;
  return result;
}

class SvdWays : public testing::TestWithParam<std::tuple<bool, std::string, std::string>> {
 protected:
  bool on_device() const { return std::get<0>(GetParam()); }
  std::string method() const { return std::get<1>(GetParam()); }

  std::unique_ptr<PcaModel> encode(TileSource& source, Parameters parameters, Job job = {}) {
    parameters["svd"] = method();
    parameters["arithmetic"] = std::get<2>(GetParam());
    auto model = on_device()
                     ? pca_codec().encode(shared_device(), source, parameters, Storage::f32, job)
                     : pca_codec().encode_reference(source, parameters, Storage::f32, job);
    return std::unique_ptr<PcaModel>(dynamic_cast<PcaModel*>(model.release()));
  }

  static double relative_error(const Model& model, TileSource& source) {
    Job job;
    const ErrorSums sums = measure_errors(*pca_codec().reference_decoder(model), source, job);
    return std::sqrt(sums.square_difference / sums.square_reference);
  }
};

std::vector<std::tuple<bool, std::string, std::string>> ways() {
  std::vector<std::tuple<bool, std::string, std::string>> result;
  for (const char* method : {"auto", "gram", "randomized", "qr"}) {
    result.emplace_back(true, method, "f32");
    result.emplace_back(true, method, "f64");
    result.emplace_back(false, method, "f64");
  }
  return result;
}

INSTANTIATE_TEST_SUITE_P(Ways, SvdWays, testing::ValuesIn(ways()), [](const auto& info) {
  return std::string(std::get<0>(info.param) ? "Device_" : "Reference_") + std::get<1>(info.param) +
         "_" + std::get<2>(info.param);
});

TEST_P(SvdWays, RanksComeNearTheBestError) {
  for (const BtfShape& shape : {many_texels, few_texels}) {
    const auto source = graded_source(shape, 0.8);
    const Exact truth = exact(*source);
    for (const std::size_t rank : {std::size_t{1}, std::size_t{8}, std::size_t{20}}) {
      const auto model = encode(*source, {{"rank", std::to_string(rank)}});
      EXPECT_EQ(model->rank, rank);
      // what the factors lose as floats, and the sum of k + 1 terms of them
      const double rounding = 4 * static_cast<double>(rank + 3) * float_roundoff;
      EXPECT_LE(relative_error(*model, *source), 1.01 * truth.best(rank) + rounding)
          << shape.texels() << " texels, rank " << rank;
    }
  }
}

TEST_P(SvdWays, CoefficientsAreOrthonormal) {
  for (const BtfShape& shape : {many_texels, few_texels}) {
    const auto source = graded_source(shape, 0.7);
    const auto model = encode(*source, {{"rank", "16"}});
    const std::size_t k = model->rank;
    double previous = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < k; ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        double product = 0;
        for (std::size_t p = 0; p < shape.texels(); ++p) {
          product +=
              double{model->coefficients[p * k + i]} * double{model->coefficients[p * k + j]};
        }
        // sums of k products, turned twice
        EXPECT_NEAR(product, i == j ? 1.0 : 0.0,
                    16 * gamma(static_cast<double>(2 * k + 64), float_roundoff))
            << i << ", " << j;
      }
      double length = 0;
      for (std::size_t r = 0; r < model->mean.size(); ++r) {
        length += std::pow(double{model->basis[i * model->mean.size() + r]}, 2);
      }
      EXPECT_LE(std::sqrt(length), previous * (1 + 1e-5));
      previous = std::sqrt(length);
    }
  }
}

TEST_P(SvdWays, ToleranceAndEnergyAreMetByTheFewest) {
  for (const BtfShape& shape : {many_texels, few_texels}) {
    const auto source = graded_source(shape, 0.8);
    const Exact truth = exact(*source);
    for (const std::size_t k : {std::size_t{2}, std::size_t{12}, std::size_t{24}}) {
      const double tolerance = std::sqrt(truth.best(k) * truth.best(k - 1));
      const auto by_tolerance = encode(*source, {{"tolerance", std::to_string(tolerance)}});
      EXPECT_EQ(by_tolerance->rank, k) << shape.texels() << " texels";
      EXPECT_LE(relative_error(*by_tolerance, *source), tolerance * (1 + 1e-3));
      const double energy = 0.5 * (truth.energy(k) + truth.energy(k - 1));
      const auto by_energy = encode(*source, {{"energy", fmt::format("{}", energy)}});
      EXPECT_EQ(by_energy->rank, k) << shape.texels() << " texels";
    }
    // the mean alone
    const auto none = encode(*source, {{"tolerance", "0.9999"}});
    EXPECT_LE(none->rank, 1U);
  }
}

TEST_P(SvdWays, UnmetGoalsSayWhatWasReached) {
  const auto source = graded_source(many_texels, 0.9);
  try {
    encode(*source, {{"tolerance", "0.001"}, {"rank", "5"}});
    ADD_FAILURE() << "5 components were enough";
  } catch (const Error& failure) {
    EXPECT_EQ(failure.kind(), ErrorKind::unmet_goal);
    const std::string message = failure.what();
    EXPECT_NE(message.find("--tolerance 0.001"), std::string::npos) << message;
    EXPECT_NE(message.find("5 components"), std::string::npos) << message;
    EXPECT_NE(message.find("--rank"), std::string::npos) << message;
  }
}

TEST_P(SvdWays, TheSameBitsWhateverTheMemoryAndTheSource) {
  for (const BtfShape& shape : {many_texels, few_texels}) {
    const auto read = graded_source(shape, 0.8);
    const auto mapped = graded_source(shape, 0.8, true);
    for (const Parameters& goal : {Parameters{{"rank", "7"}}, Parameters{{"energy", "0.99"}}}) {
      Job small;
      small.memory = std::size_t{100} << 20;
      const auto a = encode(*mapped, goal);
      const auto b = encode(*read, goal, small);
      EXPECT_TRUE(all_equal(a->coefficients, b->coefficients));
      EXPECT_TRUE(all_equal(a->basis, b->basis));
    }
  }
}

TEST_P(SvdWays, ConstantZeroAndTiny) {
  for (const BtfShape& shape : {BtfShape{1, 1, 1, 1, 1}, BtfShape{1, 2, 30, 4, 1},
                                BtfShape{4, 4, 1, 2, 3}, BtfShape{2, 1, 1, 1, 7}}) {
    for (const double constant : {0.0, 0.3}) {
      const auto flat = source_of(shape, DType::f32, std::vector<double>(shape.values(), constant));
      EXPECT_EQ(encode(*flat, {{"rank", "3"}})->rank, 0U);
      EXPECT_EQ(encode(*flat, {{"tolerance", "0.001"}})->rank, 0U);
    }
    const auto random = random_source(shape, DType::u8, 5);
    EXPECT_LE(relative_error(*encode(*random, {{"rank", "100"}}), *random), 1e-5);
  }
}

TEST(SvdChoice, IsReported) {
  const auto source = graded_source(many_texels, 0.8);
  const auto chosen = [&](const Parameters& parameters) {
    Job job;
    const auto model = pca_codec().encode(shared_device(), *source, parameters, Storage::f32, job);
    EXPECT_EQ(job.notes.size(), 1U);
    return job.notes.empty() ? std::string() : job.notes.front();
  };
  EXPECT_EQ(chosen({{"rank", "4"}}).find("svd gram, 2 passes"), 0U);
  EXPECT_EQ(chosen({{"tolerance", "0.05"}}).find("svd gram"), 0U);
  EXPECT_EQ(chosen({{"tolerance", "0.0005"}}).find("svd qr"), 0U);
  EXPECT_EQ(chosen({{"tolerance", "0.0005"}, {"arithmetic", "f64"}}).find("svd gram"), 0U);
  EXPECT_EQ(chosen({{"rank", "4"}, {"svd", "randomized"}}).find("svd randomized"), 0U);
  // a small residual, which a Gram matrix in float does not know
  EXPECT_EQ(chosen({{"rank", "40"}}).find("svd qr, 4 passes"), 0U) << chosen({{"rank", "40"}});
}

// The qr that `auto` may turn to costs no memory beyond that of gram, but for a few blocks of rows
// beside the smallest data.
TEST(SvdChoice, AutoByRankTakesTheMemoryOfGramAndOfASmallSvd) {
  for (const BtfShape& shape :
       {many_texels, few_texels, BtfShape{16, 16, 8, 8, 3}, BtfShape{20, 20, 16, 16, 3},
        BtfShape{1, 81, 64, 64, 3}, BtfShape{9, 9, 64, 64, 1}, BtfShape{40, 40, 22, 23, 1}}) {
    const auto source = random_source(shape, DType::u8, 3);
    const std::size_t smaller = std::min(shape.texels(), shape.images() * shape.channels);
    for (const Arithmetic arithmetic : {Arithmetic::f32, Arithmetic::f64}) {
      for (const std::size_t rank : {smaller / 8 + 1, smaller / 2}) {
        SvdOptions options;
        options.arithmetic = arithmetic;
        options.rank = rank;
        const std::size_t by_auto = plan_truncated_svd(shared_device(), *source, options).total();
        ASSERT_TRUE(choose_svd(shared_device(), *source, options).verify);
        options.method = SvdMethod::gram;
        const std::size_t by_gram = plan_truncated_svd(shared_device(), *source, options).total();
        // the SVD that a fallback to QR ends with, and blocks of a size of their own
        const std::size_t fallback =
            13 * smaller * smaller * sizeof(double) + (smaller < 64 ? std::size_t{1} << 18 : 0);
        EXPECT_LE(by_auto, by_gram + fallback)
            << smaller << " of " << name_of(arithmetic) << ", rank " << rank;
      }
    }
  }
}

// With a goal, the components may take what the job does not hold otherwise.
TEST(SvdGoal, UsesTheMemoryThereIs) {
  for (const BtfShape& shape : {BtfShape{20, 20, 64, 64, 1}, BtfShape{40, 40, 22, 23, 1}}) {
    const auto source = random_source(shape, DType::u8, 3);
    for (const SvdMethod method : {SvdMethod::gram, SvdMethod::qr, SvdMethod::randomized}) {
      SvdOptions options;
      options.method = method;
      options.tolerance = 0.01;
      const auto planned = [&](std::size_t memory, std::size_t held) {
        Job job;
        job.memory = memory;
        job.held.push_back({"the caller's", held});
        return plan_truncated_svd(shared_device(), *source, options, job).total();
      };
      const std::size_t all = planned(std::size_t{1} << 40, 0);
      const std::size_t least = planned(1, 0);
      const std::size_t held = 1000000;
      const std::size_t between = (all + least) / 2;
      EXPECT_LE(planned(between + held, held), between);
      EXPECT_GE(planned(between + held, held), between - between / 10);
    }
  }
}

// Texture far below the rounding of another image's mean: no component in float, one in double.
TEST_P(SvdWays, SmallComponentsAreKeptInDouble) {
  const BtfShape shape{2, 3, 15, 26, 1};
  std::vector<double> tensor(shape.values(), 1.0);
  std::vector<double> dark = random_values(shape.texels(), 4, -1e-9, 1e-9);
  std::copy(dark.begin(), dark.end(), tensor.end() - static_cast<std::ptrdiff_t>(dark.size()));
  const auto source = source_of(shape, DType::f32, tensor);
  const bool resolved = std::get<2>(GetParam()) == "f64";
  const auto model = encode(*source, {{"rank", "3"}});
  ASSERT_EQ(model->rank, resolved ? 1U : 0U);
  if (!resolved) return;
  std::vector<double> image(shape.image_values());
  pca_codec().reference_decoder(*model)->decode(5, 1, image);
  dark = decode_values(source->bytes(), DType::f32);
  dark.erase(dark.begin(), dark.end() - static_cast<std::ptrdiff_t>(image.size()));
  // the mean, the component and its coefficients as floats
  EXPECT_TRUE(all_near(image, dark, 4 * 3 * float_roundoff * 1e-9));
}

TEST(SvdParameters, AreChecked) {
  const auto source = graded_source(many_texels, 0.8);
  const std::pair<std::string, std::string> wrong[] = {
      {"svd", "lanczos"}, {"svd", ""},        {"arithmetic", "f16"}, {"tolerance", "0"},
      {"tolerance", "1"}, {"tolerance", "x"}, {"tolerance", "-0.1"}, {"energy", "1.5"},
      {"energy", "nan"},  {"energy", ""},     {"rank", "0"},         {"rank", ""}};
  for (const auto& [name, value] : wrong) {
    Job job;
    try {
      pca_codec().encode(shared_device(), *source, {{name, value}}, Storage::f32, job);
      ADD_FAILURE() << "--" << name << " " << value << " was taken";
    } catch (const Error& failure) {
      EXPECT_EQ(failure.kind(), ErrorKind::input);
      EXPECT_NE(std::string(failure.what()).find("--" + name), std::string::npos) << failure.what();
    }
  }
}

// gram and qr take short sides up to 4096, and say what they were given.
TEST(SvdParameters, ShortSidesAreBounded) {
  const auto source = random_source({41, 100, 1, 4097, 1}, DType::u8, 3);
  for (const char* method : {"gram", "qr"}) {
    for (const bool on_device : {true, false}) {
      Job job;
      const Parameters parameters{{"svd", method}, {"rank", "2"}};
      try {
        if (on_device) {
          pca_codec().encode(shared_device(), *source, parameters, Storage::f32, job);
        } else {
          pca_codec().encode_reference(*source, parameters, Storage::f32, job);
        }
        ADD_FAILURE() << "4097 x 4100 was taken";
      } catch (const Error& failure) {
        EXPECT_EQ(failure.kind(), ErrorKind::input);
        EXPECT_NE(std::string(failure.what()).find("4097"), std::string::npos) << failure.what();
      }
    }
  }
}

}  // namespace
}  // namespace weft::test
