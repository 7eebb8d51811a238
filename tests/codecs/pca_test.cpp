// The codec `pca` end to end, on the device and by the reference: error against the best rank-k
// error, exact recovery, monotonicity, selections, extremes.
#include "weft/codecs/pca.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/error.hpp"
#include "weft/model/pca.hpp"
#include "weft/reference/factorise.hpp"

namespace weft {
namespace {

using test::MemorySource;

// T[v, l, p, c] = mean + A[p, (v, l, c)], A of zero column means and about the given singular
// values.
// The singular values of the mean-removed unfolding of a tensor.
std::vector<double> centred_singular_values(const BtfShape& shape,
                                            const std::vector<double>& tensor) {
  const std::size_t texels = shape.texels();
  const std::size_t n = shape.images() * shape.channels;
  std::vector<double> A(texels * n);
  for (std::size_t image = 0; image < shape.images(); ++image) {
    for (std::size_t c = 0; c < shape.channels; ++c) {
      double mean = 0;
      for (std::size_t p = 0; p < texels; ++p) {
        mean += tensor[(image * texels + p) * shape.channels + c];
      }
      mean /= static_cast<double>(texels);
      for (std::size_t p = 0; p < texels; ++p) {
        A[p * n + image * shape.channels + c] =
            tensor[(image * texels + p) * shape.channels + c] - mean;
      }
    }
  }
  return reference::thin_svd(texels, n, A).values;
}

// T[v, l, p, c] = mean + A[p, (v, l, c)].
std::vector<double> tensor_of(const BtfShape& shape, const std::vector<double>& A, double mean) {
  const std::size_t texels = shape.texels();
  const std::size_t n = shape.images() * shape.channels;
  std::vector<double> tensor(shape.values());
  for (std::size_t image = 0; image < shape.images(); ++image) {
    for (std::size_t p = 0; p < texels; ++p) {
      for (std::size_t c = 0; c < shape.channels; ++c) {
        tensor[(image * texels + p) * shape.channels + c] =
            mean + A[p * n + image * shape.channels + c];
      }
    }
  }
  return tensor;
}

Parameters rank_parameter(std::size_t rank) {
  return {{"rank", std::to_string(rank)}};
}

class PcaCodec : public testing::TestWithParam<bool> {
 protected:
  // Whether this run is on the device.
  bool on_device() const { return GetParam(); }

  std::unique_ptr<Model> encode(TileSource& source, std::size_t rank, Storage storage,
                                Job job = {}) {
    return on_device() ? pca_codec().encode(device_, source, rank_parameter(rank), storage, job)
                       : pca_codec().encode_reference(source, rank_parameter(rank), storage, job);
  }

  ErrorSums measure(const Model& model, TileSource& source, Job job = {}) {
    if (on_device()) {
      const auto decoder = pca_codec().decoder(device_, model);
      return measure_errors(device_, *decoder, source, job);
    }
    const auto decoder = pca_codec().reference_decoder(model);
    return measure_errors(*decoder, source, job);
  }

  // All values of a model, decoded in runs of `run` images.
  std::vector<double> decode(const Model& model, std::size_t run) {
    const BtfShape& shape = model.info.btf.shape;
    std::vector<double> values(shape.values());
    Buffer buffer(device_, run * shape.image_values() * sizeof(float), "decoded");
    const auto on_device = pca_codec().decoder(device_, model);
    const auto reference = pca_codec().reference_decoder(model);
    for (std::size_t first = 0; first < shape.images(); first += run) {
      const std::size_t count = std::min(run, shape.images() - first);
      const std::span<double> out =
          std::span(values).subspan(first * shape.image_values(), count * shape.image_values());
      if (this->on_device()) {
        std::vector<float> floats(out.size());
        on_device->decode(first, count, buffer);
        device_.read(buffer, std::span<float>(floats));
        std::copy(floats.begin(), floats.end(), out.begin());
      } else {
        reference->decode(first, count, out);
      }
    }
    return values;
  }

