// The codec `sparse`: data of sparse tensors, errors that add up, and what is refused.
#include "weft/codecs/sparse.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "codecs/codec_runs.hpp"
#include "codecs/sparse_source.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "weft/codecs/fit_sparse.hpp"
#include "weft/reference/sparse.hpp"

namespace weft::test {
namespace {

const SparseModel& as_sparse(const Model& model) {
  return dynamic_cast<const SparseModel&>(model);
}

Parameters parameters(std::size_t k1, std::size_t k2, const char* atoms = "24,20",
                      const char* rank = "40") {
  return {{"k1", std::to_string(k1)},
          {"k2", std::to_string(k2)},
          {"atoms", atoms},
          {"rank", rank},
          {"iterations", "10"}};
}

class Sparse : public testing::TestWithParam<bool> {
 protected:
  CodecRun run() const { return {"sparse", GetParam()}; }
};

INSTANTIATE_TEST_SUITE_P(Paths, Sparse, testing::Bool(), [](const auto& info) {
  return info.param ? std::string("Device") : std::string("Reference");
});

// A dictionary of every texel and every fibre holds anything.
TEST_P(Sparse, HoldsEverythingWithAnAtomForEverySignal) {
  for (const double magnitude : {1e-30, 1.0, 1e30}) {
    std::vector<double> values = random_values(2 * 3 * 30 * 3, 6, -1, 1);
    for (double& value : values) value *= magnitude;
    const auto source = source_of({2, 3, 6, 5, 3}, DType::f32, values);
    const auto model = run().encode(*source, {{"k1", "1"}, {"k2", "1"}}, Storage::f32);
    EXPECT_EQ(as_sparse(*model).abrdf_atoms, 30U);
    EXPECT_EQ(as_sparse(*model).light_atoms, 60U);
    EXPECT_LE(relative(run().measure(*model, *source)), 1e-5);
  }
}

// Longer lists, and more atoms, hold more of the data.
TEST_P(Sparse, ErrorsFallWithTerms) {
  const auto source = sparse_source(sparse_material);
  double before = 1;
  for (const std::size_t k : Sizes{1, 2, 4, 6}) {
    const auto model = run().encode(*source, parameters(k, k), Storage::f32);
    EXPECT_EQ(as_sparse(*model).views.length, k);
    EXPECT_EQ(as_sparse(*model).texels.length, k);
    const double error = relative(run().measure(*model, *source));
    EXPECT_LT(error, before);
    before = error;
  }
}

// Section 4.2: the squared error is well approximated by the sum of those of the approximations.
TEST_P(Sparse, ErrorsAddUp) {
  const auto source = sparse_source(sparse_material, 0.1);
  Job job;
  const SparseOptions options = [] {
    SparseOptions o;
    o.view_terms = 3;
    o.texel_terms = 3;
    o.light_atoms = 24;
    o.abrdf_atoms = 20;
    o.rank = 40;
    o.iterations = 10;
    o.storage = Storage::f32;
    return o;
  }();
  SparseFit fit = GetParam() ? fit_sparse(shared_device(), *source, options, job)
                             : reference::encode_sparse(*source, options, job);
  fit.model->info.btf = source->info();
  const double reached = relative(run().measure(*fit.model, *source));
  EXPECT_GT(fit.errors.projection, 0);
  EXPECT_GT(fit.errors.texels, 0);
  EXPECT_GT(fit.errors.views, 0);
  // Only inner products of the three errors are left out; at their worst they make sqrt(3).
  EXPECT_LE(reached, std::sqrt(3.0) * fit.errors.foreseen());
  EXPECT_NEAR(reached, fit.errors.foreseen(), 0.15 * reached);
}

TEST_P(Sparse, UpdatesOfAtomsDoAlike) {
  const auto source = sparse_source(sparse_material);
  for (const char* update : {"exact", "approximate"}) {
    Parameters chosen = parameters(3, 3);
    chosen["update"] = update;
    const double error =
        relative(run().measure(*run().encode(*source, chosen, Storage::f16), *source));
    EXPECT_LT(error, 0.6) << update;
  }
}

TEST_P(Sparse, UnmadeAtomsAndBytesOfIndices) {
  const auto source = sparse_source(sparse_material);
  const auto model = run().encode(*source, parameters(3, 3, "300,16"), Storage::f16);
  const SparseModel& sparse = as_sparse(*model);
  EXPECT_LE(sparse.abrdf_atoms, 16U);
  EXPECT_LE(sparse.light_atoms, 16U * 6U);
  EXPECT_EQ(sparse.texels.atoms.dtype(), DType::u8);
}

TEST_P(Sparse, ParametersAreChecked) {
  const auto source = random_source({1, 2, 3, 4, 3}, DType::f16, 4);
  const auto refused = [&](const Parameters& chosen,
                           std::initializer_list<std::string_view> parts) {
    expect_error(ErrorKind::input, parts, [&] { run().encode(*source, chosen, Storage::f16); });
  };
  for (const char* text : {"0", "x", "", "1,", ",1", "1,2,3", "65537", "-4", "2 "}) {
    refused({{"atoms", text}}, {"--atoms", text});
  }
  for (const char* name : {"k1", "k2", "iterations"}) {
    for (const char* text : {"0", "-1", "x", "2.5"}) {
      refused({{name, text}}, {std::string("--") + name, text});
    }
  }
  refused({{"k1", "9"}, {"atoms", "8"}}, {"--k1 9", "8 atoms"});
  refused({{"k2", "9"}, {"atoms", "16,8"}}, {"--k2 9", "8 atoms"});
  refused({{"update", "best"}}, {"--update best"});
  refused({{"target", "psnr=40"}}, {"--target psnr=40"});
}

}  // namespace
}  // namespace weft::test
