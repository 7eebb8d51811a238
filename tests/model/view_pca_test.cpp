// Models of a PCA per view: decoded by hand, and files whose tensors do not fit each other.
#include "weft/model/view_pca.hpp"

#include <gtest/gtest.h>

#include "model/lying_model.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/temporary_folder.hpp"

namespace weft::test {
namespace {

// Two views with 1 and 2 components, one light, two texels, two channels.
ViewPcaModel small_model(Storage storage) {
  ViewPcaModel model;
  model.info.codec = "view-pca";
  model.info.storage = storage;
  model.info.btf = make_info({2, 1, 1, 2, 2}, DType::f16);
  model.ranks = IndexTensor(std::vector<std::uint32_t>{1, 2}, 3);
  model.mean = {10, 20, 30, 40};
  model.images = {1, 2, 3, 4, 5, 6};
  model.basis = {1, -1, 2, 3, 4, 5};
  return model;
}

TEST(ViewPcaModel, DecodesByTheFormula) {
  const ViewPcaModel model = small_model(Storage::f32);
  std::vector<double> out(2);
  model.decode_texel(0, 0, 0, 1, out);
  EXPECT_EQ(out, (std::vector<double>{10 + 2 * 1, 20 - 2 * 1}));
  model.decode_texel(1, 0, 0, 0, out);
  EXPECT_EQ(out, (std::vector<double>{30 + 3 * 2 + 5 * 4, 40 + 3 * 3 + 5 * 5}));
  EXPECT_EQ(model.offsets(), (std::vector<std::size_t>{0, 1, 3}));
}

TEST(ViewPcaModel, TensorsThatDoNotFitEachOtherAreRefused) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  const ViewPcaModel model = small_model(Storage::f16);
  const auto expect_refused = [&](std::initializer_list<std::string_view> parts,
                                  const auto& change) {
    LyingModel lying(model);
    change(lying);
    write_model(path, lying);
    expect_error(ErrorKind::input, parts, [&] { ViewPcaModel::read(ModelFile(path)); });
  };
  const IndexTensor too_many(std::vector<std::uint32_t>{1, 9}, 10);
  const IndexTensor too_few(std::vector<std::uint32_t>{1, 1}, 10);
  expect_refused({"m.weft", "ranks", "9 at index 1"},
                 [&](LyingModel& m) { m.list[0].values = too_many.bytes(); });
  expect_refused({"m.weft", "images", "[3, 2]", "[2, 2]"},
                 [&](LyingModel& m) { m.list[0].values = too_few.bytes(); });
  expect_refused({"m.weft", "images", "[6]"}, [](LyingModel& m) { m.list[2].shape = {6}; });
  expect_refused({"m.weft", "basis", "[3, 2, 1]"}, [](LyingModel& m) {
    m.list[3].shape = {3, 2, 1};
  });
  expect_refused({"m.weft", "mean", "[4]"}, [](LyingModel& m) { m.list[1].shape = {4}; });
  expect_refused({"m.weft", "no tensor \"ranks\""},
                 [](LyingModel& m) { m.list.erase(m.list.begin()); });
  expect_refused({"m.weft", "codec", "pca"}, [](LyingModel& m) { m.info.codec = "pca"; });
}

TEST(IndexTensor, IsAsSmallAsItsLimitAllows) {
  const std::vector<std::uint32_t> indices{0, 200, 7};
  for (const auto& [limit, dtype] : {std::pair<std::size_t, DType>{256, DType::u8},
                                     {257, DType::u16},
                                     {65536, DType::u16},
                                     {65537, DType::u32}}) {
    const IndexTensor tensor(indices, limit);
    EXPECT_EQ(tensor.dtype(), dtype);
    EXPECT_EQ(tensor.bytes().size(), 3 * size_of(dtype));
    for (std::size_t i = 0; i < indices.size(); ++i) EXPECT_EQ(tensor[i], indices[i]);
  }
}

}  // namespace
}  // namespace weft::test