  // One device for all cases: what it has built is used again.
  static void SetUpTestSuite() { shared_device = std::make_unique<Device>("auto"); }
  static void TearDownTestSuite() { shared_device.reset(); }
  static inline std::unique_ptr<Device> shared_device;
  Device& device_ = *shared_device;
};

double relative(const ErrorSums& sums) {
  return std::sqrt(sums.square_difference / sums.square_reference);
}

std::vector<double> low_rank_tensor(const BtfShape& shape, std::size_t rank, double magnitude,
                                    double mean) {
  std::vector<double> values(rank);
  for (std::size_t i = 0; i < rank; ++i) values[i] = 1.0 / static_cast<double>(i + 1);
  std::vector<double> A = test::matrix_with_singular_values(
      shape.texels(), shape.images() * shape.channels, values, 11);
  for (double& value : A) value *= magnitude;
  return tensor_of(shape, A, mean);
}

INSTANTIATE_TEST_SUITE_P(Paths, PcaCodec, testing::Bool(), [](const auto& info) {
  return info.param ? std::string("Device") : std::string("Reference");
});

// The promise: within 1 % of the best rank-k error wherever that is above 1e-5 of the data.
TEST_P(PcaCodec, ErrorIsWithinOnePercentOfTheBest) {
  const BtfShape shape{5, 7, 12, 13, 3};
  const std::size_t smaller = 105;
  const auto spectrum = [&](const auto& value) {
    std::vector<double> values(smaller);
    for (std::size_t i = 0; i < smaller; ++i) values[i] = value(static_cast<double>(i));
    return values;
  };
  const std::pair<const char*, std::vector<double>> spectra[] = {
      {"1 / i", spectrum([](double i) { return 1 / (i + 1); })},
      {"1 / sqrt i", spectrum([](double i) { return 1 / std::sqrt(i + 1); })},
      {"geometric 0.95", spectrum([](double i) { return std::pow(0.95, i); })},
      {"geometric 0.8", spectrum([](double i) { return std::pow(0.8, i); })},
      {"geometric 0.5", spectrum([](double i) { return std::pow(0.5, i); })},
      {"flat", spectrum([](double) { return 1.0; })},
      {"step", spectrum([](double i) { return i < 9 ? 1.0 : 1e-2; })},
      {"far step", spectrum([](double i) { return i < 30 ? 1.0 : 1e-3; })},
      {"staircase", spectrum([](double i) { return std::pow(10.0, -std::floor(i / 10)); })}};
  for (const auto& [name, values] : spectra) {
    for (const std::size_t rank : {std::size_t{1}, std::size_t{9}, std::size_t{16}}) {
      SCOPED_TRACE(std::string(name) + ", rank " + std::to_string(rank));
      const auto A = test::matrix_with_singular_values(shape.texels(), smaller, values, 7);
      // What is stored is float: the best error is that of the stored values.
      const auto source = test::source_of(shape, DType::f32, tensor_of(shape, A, 0.1));
      const auto stored = test::decode_values(source->bytes(), DType::f32);
      const std::vector<double> sigma = centred_singular_values(shape, stored);
      double best = 0;
      for (std::size_t i = rank; i < sigma.size(); ++i) best += sigma[i] * sigma[i];
      best = std::sqrt(best);

      const auto model = encode(*source, rank, Storage::f32);
      const ErrorSums sums = measure(*model, *source);
      const double error = std::sqrt(sums.square_difference);
      const double norm = std::sqrt(sums.square_reference);
      if (best / norm > 1e-5) {
        EXPECT_LE(error, 1.01 * best) << "relative " << best / norm;
      } else {
        EXPECT_LE(error / norm, 1.01e-5);
      }
      EXPECT_GE(error, 0.999 * best - 1e-6 * norm);
    }
  }
}

// Data of rank 4 (3, and 1 that removing the mean may add or take) come back to float rounding: the
// stored factors carry 2^-24 each, the sum of k + 1 terms gamma_{k+1}.
TEST_P(PcaCodec, RecoversDataOfLowRank) {
  const BtfShape shape{4, 3, 9, 31, 3};
  const auto source = test::source_of(shape, DType::f32, low_rank_tensor(shape, 3, 1.0, 0.25));
  for (const std::size_t rank : {std::size_t{4}, std::size_t{20}}) {
    const auto model = encode(*source, rank, Storage::f32);
    const double k = static_cast<double>(dynamic_cast<const PcaModel&>(*model).rank);
    EXPECT_LE(relative(measure(*model, *source)), 4 * (k + 3) * 0x1p-24);
  }
}

TEST_P(PcaCodec, ErrorFallsWithRank) {
  const BtfShape shape{5, 5, 16, 15, 3};
  const auto source = test::random_source(shape, DType::f16, 3);
  double previous = std::numeric_limits<double>::infinity();
  for (const std::size_t rank : {1, 2, 4, 8, 16, 32, 64}) {
    const double error = relative(measure(*encode(*source, rank, Storage::f32), *source));
    EXPECT_LT(error, previous) << "rank " << rank;
    previous = error;
  }
}

// Half storage rounds every stored number by at most 2^-11 of itself: |dA B| <= 2^-11 sqrt(k) |B|,
// |A dB| <= 2^-11 |B|, and the mean by 2^-11 of its norm.
TEST_P(PcaCodec, HalfStorageCostsWhatItsRoundingAllows) {
  const BtfShape shape{5, 5, 16, 15, 3};
  for (const double magnitude : {1e-30, 1.0, 1e30}) {
    const auto source =
        test::source_of(shape, DType::f32, low_rank_tensor(shape, 40, magnitude, 0.1 * magnitude));
    const std::size_t rank = 8;
    const ErrorSums full = measure(*encode(*source, rank, Storage::f32), *source);
    const ErrorSums half = measure(*encode(*source, rank, Storage::f16), *source);
    const double norm = std::sqrt(full.square_reference);
    const double allowed = 0x1p-11 * (std::sqrt(8.0) + 2) * 1.01 * norm;
    EXPECT_LE(std::sqrt(half.square_difference), std::sqrt(full.square_difference) + allowed);
    EXPECT_GT(half.square_difference, full.square_difference);
  }
}

TEST_P(PcaCodec, RunsOfAnyLengthDecodeAlike) {
  const BtfShape shape{3, 5, 7, 9, 3};
  const auto source = test::random_source(shape, DType::f16, 5);
  const auto model = encode(*source, 5, Storage::f16);
  const std::vector<double> whole = decode(*model, shape.images());
  for (const std::size_t run : {std::size_t{1}, std::size_t{4}, std::size_t{14}}) {
    EXPECT_TRUE(test::all_equal(decode(*model, run), whole)) << "runs of " << run;
  }
}

TEST_P(PcaCodec, SelectionsAreParts) {
  const BtfShape shape{4, 5, 7, 9, 3};
  const auto source = test::random_source(shape, DType::f16, 5);
  const auto model = encode(*source, 6, Storage::f16);
  const std::vector<double> whole = decode(*model, shape.images());
  Selection selection;
  selection.views = {{3, 0}};
  selection.lights = {{1, 4, 2}};
  selection.region = Region{2, 1, 5, 6};
  selection.channels = {{2, 0}};
  const auto part = pca_codec().select(*model, selection);
  ASSERT_EQ(part->info.btf.shape, (BtfShape{2, 3, 6, 5, 2}));
  const std::vector<double> values = decode(*part, 6);
  std::vector<double> expected;
  for (const std::size_t v : *selection.views) {
    for (const std::size_t l : *selection.lights) {
      for (std::size_t y = 1; y < 7; ++y) {
        for (std::size_t x = 2; x < 7; ++x) {
          for (const std::size_t c : *selection.channels) {
            expected.push_back(
                whole[(((v * shape.lights + l) * shape.height + y) * shape.width + x) * 3 + c]);
          }
        }
      }
    }
  }
  // The same products; a device may fuse them otherwise in the last texels of a row of panels.
  EXPECT_TRUE(test::all_near(values, expected, pca_codec().decode_tolerance(*model)));
}

TEST_P(PcaCodec, OneTexelIsThatOfTheImage) {
  const BtfShape shape{3, 4, 5, 6, 3};
  const auto source = test::random_source(shape, DType::f16, 5);
  const auto model = encode(*source, 5, Storage::f16);
  const std::vector<double> whole = decode(*model, shape.images());
  const double tolerance = pca_codec().decode_tolerance(*model);
  std::vector<double> texel(3);
  for (std::size_t i = 0; i < shape.values(); i += 3) {
    const std::size_t p = i / 3 % shape.texels();
    const std::size_t image = i / shape.image_values();
    model->decode_texel(image / shape.lights, image % shape.lights, p / shape.width,
                        p % shape.width, texel);
    ASSERT_TRUE(test::all_near(texel, std::span(whole).subspan(i, 3), tolerance));
  }
}

// A model of either encoder is decoded by both, within the bound that `weft verify` uses; and both
// encoders reach the same error.
TEST_P(PcaCodec, DeviceAndReferenceAgree) {
  const BtfShape shape{4, 4, 17, 13, 3};
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    const auto source = test::random_source(shape, dtype, 9);
    const auto model = encode(*source, 7, Storage::f16);
    const auto decoder = pca_codec().decoder(device_, *model);
    const auto reference = pca_codec().reference_decoder(*model);
    Job job;
    const ErrorSums by_device = measure_errors(device_, *decoder, *source, job);
    const ErrorSums by_reference = measure_errors(*reference, *source, job);
    EXPECT_NEAR(relative(by_device), relative(by_reference), 1e-5 * relative(by_reference));
    const auto other =
        on_device() ? pca_codec().encode_reference(*source, rank_parameter(7), Storage::f16, job)
                    : pca_codec().encode(device_, *source, rank_parameter(7), Storage::f16, job);
    EXPECT_NEAR(relative(measure(*other, *source)), relative(by_reference),
                0.01 * relative(by_reference));
  }
}

TEST_P(PcaCodec, Extremes) {
  const BtfShape shapes[] = {{1, 1, 1, 1, 1},  {1, 1, 1, 1, 3}, {1, 1, 8, 8, 3}, {1, 12, 6, 5, 3},
                             {9, 1, 6, 5, 3},  {3, 3, 1, 1, 3}, {3, 3, 6, 5, 1}, {2, 2, 5, 5, 7},
                             {2, 3, 1, 40, 4}, {3, 2, 40, 1, 2}};
  for (const BtfShape& shape : shapes) {
    for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
      SCOPED_TRACE(testing::PrintToString(shape.values()) + " values of " +
                   std::string(name_of(dtype)));
      // full rank and beyond: exact but for rounding
      const auto random = test::random_source(shape, dtype, 4, 0.25, 1.0);
      const auto model = encode(*random, 1000, Storage::f32);
      EXPECT_LE(relative(measure(*model, *random)), 1e-5);
      // all zero, and constant: the mean alone
      for (const double constant : {0.0, 0.5}) {
        const auto flat =
            test::source_of(shape, dtype, std::vector<double>(shape.values(), constant));
        const auto mean_only = encode(*flat, 4, Storage::f32);
        EXPECT_EQ(dynamic_cast<const PcaModel&>(*mean_only).rank, 0U);
        // 8-bit values are not floats: the mean is rounded.
        EXPECT_LE(measure(*mean_only, *flat).max_difference, constant * 0x1p-24);
      }
    }
  }
}

