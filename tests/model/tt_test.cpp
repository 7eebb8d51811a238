// Tensor train models: decoded by the formula in every order of modes, written and read back, cores
// stored as half and as float side by side, and files whose tensors do not fit each other.
#include "weft/model/tt.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "model/lying_model.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "weft/model/storage.hpp"

namespace weft::test {
namespace {

TtModel random_train(const BtfShape& shape, const ModeOrder& order,
                     const std::array<std::size_t, mode_count + 1>& ranks) {
  TtModel model;
  model.info.codec = "tt";
  model.info.storage = Storage::f16;
  model.info.btf = make_info(shape, DType::f16);
  model.order = order;
  model.ranks = ranks;
  for (std::size_t n = 0; n < mode_count; ++n) {
    model.cores[n] = random_floats(ranks[n] * model.size(n) * ranks[n + 1], 7 + n, -1, 1);
  }
  return model;
}

// One value by the formula: the sum over all ranks, term by term.
double term_by_term(const TtModel& model, const std::array<std::size_t, mode_count>& index,
                    std::size_t n = 0, std::size_t left = 0) {
  if (n == mode_count) return 1;
  double sum = 0;
  for (std::size_t right = 0; right < model.ranks[n + 1]; ++right) {
    const std::size_t i = index[index_of(model.order[n])];
    sum += double{model.cores[n][(left * model.size(n) + i) * model.ranks[n + 1] + right]} *
           term_by_term(model, index, n + 1, right);
  }
  return sum;
}

TEST(TtModel, DecodesByTheFormulaInEveryOrder) {
  const BtfShape shape{3, 2, 4, 5, 3};
  ModeOrder order = all_modes;
  do {
    const TtModel model = random_train(shape, order, {1, 2, 3, 2, 3, 1});
    std::vector<double> out(shape.channels);
    for (std::size_t i = 0; i < shape.values() / shape.channels; i += 7) {
      const std::size_t x = i % shape.width, y = i / shape.width % shape.height;
      const std::size_t l = i / shape.texels() % shape.lights, v = i / shape.texels() / 2;
      model.decode_texel(v, l, y, x, out);
      for (std::size_t c = 0; c < shape.channels; ++c) {
        // 2 x 3 x 2 x 3 products of five values below 1, in double
        ASSERT_NEAR(out[c], term_by_term(model, {v, l, y, x, c}), 36 * 10 * 0x1p-53)
            << to_text(order);
      }
    }
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST(TtModel, CountsOperations) {
  // Corduroy, TT (1) of the paper's Table 1: two vector-matrix products up to the channels' core,
  // one matrix-vector product from the right, three products with what is between.
  TtModel model;
  model.info.btf.shape = {81, 81, 256, 256, 3};
  model.ranks = {1, 61, 488, 131, 23, 1};
  EXPECT_EQ(model.texel_operations(),
            (2 * 61 - 1) * 488 + 3 * (2 * 488 - 1) * 131 + 131 * (2 * 23 - 1) + 3 * (2 * 131 - 1));
  // from one end to the other where the channels are there
  model.order = parse_order("c,x,y,v,l", "--order");
  EXPECT_EQ(model.texel_operations(),
            488 * (2 * 131 - 1) + 61 * (2 * 488 - 1) + 131 * (2 * 23 - 1) + 3 * (2 * 61 - 1));
}

TEST(TtModel, KeepsHalfAndFloatCoresInOneFile) {
  const TemporaryFolder folder;
  TtModel model =
      random_train({3, 2, 4, 5, 3}, parse_order("l,x,c,y,v", "--order"), {1, 2, 4, 3, 2, 1});
  model.stored = {Storage::f32, Storage::f16, Storage::f16, Storage::f32, Storage::f16};
  const auto exact = model.cores;
  round_to_storage(model);
  EXPECT_TRUE(all_equal(model.cores[0], exact[0]));
  EXPECT_FALSE(all_equal(model.cores[1], exact[1]));
  EXPECT_TRUE(all_equal(model.cores[3], exact[3]));
  EXPECT_EQ(write_model(folder / "m.weft", model), model_file_size(model));
  const auto found = TtModel::read(ModelFile(folder / "m.weft"));
  EXPECT_EQ(found->order, model.order);
  EXPECT_EQ(found->ranks, model.ranks);
  EXPECT_EQ(found->stored, model.stored);
  for (std::size_t n = 0; n < mode_count; ++n) {
    EXPECT_TRUE(all_equal(found->cores[n], model.cores[n])) << n;
  }
}

TEST(TtModel, SelectionsAreSlices) {
  const TtModel model =
      random_train({3, 4, 5, 6, 3}, parse_order("y,v,c,x,l", "--order"), {1, 2, 3, 4, 2, 1});
  Selection selection;
  selection.views = {{2, 0}};
  selection.lights = {{1, 3}};
  selection.region = Region{2, 1, 3, 2};
  selection.channels = {{2}};
  const auto part = model.select(selection);
  std::vector<double> whole(3), found(1);
  for (std::size_t v = 0; v < 2; ++v) {
    for (std::size_t y = 0; y < 2; ++y) {
      for (std::size_t x = 0; x < 3; ++x) {
        part->decode_texel(v, 1, y, x, found);
        model.decode_texel((*selection.views)[v], 3, y + 1, x + 2, whole);
        EXPECT_EQ(found[0], whole[2]);
      }
    }
  }
}

TEST(TtModel, TensorsThatDoNotFitEachOtherAreRefused) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  const TtModel model =
      random_train({3, 2, 4, 5, 3}, parse_order("x,y,c,v,l", "--order"), {1, 2, 4, 3, 2, 1});
  const auto expect_refused = [&](std::initializer_list<std::string_view> parts,
                                  const auto& change) {
    LyingModel lying(model);
    change(lying);
    write_model(path, lying);
    expect_error(ErrorKind::input, parts, [&] { TtModel::read(ModelFile(path)); });
  };
  const std::array<std::uint8_t, 5> twice{0, 1, 2, 3, 3}, beyond{0, 1, 2, 3, 5};
  expect_refused({"m.weft", "order", "mode 3 twice"},
                 [&](LyingModel& m) { m.list[0].values = std::as_bytes(std::span(twice)); });
  expect_refused({"m.weft", "order", "5 at index 4"},
                 [&](LyingModel& m) { m.list[0].values = std::as_bytes(std::span(beyond)); });
  expect_refused({"m.weft", "order", "[1, 5]"}, [](LyingModel& m) { m.list[0].shape = {1, 5}; });
  expect_refused({"m.weft", "core.x", "[5, 2]"}, [](LyingModel& m) { m.list[1].shape = {5, 2}; });
  expect_refused({"m.weft", "core.x", "[2, 5, 1]", "[1, 5, 1]"}, [](LyingModel& m) {
    m.list[1].shape = {2, 5, 1};
  });
  expect_refused({"m.weft", "core.y", "[4, 4, 2]", "[2, 4, 2]"}, [](LyingModel& m) {
    m.list[2].shape = {4, 4, 2};
  });
  expect_refused({"m.weft", "core.y", "[2, 4, 0]"}, [](LyingModel& m) {
    m.list[2].shape = {2, 4, 0};
    m.list[2].values = {};
  });
  expect_refused({"m.weft", "core.l", "[1, 2, 2]"}, [](LyingModel& m) {
    m.list[5].shape = {1, 2, 2};
  });
  expect_refused({"m.weft", "no tensor \"core.v\""},
                 [](LyingModel& m) { m.list.erase(m.list.begin() + 4); });
  expect_refused({"m.weft", "codec", "vq"}, [](LyingModel& m) { m.info.codec = "vq"; });
}

TEST(Modes, OrdersAreAllModesOnce) {
  EXPECT_EQ(to_text(parse_order("l,c,x,v,y", "--order")), "l,c,x,v,y");
  for (const char* text : {"", "x", "x,y,c,v", "x,y,c,v,l,", "x,y,c,v,v", "x,y,c,v,k", "xycvl"}) {
    expect_error(ErrorKind::input, {"--order", text}, [&] { parse_order(text, "--order"); });
  }
}

}  // namespace
}  // namespace weft::test
