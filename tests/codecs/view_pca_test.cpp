// The codec `view-pca`: each view is its own PCA, no better and no worse.
#include "weft/codecs/view_pca.hpp"

#include <gtest/gtest.h>

#include "codecs/codec_runs.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "weft/btf/view_source.hpp"
#include "weft/model/view_pca.hpp"

namespace weft::test {
namespace {

class ViewPca : public testing::TestWithParam<bool> {
 protected:
  CodecRun views() const { return {"view-pca", GetParam()}; }
  CodecRun pca() const { return {"pca", GetParam()}; }
};

INSTANTIATE_TEST_SUITE_P(Paths, ViewPca, testing::Bool(), [](const auto& info) {
  return info.param ? std::string("Device") : std::string("Reference");
});

const ViewPcaModel& as_view_pca(const Model& model) {
  return dynamic_cast<const ViewPcaModel&>(model);
}

// The squared error is the sum of those of `pca` on the views; both within 1 % of the best.
TEST_P(ViewPca, IsAPcaOfEachView) {
  const auto source = random_source({3, 20, 11, 9, 3}, DType::f16, 2);
  const Parameters parameters{{"rank", "6"}};
  double squares = 0;
  for (std::size_t v = 0; v < 3; ++v) {
    ViewSource view(*source, v);
    squares += pca().measure(*pca().encode(view, parameters, Storage::f32), view).square_difference;
  }
  const auto model = views().encode(*source, parameters, Storage::f32);
  EXPECT_NEAR(views().measure(*model, *source).square_difference, squares, 0.02 * squares);
  EXPECT_EQ(as_view_pca(*model).offsets(), (std::vector<std::size_t>{0, 6, 12, 18}));
}

// Views keep what they hold: a view of rank r takes r components, whatever was asked.
TEST_P(ViewPca, EachViewHasItsOwnRank) {
  const BtfShape shape{3, 8, 10, 12, 3};
  const std::size_t rows = shape.lights * shape.channels;
  const std::size_t view_ranks[] = {0, 2, 5};
  std::vector<double> values(shape.values());
  for (std::size_t v = 0; v < shape.views; ++v) {
    const std::vector<double> sigma(view_ranks[v], 1.0);
    const auto A = sigma.empty() ? std::vector<double>(shape.texels() * rows, 0.25)
                                 : matrix_with_singular_values(shape.texels(), rows, sigma, 5 + v);
    for (std::size_t r = 0; r < rows; ++r) {
      // means are removed, so that they add no component
      double mean = 0;
      for (std::size_t p = 0; p < shape.texels(); ++p) mean += A[p * rows + r];
      mean /= static_cast<double>(shape.texels());
      for (std::size_t p = 0; p < shape.texels(); ++p) {
        const std::size_t image = v * shape.lights + r / shape.channels;
        values[(image * shape.texels() + p) * shape.channels + r % shape.channels] =
            A[p * rows + r] - mean + 0.5;
      }
    }
  }
  const auto source = source_of(shape, DType::f32, values);
  const auto model = views().encode(*source, {{"rank", "7"}}, Storage::f32);
  const std::vector<std::size_t> offsets = as_view_pca(*model).offsets();
  // Float rounding of the data may be taken for a component, but no more than asked.
  EXPECT_EQ(offsets[1], 0U);
  EXPECT_GE(offsets[2] - offsets[1], 2U);
  EXPECT_LE(offsets[2] - offsets[1], 7U);
  EXPECT_GE(offsets[3] - offsets[2], 5U);
  EXPECT_LE(offsets[3] - offsets[2], 7U);
  EXPECT_LE(relative(views().measure(*model, *source)), 4 * 10 * 0x1p-24);
}

TEST_P(ViewPca, BothEncodersReachTheSameError) {
  const auto source = random_source({4, 9, 12, 10, 3}, DType::f16, 4);
  const Parameters parameters{{"rank", "5"}};
  const double error =
      relative(views().measure(*views().encode(*source, parameters, Storage::f32), *source));
  const CodecRun other{"view-pca", !GetParam()};
  EXPECT_NEAR(relative(other.measure(*other.encode(*source, parameters, Storage::f32), *source)),
              error, 0.01 * error);
}

}  // namespace
}  // namespace weft::test