TEST_P(PcaCodec, MagnitudesFrom1eMinus30To1e30) {
  const BtfShape shape{3, 4, 9, 10, 3};
  for (const double magnitude : {1e-42, 1e-38, 1e-30, 1e-10, 1e10, 1e30}) {
    const auto source =
        test::source_of(shape, DType::f32, low_rank_tensor(shape, 3, magnitude, 0.1 * magnitude));
    const auto model = encode(*source, 4, Storage::f32);
    // What is left of subnormal data has absolute steps of 2^-149.
    const ErrorSums sums = measure(*model, *source);
    const double steps = 0x1p-149 * std::sqrt(static_cast<double>(sums.count)) * 16;
    EXPECT_LE(std::sqrt(sums.square_difference),
              28 * 0x1p-24 * std::sqrt(sums.square_reference) + steps)
        << magnitude;
  }
}

TEST_P(PcaCodec, RefusesNaNAndNamesTheFirst) {
  const BtfShape shape{2, 3, 4, 5, 3};
  std::vector<double> values = test::random_values(shape.values(), 3);
  // view 1, light 0, row 2, column 3, channel 1; and a later one
  values[(((1 * 3 + 0) * 4 + 2) * 5 + 3) * 3 + 1] = std::numeric_limits<double>::quiet_NaN();
  values[values.size() - 1] = std::numeric_limits<double>::infinity();
  for (const DType dtype : {DType::f16, DType::f32}) {
    const auto source = test::source_of(shape, dtype, values);
    try {
      encode(*source, 2, Storage::f16);
      ADD_FAILURE() << "NaN was accepted";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
      EXPECT_NE(std::string(error.what()).find("view 1, light 0, row 2, column 3, channel 1"),
                std::string::npos)
          << error.what();
    }
    Job job;
    job.nan_zero = true;
    const auto model = encode(*source, 60, Storage::f32, job);
    EXPECT_LE(relative(measure(*model, *source, job)), 1e-5);
  }
}

