// Fits with weights, for every codec of the table, on the device and by the reference: what they
// minimise, what they recover, and what dividing by the weights leaves as it was.
#include "weft/codecs/weighted_fit.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "codecs/codec_runs.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "weft/model/storage.hpp"
#include "weft/reference/factorise.hpp"

namespace weft::test {
namespace {

class WeightedCodec : public testing::TestWithParam<CodecRun> {
 protected:
  const CodecRun& run() const { return GetParam(); }

  std::unique_ptr<Model> fit(TileSource& source, const Parameters& parameters,
                             const Weights& weights, Job& job) const {
    WeightedFit weighted(run().get(), parameters, source, weights, job);
    auto model = run().encode(weighted.source(), parameters, Storage::f32, job);
    weighted.undo(*model);
    return model;
  }
  std::unique_ptr<Model> fit(TileSource& source, const Parameters& parameters,
                             const Weights& weights) const {
    Job job;
    return fit(source, parameters, weights, job);
  }

  // With the given weights.
  double error(const Model& model, TileSource& source, const Weights& weights) const {
    Job job;
    WeightedErrors weighted{weights, {}};
    if (run().on_device) {
      measure_errors(shared_device(), *run().get().decoder(shared_device(), model), source, job,
                     nullptr, &weighted);
    } else {
      measure_errors(*run().get().reference_decoder(model), source, job, nullptr, &weighted);
    }
    return relative(weighted.sums);
  }
};

// Those of codecs that take weights.
std::vector<CodecRun> weighted_runs() {
  std::vector<CodecRun> runs = every_run();
  std::erase_if(runs, [](const CodecRun& run) { return !run.get().takes_weights(); });
  return runs;
}

INSTANTIATE_TEST_SUITE_P(Table, WeightedCodec, testing::ValuesIn(weighted_runs()), run_name);

// Of mean 1, over some powers of ten.
std::vector<double> spread(std::size_t count, std::uint64_t seed, double decades) {
  std::vector<double> weights = random_values(count, seed, -decades / 2, decades / 2);
  double sum = 0;
  for (double& weight : weights) sum += weight = std::pow(10.0, weight);
  for (double& weight : weights) weight *= static_cast<double>(count) / sum;
  return weights;
}

// Texels as products of rows and columns, which every codec takes.
Weights random_weights(const BtfShape& shape, std::uint64_t seed, double decades) {
  Weights weights{spread(shape.views, seed, decades), spread(shape.lights, seed + 1, decades), {}};
  const std::vector<double> rows = spread(shape.height, seed + 2, decades / 2);
  const std::vector<double> columns = spread(shape.width, seed + 3, decades / 2);
  for (const double row : rows) {
    for (const double column : columns) weights.texels.push_back(row * column);
  }
  return weights;
}

// T = sum of `terms` products of one random vector per mode, and noise.
std::shared_ptr<MemorySource> sum_of_products(const BtfShape& shape, std::size_t terms,
                                              double noise, std::uint64_t seed) {
  std::vector<double> values = random_values(shape.values(), seed, -noise, noise);
  const std::array<std::size_t, 5> sizes{shape.views, shape.lights, shape.height, shape.width,
                                         shape.channels};
  for (std::size_t term = 0; term < terms; ++term) {
    std::array<std::vector<double>, 5> vectors;
    for (std::size_t n = 0; n < 5; ++n) {
      vectors[n] = random_values(sizes[n], seed + 7 * term + n + 1, 0.3, 1.0);
    }
    for (std::size_t i = 0; i < values.size(); ++i) {
      double product = 1;
      std::size_t at = i;
      for (std::size_t n = 5; n-- > 0; at /= sizes[n]) product *= vectors[n][at % sizes[n]];
      values[i] += product;
    }
  }
  return std::make_shared<MemorySource>(make_info(shape), encode_values(values, DType::f32));
}

Parameters parameters_of(const CodecRun& run, std::size_t rank) {
  Parameters parameters{{"rank", std::to_string(rank)}};
  if (run.codec == "lpca" || run.codec == "cta" || run.codec == "kcta") {
    parameters["clusters"] = "2";
  }
  return parameters;
}

// Each fit is the better one by its own measure.
TEST_P(WeightedCodec, FitsWhatWeighsMost) {
  const BtfShape shape{6, 7, 8, 9, 3};
  const auto source = sum_of_products(shape, 8, 0.2, 11);
  const Weights weights = random_weights(shape, 5, 2);
  Parameters parameters = parameters_of(run(), 2);
  if (run().codec == "sparse") parameters = {{"atoms", "12"}, {"k1", "2"}, {"k2", "2"}};
  const auto plain = run().encode(*source, parameters, Storage::f32);
  const auto weighted = fit(*source, parameters, weights);
  EXPECT_LT(error(*weighted, *source, weights), 0.99 * error(*plain, *source, weights));
  EXPECT_LT(error(*plain, *source, {}), 0.99 * error(*weighted, *source, {}));
  EXPECT_EQ(weighted->info.btf.dtype, source->info().dtype);
}

// What a model can hold exactly, it holds under any weights.
TEST_P(WeightedCodec, RecoversWhatIsExact) {
  const BtfShape shape{4, 5, 6, 7, 3};
  const auto source = sum_of_products(shape, 2, 0, 3);
  Parameters parameters = parameters_of(run(), 2);
  if (run().codec == "sparse") parameters = {{"rank", "2"}, {"atoms", "1024"}};
  for (const double decades : {1.0, 2.0}) {
    const Weights weights = random_weights(shape, 5, decades);
    const auto model = fit(*source, parameters, weights);
    EXPECT_LT(error(*model, *source, weights), 2e-5) << decades << " decades";
    EXPECT_LT(error(*model, *source, {}), 2e-4) << decades << " decades";
  }
  // from 1e-6 to 1e6: what weighs nothing is lost in rounding, the weighted error is not
  for (const Weights& weights :
       {Weights{spread(4, 1, 12), {}, {}}, Weights{{}, spread(5, 2, 12), {}}}) {
    EXPECT_LT(error(*fit(*source, parameters, weights), *source, weights), 2e-5);
  }
}

// What a model decodes to is divided, whatever its modes and factors are: factors that are powers
// of two leave all bits as they are.
TEST_P(WeightedCodec, DividesWhatIsDecoded) {
  const BtfShape shape{4, 5, 6, 7, 3};
  const auto source = sum_of_products(shape, 5, 0.2, 3);
  const auto powers = [](std::size_t count, std::size_t step) {
    std::vector<double> factors;
    for (std::size_t i = 0; i < count; ++i) {
      factors.push_back(std::exp2(static_cast<double>(i * step % 5) - 2));
    }
    return factors;
  };
  Weights all{powers(shape.views, 3), powers(shape.lights, 2), {}};
  const std::vector<double> rows = powers(shape.height, 4);
  const std::vector<double> columns = powers(shape.width, 3);
  for (const double row : rows) {
    for (const double column : columns) all.texels.push_back(row * column);
  }
  std::vector<Parameters> asked{parameters_of(run(), 2)};
  const std::string& codec = run().codec;
  if (codec == "sparse") asked = {{{"atoms", "8,6"}, {"k1", "2"}, {"k2", "3"}}};
  if (codec == "lpca") asked.push_back({{"clusters", "3"}, {"rank", "1"}});
  if (codec == "tt") asked.push_back({{"rank", "3"}, {"order", "l,v,c,y,x"}});
  if (codec == "tucker") {
    for (const char* merge : {"yxc", "vl,yx", "lc"}) {
      asked.push_back({{"rank", "2"}, {"merge", merge}});
    }
    for (const char* ranks : {"v=2", "l=2,x=3", "y=2,c=2"}) asked.push_back({{"ranks", ranks}});
  }
  if (codec == "cta" || codec == "kcta") {
    for (const char* mode : {"v", "lc", "y"}) {
      asked.push_back({{"rank", "2"}, {"clusters", "2"}, {"mode", mode}});
      asked.push_back({{"rank", "2"}, {"clusters", "2"}, {"mode", mode}, {"global", "none"}});
    }
    asked.push_back({{"ranks", "v=2"}, {"clusters", "2"}});
  }
  for (const Parameters& parameters : asked) {
    const auto model = run().encode(*source, parameters, Storage::f32);
    const auto values = [&] {
      std::vector<double> decoded(shape.values());
      for (std::size_t i = 0; i < decoded.size(); i += 3) {
        const std::size_t p = i / 3 % shape.texels();
        const std::size_t image = i / shape.image_values();
        model->decode_texel(image / shape.lights, image % shape.lights, p / shape.width,
                            p % shape.width, std::span(decoded).subspan(i, 3));
      }
      return decoded;
    };
    std::vector<double> before = values();
    for (const Weights& factors :
         {Weights{all.views, {}, {}}, Weights{{}, all.lights, {}}, Weights{{}, {}, all.texels}}) {
      // a mean is of all texels: it has no part in their weights
      if (!factors.texels.empty() && run().get().removes_mean()) {
        std::size_t n = 0;
        for (const ModelTensor& tensor : model->tensors()) {
          if (tensor.dtype != DType::f32) continue;
          const std::span<float> mean = model->real_values()[n++];
          if (tensor.name == "mean") std::fill(mean.begin(), mean.end(), 0.0f);
        }
        before = values();
      }
      model->divide(factors);
      double largest = 0;
      for (std::size_t i = 0; i < before.size(); ++i) {
        before[i] /= factors.image(i / shape.image_values(), shape.lights) *
                     factors.texel(i / 3 % shape.texels());
        largest = std::max(largest, std::abs(before[i]));
      }
      // sums of double products of the same floats, in the same order
      EXPECT_TRUE(all_near(values(), before, 1e-12 * largest)) << model->info.parameters;
    }
  }
}

TEST_P(WeightedCodec, BitsDoNotDependOnMemory) {
  const BtfShape shape{4, 5, 6, 7, 3};
  const auto source = sum_of_products(shape, 5, 0.2, 3);
  const Weights weights = random_weights(shape, 5, 1);
  Job roomy;
  const auto model = fit(*source, parameters_of(run(), 2), weights, roomy);
  Job tight;  // too little for a quarter of it to hold the weighted input
  tight.memory = shape.values() * sizeof(float) * 3;
  WeightedFit in_file(run().get(), parameters_of(run(), 2), *source, weights, tight);
  tight.memory = roomy.memory;
  auto other = run().encode(in_file.source(), parameters_of(run(), 2), Storage::f32, tight);
  in_file.undo(*other);
  EXPECT_EQ(tensor_bytes(*other), tensor_bytes(*model));
}

// Weights change what a model is fitted to, not what it is: files, selections and single texels.
TEST_P(WeightedCodec, ModelsAreLikeOthers) {
  const BtfShape shape{4, 5, 6, 7, 3};
  const auto source = sum_of_products(shape, 5, 0.2, 3);
  const Weights weights = random_weights(shape, 5, 1);
  auto model = fit(*source, parameters_of(run(), 3), weights);
  model->info.storage = Storage::f16;
  model->info.weights = R"({"given":"cos"})";
  round_to_storage(*model);
  ErrorReport errors;
  errors.weighted = WeightedErrorReport{0.25, 12.5, 3, 0.5};
  model->info.errors = errors;
  const TemporaryFolder folder;
  write_model(folder / "m.weft", *model);
  const auto found = read_model(folder / "m.weft");
  EXPECT_EQ(tensor_bytes(*found), tensor_bytes(*model));
  EXPECT_EQ(found->info.weights, model->info.weights);
  ASSERT_TRUE(found->info.errors && found->info.errors->weighted);
  EXPECT_EQ(found->info.errors->weighted->snr, 3);
  // device and reference within the tolerance of what is there, orthonormal or not
  const double tolerance = run().get().decode_tolerance(*model);
  const std::vector<double> whole = CodecRun{run().codec, true}.decode(*model, 7);
  EXPECT_TRUE(all_near(whole, CodecRun{run().codec, false}.decode(*model, 7), tolerance));
  Selection selection;
  selection.views = {{2}};
  selection.region = Region{1, 2, 3, 2};
  const auto part = run().get().select(*model, selection);
  std::vector<double> texel(3);
  model->decode_texel(2, 4, 3, 2, texel);
  const std::vector<double> images = run().decode(*part, 5);
  const std::size_t at = (4 * part->info.btf.shape.texels() + 3 + 1) * 3;  // row 1, column 1
  EXPECT_TRUE(all_near(std::span(images).subspan(at, 3), texel, tolerance));
}

TEST_P(WeightedCodec, ExtremesOfShapeAndMagnitude) {
  for (const BtfShape& shape :
       {BtfShape{1, 1, 1, 1, 1}, BtfShape{1, 4, 3, 3, 1}, BtfShape{4, 1, 1, 5, 3}}) {
    const Weights weights = random_weights(shape, 5, 2);
    for (const double size : {0.0, 1e-30, 1e20}) {
      std::vector<double> values = random_values(shape.values(), 3, 0.5, 1);
      for (double& value : values) value *= size;
      MemorySource source(make_info(shape), encode_values(values, DType::f32));
      const auto model = fit(source, {{"rank", "1"}}, weights);
      for (const double value : run().decode(*model, 1)) {
        ASSERT_TRUE(std::isfinite(value) && std::abs(value) <= 2 * size) << value;
      }
    }
  }
}

// Weighted principal components in closed form: the tail of the singular values of s (T - m).
TEST_P(WeightedCodec, PcaIsTheBestOfItsRank) {
  if (run().codec != "pca") return;
  const BtfShape shape{5, 4, 6, 7, 3};
  const auto source = sum_of_products(shape, 6, 0.2, 17);
  Weights weights = random_weights(shape, 9, 2);
  weights.texels = spread(shape.texels(), 21, 2);  // no products
  const std::vector<double> T = decode_values(source->bytes(), DType::f32);
  const std::size_t n = shape.images() * 3;
  const std::size_t P = shape.texels();
  std::vector<double> X(n * P);
  double squares = 0;
  for (std::size_t r = 0; r < n; ++r) {
    const double* row = T.data() + r / 3 * P * 3 + r % 3;
    double mean = 0;
    for (std::size_t p = 0; p < P; ++p) mean += weights.texels[p] * row[p * 3];
    mean /= static_cast<double>(P);
    for (std::size_t p = 0; p < P; ++p) {
      const double s = std::sqrt(weights.image(r / 3, shape.lights) * weights.texels[p]);
      X[r * P + p] = s * (row[p * 3] - mean);
      squares += s * row[p * 3] * s * row[p * 3];
    }
  }
  const std::vector<double> sigma = reference::thin_svd(n, P, X).values;
  for (const std::size_t rank : Sizes{1, 3, 6}) {
    double tail = 0;
    for (std::size_t i = rank; i < sigma.size(); ++i) tail += sigma[i] * sigma[i];
    const auto model = fit(*source, {{"rank", std::to_string(rank)}}, weights);
    const double best = std::sqrt(tail / squares);
    const double found = error(*model, *source, weights);
    EXPECT_GT(found, best * (1 - 1e-5)) << "rank " << rank;
    EXPECT_LT(found, best * (1 + 1e-4)) << "rank " << rank;
  }
}

// Two clusters of affine subspaces of their own, weights of texels within each over four decades.
TEST_P(WeightedCodec, LpcaFindsAffineClusters) {
  if (run().codec != "lpca") return;
  const BtfShape shape{4, 5, 6, 8, 3};
  const std::size_t n = shape.images() * 3;
  std::vector<double> values(shape.values());
  const std::vector<double> rows = random_values(6 * n, 4, -1, 1);
  const std::vector<double> A = random_values(2 * shape.texels(), 6, -1, 1);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t p = i / 3 % shape.texels();
    const std::size_t r = i / shape.image_values() * 3 + i % 3;
    const std::size_t g = p % 8 < 4 ? 0 : 3 * n;
    values[i] = 3 * rows[g + r] + A[2 * p] * rows[g + n + r] + A[2 * p + 1] * rows[g + 2 * n + r];
  }
  MemorySource source(make_info(shape), encode_values(values, DType::f32));
  Weights weights = random_weights(shape, 9, 1);
  weights.texels = spread(shape.texels(), 21, 1);
  const auto model = fit(source, {{"rank", "2"}, {"clusters", "2"}}, weights);
  EXPECT_LT(error(*model, source, weights), 1e-4);
  EXPECT_LT(error(*model, source, {}), 1e-3);
}

TEST_P(WeightedCodec, TexelsThatAreNoProducts) {
  const BtfShape shape{3, 4, 6, 7, 3};
  const auto source = sum_of_products(shape, 2, 0, 3);
  const Weights weights{{}, {}, spread(shape.texels(), 3, 2)};
  Parameters parameters = parameters_of(run(), 2);
  if (run().codec == "sparse") parameters = {{"rank", "2"}, {"atoms", "1024"}};
  if (run().get().separates_texels(parameters, shape)) {
    expect_error(ErrorKind::input, {"--weights", "products"},
                 [&] { fit(*source, parameters, weights); });
    if (run().codec == "tt") return;
    parameters["merge"] = "yx";
  }
  EXPECT_LT(error(*fit(*source, parameters, weights), *source, weights), 2e-5);
}

// The definition, summed directly.
TEST_P(WeightedCodec, WeightedErrorsAreSumsWithWeights) {
  const BtfShape shape{3, 4, 17, 13, 3};
  const auto source = random_source(shape, DType::u8, 9);
  const Weights weights = random_weights(shape, 5, 2);
  const auto model = run().encode(*source, parameters_of(run(), 2), Storage::f16);
  const std::vector<double> T = decode_values(source->bytes(), DType::u8);
  const std::vector<double> decoded = run().decode(*model, 5);
  double reference = 0;
  double difference = 0;
  for (std::size_t i = 0; i < T.size(); ++i) {
    const double w = weights.image(i / shape.image_values(), shape.lights) *
                     weights.texels[i / 3 % shape.texels()];
    reference += w * T[i] * T[i];
    difference += w * (T[i] - decoded[i]) * (T[i] - decoded[i]);
  }
  EXPECT_NEAR(error(*model, *source, weights), std::sqrt(difference / reference),
              1e-4 * std::sqrt(difference / reference));
}

TEST(WeightedFit, CodecsThatTakeNoWeightsSayIt) {
  const auto source = random_source({2, 3, 4, 5, 3}, DType::f16, 5);
  Weights weights;
  weights.views = {0.5, 1.5};
  for (const CodecRun& run : every_run()) {
    if (run.get().takes_weights()) continue;
    Job job;
    expect_error(ErrorKind::input, {"--weights", run.codec},
                 [&] { WeightedFit(run.get(), {}, *source, weights, job); });
    WeightedFit(run.get(), {}, *source, {}, job);  // all are equal: there are none
  }
}

}  // namespace
}  // namespace weft::test
