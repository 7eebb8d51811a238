// PCA models: written, read back bit for bit, decoded by hand.
#include "weft/model/pca.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "model/small_pca.hpp"
#include "support/expect_error.hpp"
#include "support/temporary_folder.hpp"
#include "weft/model/storage.hpp"

namespace weft {
namespace {

using test::expect_error;
using test::small_pca;
using test::TemporaryFolder;

void expect_same_bits(const std::vector<float>& found, const std::vector<float>& wanted,
                      const char* what) {
  ASSERT_EQ(found.size(), wanted.size()) << what;
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_EQ(std::bit_cast<std::uint32_t>(found[i]), std::bit_cast<std::uint32_t>(wanted[i]))
        << what << " at " << i << ": " << found[i] << " instead of " << wanted[i];
  }
}

void expect_round_trip(const PcaModel& model) {
  TemporaryFolder folder;
  const std::size_t size = write_model(folder / "m.weft", model);
  EXPECT_EQ(size, std::filesystem::file_size(folder / "m.weft"));
  EXPECT_EQ(size, model_file_size(model));
  const ModelFile file(folder / "m.weft");
  EXPECT_EQ(file.size(), size);
  const auto found = PcaModel::read(file);
  EXPECT_EQ(found->rank, model.rank);
  expect_same_bits(found->mean, model.mean, "mean");
  expect_same_bits(found->coefficients, model.coefficients, "coefficients");
  expect_same_bits(found->basis, model.basis, "basis");
}

TEST(PcaModel, ReadsBackTheBitsThatWereRounded) {
  for (const Storage storage : {Storage::f16, Storage::f32}) {
    for (const double magnitude : {1e-45, 1e-42, 1e-38, 1e-30, 1.0, 65505.0, 1e30, 1e38, 3.4e38}) {
      SCOPED_TRACE(magnitude);
      PcaModel model = small_pca(storage, 3, magnitude);
      round_to_storage(model);
      expect_round_trip(model);
    }
  }
}

TEST(PcaModel, SmallestShapesAndRankZero) {
  for (const Storage storage : {Storage::f16, Storage::f32}) {
    for (const std::size_t rank : {0u, 1u}) {
      PcaModel model = small_pca(storage, rank, 1.0, {1, 1, 1, 1, 1});
      model.info.errors.reset();
      model.info.btf.mask.clear();
      round_to_storage(model);
      expect_round_trip(model);
    }
  }
}

TEST(PcaModel, RoundingIsRelativeToEachComponent) {
  PcaModel model = small_pca(Storage::f16, 2);
  const std::size_t row = model.basis.size() / 2;
  for (std::size_t i = 0; i < row; ++i) model.basis[i] *= 1e30f;
  const std::vector<float> before = model.basis;
  round_to_storage(model);
  for (std::size_t i = 0; i < before.size(); ++i) {
    // As derived in component_scale_test.cpp.
    const double largest = i < row ? 1e30 : 1.0;
    EXPECT_LE(std::abs(double{model.basis[i]} - double{before[i]}),
              std::max(std::abs(double{before[i]}) * 0x1p-11, largest * 0x1p-39));
  }
  PcaModel exact = small_pca(Storage::f32, 2);
  const std::vector<float> mean = exact.mean;
  round_to_storage(exact);
  expect_same_bits(exact.mean, mean, "mean");
}

TEST(PcaModel, DecodesByTheFormula) {
  PcaModel model;
  model.info.btf = test::make_info({2, 1, 2, 3, 2});
  model.rank = 2;
  model.mean = {10, 20, 30, 40};                              // [V, L, C]
  model.coefficients = {1, 2, 3, 4, 5, 6, 7, 8, 9, 0, 5, 5};  // [P, k]
  model.basis = {1, 2, 3, 4, 100, 200, 300, 400};             // [k, V, L, C]
  std::vector<double> out(2);
  model.decode_texel(0, 0, 0, 0, out);
  EXPECT_EQ(out, (std::vector<double>{10 + 1 + 200, 20 + 2 + 400}));
  model.decode_texel(1, 0, 0, 1, out);
  EXPECT_EQ(out, (std::vector<double>{30 + 3 * 3 + 4 * 300, 40 + 3 * 4 + 4 * 400}));
  model.decode_texel(1, 0, 1, 0, out);  // texel 3
  EXPECT_EQ(out, (std::vector<double>{30 + 7 * 3 + 8 * 300, 40 + 7 * 4 + 8 * 400}));
}

TEST(PcaModel, TensorsThatDoNotFitEachOtherAreRefused) {
  TemporaryFolder folder;
  // The writer trusts shapes made from info and rank; a lying model lies in both.
  class Lying final : public Model {
   public:
    std::vector<ModelTensor> list;
    std::vector<ModelTensor> tensors() const override { return list; }
    std::vector<std::span<float>> real_values() override { return {}; }
    void divide(const Weights&) override {}
    void fitted_texel(std::size_t, std::size_t, std::size_t, std::size_t,
                      std::span<double>) const override {}
  };
  const PcaModel model = small_pca(Storage::f16);
  const auto path = folder / "m.weft";
  const auto expect_refused = [&](std::initializer_list<std::string_view> parts,
                                  const auto& change) {
    Lying lying;
    lying.info = model.info;
    lying.list = model.tensors();
    change(lying);
    write_model(path, lying);
    expect_error(ErrorKind::input, parts, [&] { PcaModel::read(ModelFile(path)); });
  };
  expect_refused({"m.weft", "coefficients", "[40]"}, [](Lying& m) { m.list[1].shape = {40}; });
  expect_refused({"m.weft", "coefficients", "[10, 4]", "[20, 4]"}, [](Lying& m) {
    m.list[1].shape = {10, 4};
  });
  expect_refused({"m.weft", "basis", "[2, 3, 2, 3]", "[2, 2, 3, 3]"}, [](Lying& m) {
    m.list[2].shape = {2, 3, 2, 3};
  });
  expect_refused({"m.weft", "mean", "[18]"}, [](Lying& m) { m.list[0].shape = {18}; });
  expect_refused({"m.weft", "no tensor \"mean\""}, [](Lying& m) { m.list.erase(m.list.begin()); });
  expect_refused({"m.weft", "no tensor \"basis\""}, [](Lying& m) { m.list.pop_back(); });
  expect_refused({"m.weft", "coefficients.scale", "[1]", "[2]"},
                 [](Lying& m) { m.list[1].component_axis = ModelTensor::no_component_axis; });
  expect_refused({"m.weft", "codec", "vq"}, [](Lying& m) { m.info.codec = "vq"; });
}

}  // namespace
}  // namespace weft
