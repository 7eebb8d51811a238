// The codec `lpca`: exact recovery of what it can hold, errors that never rise, one cluster as
// `pca`, and clusterings at their extremes.
#include "weft/codecs/lpca.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "codecs/codec_runs.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "weft/codecs/fit_lpca.hpp"
#include "weft/codecs/texel_basis.hpp"
#include "weft/model/lpca.hpp"
#include "weft/reference/lpca.hpp"

namespace weft::test {
namespace {

const LpcaModel& as_lpca(const Model& model) {
  return dynamic_cast<const LpcaModel&>(model);
}

Parameters parameters(std::size_t clusters, std::size_t rank) {
  return {{"clusters", std::to_string(clusters)}, {"rank", std::to_string(rank)}};
}

// Texels of `clusters` affine subspaces of dimension `rank`, scattered over the image, with means
// `distance` apart.
struct Separable {
  std::shared_ptr<MemorySource> source;
  std::vector<std::size_t> cluster;  // of each texel
};

Separable separable(const BtfShape& shape, std::size_t clusters, std::size_t rank, double distance,
                    double magnitude = 1.0) {
  const std::size_t n = shape.images() * shape.channels;
  Random random(12);
  const std::vector<double> means = random_values(clusters * n, 21, -1, 1);
  const std::vector<double> bases = random_values(clusters * rank * n, 22, -1, 1);
  Separable data;
  std::vector<double> values(shape.values());
  for (std::size_t p = 0; p < shape.texels(); ++p) {
    const std::size_t g = random.index(clusters);
    data.cluster.push_back(g);
    std::vector<double> a(rank);
    for (double& value : a) value = random.normal();
    for (std::size_t r = 0; r < n; ++r) {
      double value = distance * means[g * n + r];
      for (std::size_t j = 0; j < rank; ++j) value += a[j] * bases[(g * rank + j) * n + r];
      values[(r / shape.channels * shape.texels() + p) * shape.channels + r % shape.channels] =
          magnitude * value;
    }
  }
  data.source = source_of(shape, DType::f32, values);
  return data;
}

class Lpca : public testing::TestWithParam<bool> {
 protected:
  CodecRun run() const { return {"lpca", GetParam()}; }
  double error(TileSource& source, const Parameters& chosen) const {
    return relative(run().measure(*run().encode(source, chosen, Storage::f32), source));
  }
};

INSTANTIATE_TEST_SUITE_P(Paths, Lpca, testing::Bool(), [](const auto& info) {
  return info.param ? std::string("Device") : std::string("Reference");
});

// Data of exact local subspaces comes back to float rounding: factors and data are rounded by 2^-24
// each, and sums have k + 1 terms; texels in one subspace share a cluster.
TEST_P(Lpca, RecoversSeparableClusters) {
  for (const double magnitude : {1e-30, 1.0, 1e29}) {
    const Separable data = separable({4, 5, 16, 15, 3}, 5, 3, 4.0, magnitude);
    const auto model = run().encode(*data.source, parameters(5, 3), Storage::f32);
    EXPECT_LE(relative(run().measure(*model, *data.source)), 8 * (3 + 3) * 0x1p-24) << magnitude;
    std::map<std::size_t, std::size_t> number;
    for (std::size_t p = 0; p < data.cluster.size(); ++p) {
      const std::size_t found = as_lpca(*model).clusters[p];
      ASSERT_EQ(number.emplace(data.cluster[p], found).first->second, found);
    }
    EXPECT_EQ(number.size(), 5U);
  }
}

// One subspace less than the data needs, or one component, and the error is there.
TEST_P(Lpca, TooFewClustersOrComponentsAreNoticed) {
  const Separable data = separable({4, 5, 16, 15, 3}, 5, 3, 4.0);
  EXPECT_GT(error(*data.source, parameters(4, 3)), 1e-2);
  EXPECT_GT(error(*data.source, parameters(5, 2)), 1e-2);
}

// One cluster is a PCA: both are within 1 % of the best error.
TEST_P(Lpca, OneClusterIsPca) {
  const auto source = random_source({5, 7, 12, 13, 3}, DType::f16, 3);
  const CodecRun pca{"pca", GetParam()};
  const double best =
      relative(pca.measure(*pca.encode(*source, {{"rank", "9"}}, Storage::f32), *source));
  const auto model = run().encode(*source, parameters(1, 9), Storage::f32);
  EXPECT_EQ(as_lpca(*model).ranks.size(), 1U);
  EXPECT_NEAR(relative(run().measure(*model, *source)), best, 0.01 * best);
}

// As many terms per value, a smaller error, on data that is not one subspace.
TEST_P(Lpca, BeatsPcaAtEqualDecodeCost) {
  const Separable data = separable({5, 5, 20, 20, 3}, 6, 6, 2.0);
  const CodecRun pca{"pca", GetParam()};
  const double global =
      relative(pca.measure(*pca.encode(*data.source, {{"rank", "4"}}, Storage::f32), *data.source));
  EXPECT_LT(error(*data.source, parameters(6, 4)), 0.7 * global);
}

// The encoders find the same clusters where they are separable, and components within 1 % of the
// best error: one less here than the data has.
TEST_P(Lpca, BothEncodersReachTheSameError) {
  const Separable data = separable({4, 5, 16, 15, 3}, 5, 3, 4.0);
  const Parameters chosen = parameters(5, 2);
  const double own = error(*data.source, chosen);
  const CodecRun other{"lpca", !GetParam()};
  const double others =
      relative(other.measure(*other.encode(*data.source, chosen, Storage::f32), *data.source));
  EXPECT_NEAR(own, others, 0.01 * others);
}

TEST_P(Lpca, MoreClustersThanTexels) {
  const auto source = random_source({3, 4, 3, 4, 3}, DType::f16, 4);
  const auto model = run().encode(*source, parameters(1000, 2), Storage::f32);
  EXPECT_LE(as_lpca(*model).ranks.size(), 12U);
  // A cluster of up to three texels is exact at rank 2.
  EXPECT_LE(relative(run().measure(*model, *source)), 1e-6);
}

// Texels of three kinds need no more than three clusters, and no component.
TEST_P(Lpca, DuplicateTexels) {
  const BtfShape shape{3, 4, 10, 12, 3};
  const std::vector<double> kinds = random_values(3 * shape.images() * 3, 8);
  std::vector<double> values(shape.values());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t p = i / 3 % shape.texels();
    const std::size_t row = i / shape.image_values() * 3 + i % 3;
    values[i] = kinds[p * p % 3 * shape.images() * 3 + row];
  }
  const auto source = source_of(shape, DType::f32, values);
  const auto model = run().encode(*source, parameters(8, 4), Storage::f32);
  EXPECT_LE(relative(run().measure(*model, *source)), 4 * 0x1p-24);
  EXPECT_LE(as_lpca(*model).ranks.size(), 3U);
}

// A cluster of few texels has a lower rank than was asked, and stores no more.
TEST_P(Lpca, ClustersKeepWhatTheyHold) {
  const Separable data = separable({4, 5, 16, 15, 3}, 5, 3, 4.0);
  const auto model = run().encode(*data.source, parameters(5, 40), Storage::f32);
  const LpcaModel& lpca = as_lpca(*model);
  std::vector<std::size_t> sizes(lpca.ranks.size(), 0);
  for (std::size_t p = 0; p < lpca.clusters.size(); ++p) ++sizes[lpca.clusters[p]];
  std::size_t sum = 0;
  for (std::size_t g = 0; g < sizes.size(); ++g) {
    EXPECT_GT(sizes[g], 0U);
    EXPECT_LT(lpca.ranks[g], sizes[g]);
    sum += lpca.ranks[g];
  }
  EXPECT_EQ(lpca.basis.size(), sum * 20 * 3);
  EXPECT_LE(relative(run().measure(*model, *data.source)), 1e-5);
}

TEST_P(Lpca, TheSeedDecides) {
  const auto source = random_source({4, 5, 16, 15, 3}, DType::f16, 4);
  const auto encode = [&](std::uint64_t seed) {
    Job job;
    job.seed = seed;
    return run().encode(*source, parameters(6, 2), Storage::f32, job);
  };
  const auto first = encode(1);
  const auto again = encode(1);
  EXPECT_EQ(as_lpca(*first).coefficients, as_lpca(*again).coefficients);
  EXPECT_EQ(as_lpca(*first).basis, as_lpca(*again).basis);
  EXPECT_NE(as_lpca(*first).coefficients, as_lpca(*encode(2)).coefficients);
}

TEST_P(Lpca, ParametersAreChecked) {
  const auto source = random_source({1, 2, 3, 4, 3}, DType::f16, 4);
  const auto encode = [&](const Parameters& chosen) {
    return run().encode(*source, chosen, Storage::f16);
  };
  expect_error(ErrorKind::input, {"--clusters", "0"}, [&] { encode({{"clusters", "0"}}); });
  expect_error(ErrorKind::input, {"--clusters", "few"}, [&] { encode({{"clusters", "few"}}); });
  expect_error(ErrorKind::input, {"--iterations", "-1"}, [&] { encode({{"iterations", "-1"}}); });
  EXPECT_NO_THROW(encode({{"iterations", "0"}}));
}

// No fit is worse than the one before, on data without structure and on data with it; and the last
// error is the measured one.
TEST(LpcaErrors, NeverRise) {
  const BtfShape shape{5, 5, 24, 20, 3};
  const auto random = random_source(shape, DType::f16, 4);
  const Separable overlapping = separable(shape, 9, 5, 0.5);
  const Separable exact = separable(shape, 4, 2, 4.0);
  const CodecRun run{"lpca", true};
  for (TileSource* source :
       {static_cast<TileSource*>(random.get()), static_cast<TileSource*>(overlapping.source.get()),
        static_cast<TileSource*>(exact.source.get())}) {
    for (const std::size_t rank : Sizes{1, 2, 5}) {
      Job job;
      LpcaFit fit = fit_lpca(shared_device(), *source, {9, rank, 20}, job);
      ASSERT_FALSE(fit.errors.empty());
      for (const std::vector<double>* errors : {&fit.errors, &fit.reduced_errors}) {
        for (std::size_t i = 1; i < errors->size(); ++i) {
          EXPECT_LE((*errors)[i], (*errors)[i - 1]) << "fit " << i;
        }
      }
      fit.model->info.codec = "lpca";
      fit.model->info.storage = Storage::f32;
      fit.model->info.btf = source->info();
      const double measured = relative(run.measure(*fit.model, *source));
      // A difference of squares in float resolves errors to about 1e-3 of the data.
      EXPECT_NEAR(measured, fit.errors.back(), 1e-3 * measured + 1e-3);

      const reference::LpcaFit plain = reference::encode_lpca(*source, {9, rank, 20}, job);
      for (std::size_t i = 1; i < plain.errors.size(); ++i) {
        EXPECT_LE(plain.errors[i], plain.errors[i - 1] * (1 + 1e-12) + 1e-12) << "fit " << i;
      }
    }
  }
}

TEST(LpcaMemory, IsForeseenAndKept) {
  Device device("auto");
  const auto source = random_source({6, 6, 40, 40, 3}, DType::f16, 4);
  std::size_t planned = 0;
  Job job;
  job.on_plan = [&](const MemoryPlan& plan) { planned = plan.total(); };
  lpca_codec().encode(device, *source, parameters(16, 6), Storage::f16, job);
  EXPECT_GT(planned, 0U);
  EXPECT_LE(device.peak_allocated(), planned);
  Job small;
  small.memory = planned - 1;
  expect_error(ErrorKind::input, {"--memory"}, [&] {
    lpca_codec().encode(device, *source, parameters(16, 6), Storage::f16, small);
  });
}

// Whatever is asked for, sizes do not overflow on the way to being refused.
TEST(LpcaMemory, RefusesWhatNoDeviceHolds) {
  const auto source = random_source({6, 6, 64, 64, 3}, DType::u8, 4);
  for (const Parameters& chosen :
       {Parameters{{"clusters", "100000000000"}, {"rank", "100000000000"}},
        parameters(4096, 108)}) {
    Job job;
    expect_error(ErrorKind::input, {},
                 [&] { lpca_codec().encode(shared_device(), *source, chosen, Storage::f16, job); });
  }
}

// Within each cluster: unit columns, orthogonal, of zero sum, and as many as the texels allow.
TEST(TexelBasis, IsOrthonormalWithinClusters) {
  const std::size_t k = 4;
  std::vector<std::uint32_t> labels{0, 1, 1, 3, 3, 3};
  for (std::size_t p = 6; p < 40; ++p) labels.push_back(p % 2 == 0 ? 4 : 5);
  std::vector<float> coefficients = random_floats(labels.size() * k, 3, -1, 1);
  // cluster 5 has nothing but one column, a constant, and a copy
  for (std::size_t p = 0; p < labels.size(); ++p) {
    if (labels[p] != 5) continue;
    coefficients[p * k + 1] = 2.0f;
    coefficients[p * k + 2] = -3 * coefficients[p * k];
    coefficients[p * k + 3] = 0.0f;
  }
  const std::vector<float> U = texel_basis(labels, 6, k, coefficients, 1);
  for (std::size_t g = 0; g < 6; ++g) {
    std::vector<std::size_t> members;
    for (std::size_t p = 0; p < labels.size(); ++p) {
      if (labels[p] == g) members.push_back(p);
    }
    const std::size_t rank = members.empty() ? 0 : std::min(k, members.size() - 1);
    // float columns of up to 17 values
    const double tolerance = 32 * 0x1p-24;
    for (std::size_t i = 0; i < k; ++i) {
      double sum = 0;
      for (const std::size_t p : members) sum += double{U[p * k + i]};
      EXPECT_NEAR(sum, 0, tolerance);
      for (std::size_t j = 0; j < k; ++j) {
        double product = 0;
        for (const std::size_t p : members) product += double{U[p * k + i]} * double{U[p * k + j]};
        EXPECT_NEAR(product, i == j && i < rank ? 1.0 : 0.0, tolerance)
            << "cluster " << g << ", columns " << i << " and " << j;
      }
    }
  }
}

TEST(EmptyClusters, TakeTheWorstTexelsOfTheWorst) {
  std::vector<std::uint32_t> labels{0, 0, 0, 0, 1, 1, 3};
  const std::vector<float> errors{1, 5, 2, 4, 3, 3, 100};
  // Cluster 3 is the worst, but has one texel only.
  EXPECT_EQ(fill_empty_clusters(labels, 4, errors), 1U);
  EXPECT_EQ(labels, (std::vector<std::uint32_t>{0, 2, 0, 2, 1, 1, 3}));
  // without errors there is nothing to be gained
  std::vector<std::uint32_t> exact{0, 0, 0};
  EXPECT_EQ(fill_empty_clusters(exact, 3, std::vector<float>{0, 0, 0}), 0U);
  EXPECT_EQ(exact, (std::vector<std::uint32_t>{0, 0, 0}));
}

}  // namespace
}  // namespace weft::test