// The same bits whatever the memory limit, and whether the input is mapped or read.
TEST_P(PcaCodec, SameBitsWhateverTheMemory) {
  const BtfShape shape{6, 7, 12, 11, 3};
  const auto values = test::random_values(shape.values(), 8);
  const auto bytes = test::encode_values(values, DType::f16);
  MemorySource mapped(test::make_info(shape, DType::f16), bytes, true);
  MemorySource read(test::make_info(shape, DType::f16), bytes, false);
  Job small;
  small.memory = std::size_t{64} << 20;
  const auto first = encode(mapped, 5, Storage::f16);
  const auto second = encode(read, 5, Storage::f16, small);
  const auto& a = dynamic_cast<const PcaModel&>(*first);
  const auto& b = dynamic_cast<const PcaModel&>(*second);
  EXPECT_TRUE(test::all_equal(a.mean, b.mean));
  EXPECT_TRUE(test::all_equal(a.coefficients, b.coefficients));
  EXPECT_TRUE(test::all_equal(a.basis, b.basis));
}

TEST_P(PcaCodec, RefusesWhatDoesNotFit) {
  const BtfShape shape{3, 4, 9, 10, 3};
  const auto source = test::random_source(shape, DType::f16, 4);
  Job job;
  job.memory = 1000;
  try {
    encode(*source, 4, Storage::f16, job);
    ADD_FAILURE() << "1000 bytes were enough";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    EXPECT_NE(std::string(error.what()).find("--memory 1000"), std::string::npos) << error.what();
  }
}

TEST(PcaParameters, AreChecked) {
  Device device("auto");
  const auto source = test::random_source({1, 2, 3, 4, 3}, DType::f16, 4);
  for (const char* rank : {"0", "-1", "x", "", "3.5", "99999999999999999999999"}) {
    Job job;
    EXPECT_THROW(pca_codec().encode(device, *source, {{"rank", rank}}, Storage::f16, job), Error)
        << rank;
  }
}

}  // namespace
}  // namespace weft
