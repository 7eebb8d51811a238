// The codec `pca` end to end, on the device and by the reference: error against the best rank-k
// error, exact recovery, monotonicity, selections, extremes.
#include "weft/codecs/pca.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
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
struct Spectrum {
  BtfShape shape;
  std::vector<double> values;
  std::vector<double> tensor;
};

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

  Device device_{"auto"};
};

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

}  // namespace
}  // namespace weft
