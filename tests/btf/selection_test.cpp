#include "weft/btf/selection.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <numeric>
#include <vector>

#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "weft/btf/encoding.hpp"
#include "weft/btf/mip.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

using test::decode_values;
using test::make_info;
using test::MemorySource;
using test::source_of;

using Indices = std::vector<std::size_t>;

template <typename Action>
void expect_input_error(Action action, const std::string& message) {
  try {
    action();
    ADD_FAILURE() << "no error; expected: " << message;
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    EXPECT_STREQ(error.what(), message.c_str());
  }
}

TEST(Selection, AsJson) {
  EXPECT_EQ(to_json(Selection{}), "{}");
  Selection selection;
  selection.views = Indices{3, 1};
  selection.region = Region{1, 2, 3, 4};
  selection.level = 2;
  EXPECT_EQ(to_json(selection),
            R"({"views":[3,1],"region":{"x":1,"y":2,"width":3,"height":4},"level":2})");
}

// Every value is its own index, so that it tells where it came from.
std::shared_ptr<MemorySource> counting_source(const BtfShape& shape, bool mapped = false) {
  std::vector<double> values(shape.values());
  std::iota(values.begin(), values.end(), 0.0);
  BtfInfo info = make_info(shape, DType::f32);
  return std::make_shared<MemorySource>(info, test::encode_values(values, DType::f32), mapped);
}

std::vector<double> read_all(TileSource& source) {
  std::vector<std::byte> bytes(source.info().bytes());
  source.read(0, source.info().shape.images(), bytes);
  return decode_values(bytes, source.info().dtype);
}

constexpr BtfShape shape{3, 4, 5, 6, 3};

double index_of(std::size_t v, std::size_t l, std::size_t y, std::size_t x, std::size_t c) {
  return static_cast<double>(
      (((v * shape.lights + l) * shape.height + y) * shape.width + x) * shape.channels + c);
}

TEST(Selection, NothingSelectedIsTheSourceItself) {
  const auto source = counting_source(shape);
  EXPECT_EQ(select(source, Selection{}).get(), source.get());
}

TEST(Selection, EveryPartAtOnceGathersTheRightValues) {
  Selection selection;
  selection.views = Indices{2, 0};
  selection.lights = Indices{3, 1, 2};
  selection.region = Region{1, 2, 4, 3};
  selection.channels = Indices{2, 0};
  for (const bool mapped : {false, true}) {
    const auto source = counting_source(shape, mapped);
    const auto selected = select(source, selection);
    const BtfInfo& info = selected->info();
    ASSERT_EQ(info.shape, (BtfShape{2, 3, 3, 4, 2}));
    EXPECT_EQ(info.view_directions[1], source->info().view_directions[0]);
    EXPECT_EQ(info.light_directions[0], source->info().light_directions[3]);
    std::vector<double> expected;
    for (const std::size_t v : *selection.views) {
      for (const std::size_t l : *selection.lights) {
        for (std::size_t y = 2; y < 5; ++y) {
          for (std::size_t x = 1; x < 5; ++x) {
            for (const std::size_t c : *selection.channels) {
              expected.push_back(index_of(v, l, y, x, c));
            }
          }
        }
      }
    }
    EXPECT_EQ(read_all(*selected), expected);
    // Image by image gives the same.
    std::vector<std::byte> image(info.image_bytes());
    selected->read(4, 1, image);
    EXPECT_EQ(decode_values(image, DType::f32),
              std::vector<double>(expected.begin() + 4 * 24, expected.begin() + 5 * 24));
  }
}

TEST(Selection, RunsOfWholeImagesStayRunsAndStayMapped) {
  Selection selection;
  selection.views = Indices{1, 2};
  const auto source = counting_source(shape, true);
  const auto selected = select(source, selection);
  const auto bytes = selected->mapped(0, 8);
  ASSERT_EQ(bytes.size(), selected->info().bytes());
  EXPECT_EQ(bytes.data(), source->bytes().data() + 4 * source->info().image_bytes());
  std::vector<std::byte> copy(bytes.size());
  selected->read(0, 8, copy);
  EXPECT_EQ(source->largest_read(), 8u);

  selection.lights = Indices{0, 2};
  const auto gaps = select(source, selection);
  EXPECT_EQ(gaps->mapped(1, 1).data(), source->bytes().data() + 6 * source->info().image_bytes());
  EXPECT_TRUE(gaps->mapped(0, 2).empty());
  selection.region = Region{0, 0, 6, 4};
  EXPECT_TRUE(select(source, selection)->mapped(0, 1).empty());
}

TEST(Selection, ReversedChannelsAreNoWholeImages) {
  Selection selection;
  selection.channels = Indices{2, 1, 0};
  const auto selected = select(counting_source(shape, true), selection);
  EXPECT_TRUE(selected->mapped(0, 1).empty());
  const std::vector<double> values = read_all(*selected);
  EXPECT_EQ(values[0], 2);
  EXPECT_EQ(values[2], 0);
}

TEST(Selection, WhatDoesNotFitIsNamed) {
  const BtfInfo info = make_info(shape);
  const auto error = [&](const Selection& selection, const std::string& message) {
    expect_input_error([&] { select(info, selection); }, message);
  };
  Selection selection;
  selection.views = Indices{0, 3};
  error(selection, "view selection: 3 is out of range: there are 3, counted from 0");
  selection.views = Indices{};
  error(selection, "view selection: nothing is selected");
  selection = {};
  selection.lights = Indices{1, 1};
  error(selection, "light selection: 1 is repeated");
  selection = {};
  selection.channels = Indices{3};
  error(selection, "channel selection: 3 is out of range: there are 3, counted from 0");
  selection = {};
  selection.region = Region{4, 0, 3, 1};
  error(selection, "region 4,0,3x1 does not lie within 6 x 5 texels");
  selection.region = Region{static_cast<std::size_t>(-1), 0, 2, 1};
  error(selection, "region 18446744073709551615,0,2x1 does not lie within 6 x 5 texels");
  selection = {};
  selection.level = 4;
  error(selection, "mip level 4: the last one of 6 x 5 texels is 3");
  selection.level = static_cast<std::size_t>(-1);
  error(selection, "mip level 18446744073709551615: the last one of 6 x 5 texels is 3");
}

TEST(Selection, PairsAreSelectedAsViews) {
  BtfInfo info = make_info({3, 1, 1, 1, 1});
  info.layout = Layout::paired;
  info.light_directions = info.view_directions;
  Selection selection;
  selection.views = Indices{2, 0};
  const BtfInfo result = select(info, selection);
  EXPECT_EQ(result.light_directions,
            (std::vector<Direction>{info.light_directions[2], info.light_directions[0]}));
  selection.lights = Indices{0};
  expect_input_error(
      [&] { select(info, selection); },
      "light selection: a paired BTF has no lights of its own; select views (pairs)");
}

TEST(Selection, NamesAndMaskFollow) {
  BtfInfo info = make_info({2, 1, 2, 3, 3});
  info.channel_names = {"R", "G", "B"};
  info.mask = {1, 1, 1, 1, 1, 1,  //
               1, 0, 1, 0, 0, 1};
  info.mask_distance = {0, 0,  0,    0,     0,     0,  //
                        1, -1, 0.5f, -0.5f, -0.5f, 0.25f};
  Selection selection;
  selection.views = Indices{1};
  selection.channels = Indices{2};
  selection.region = Region{1, 0, 2, 2};
  BtfInfo result = select(info, selection);
  EXPECT_EQ(result.channel_names, std::vector<std::string>{"B"});
  EXPECT_EQ(result.mask, (std::vector<std::uint8_t>{0, 1, 0, 1}));
  EXPECT_EQ(result.mask_distance, (std::vector<float>{-1, 0.5f, -0.5f, 0.25f}));
  // Reduced: three columns become two, the first with one of four texels, the second with both.
  selection.region = Region{0, 0, 3, 2};
  selection.level = 1;
  result = select(info, selection);
  EXPECT_EQ(result.mask, (std::vector<std::uint8_t>{0, 1}));
  EXPECT_EQ(result.mask_distance, (std::vector<float>{-0.25f, 0.375f}));
}

TEST(Mip, SidesRoundUp) {
  EXPECT_EQ(mip_side(5, 0), 5u);
  EXPECT_EQ(mip_side(5, 1), 3u);
  EXPECT_EQ(mip_side(5, 2), 2u);
  EXPECT_EQ(mip_side(5, 3), 1u);
  EXPECT_EQ(mip_side(5, 60), 1u);
  EXPECT_EQ(last_mip_level(1, 1), 0u);
  EXPECT_EQ(last_mip_level(256, 3), 8u);
  EXPECT_EQ(last_mip_level(257, 3), 9u);
}

std::vector<double> level_of(std::vector<double> values, BtfShape size, std::size_t level,
                             DType dtype, Encoding encoding) {
  BtfInfo info = make_info(size, dtype);
  info.encoding = encoding;
  Selection selection;
  selection.level = level;
  return read_all(
      *select(std::make_shared<MemorySource>(info, test::encode_values(values, dtype)), selection));
}

TEST(Mip, AveragesByHandInLinearData) {
  // 0 1 2      (0+1+3+4)/4 = 2    (2+5)/2 = 3.5
  // 3 4 5  ->  (6+7)/2 = 6.5      8              ->  (2+3.5+6.5+8)/4 = 5
  // 6 7 8
  const std::vector<double> values{0, 1, 2, 3, 4, 5, 6, 7, 8};
  const BtfShape size{1, 1, 3, 3, 1};
  for (const DType dtype : {DType::f16, DType::f32}) {
    EXPECT_EQ(level_of(values, size, 1, dtype, Encoding::linear),
              (std::vector<double>{2, 3.5, 6.5, 8}));
    EXPECT_EQ(level_of(values, size, 2, dtype, Encoding::linear), (std::vector<double>{5}));
  }
}

TEST(Mip, AveragesLightNotCodes) {
  // Half of the texels black, half white: half of the light, which is 188 in sRGB and
  // 255 x 0.5^(1/2.2) = 186.08 in gamma 2.2, not 127.5.
  const BtfShape size{1, 1, 2, 2, 1};
  const std::vector<double> values{0, 1, 1, 0};
  EXPECT_EQ(level_of(values, size, 1, DType::u8, Encoding::srgb)[0], 188.0 / 255);
  EXPECT_EQ(level_of(values, size, 1, DType::u8, Encoding::gamma22)[0], 186.0 / 255);
  EXPECT_EQ(level_of(values, size, 1, DType::u8, Encoding::linear)[0], 128.0 / 255);
  // In float the code is 0.735357 (1.055 x 0.5^(1/2.4) - 0.055).
  EXPECT_NEAR(level_of(values, size, 1, DType::f32, Encoding::srgb)[0], 0.7353569830524495, 1e-7);
}

TEST(Mip, RoundsOnceAtTheEnd) {
  // In steps of half precision above 1: blocks of 1/4, 1/4, 1/4 and 6/4, together 9/16, which
  // rounds to 1. Rounded at level 1 they would be 0, 0, 0 and 2, and then 2/4, which rounds to
  // even, 0.
  constexpr double step = 0x1p-10;
  std::vector<double> values{1, 0, 0, 1,  //
                             0, 0, 0, 0,  //
                             0, 1, 1, 2,  //
                             0, 0, 1, 2};
  for (double& value : values) value = 1 + value * step;
  EXPECT_EQ(level_of(values, {1, 1, 4, 4, 1}, 2, DType::f16, Encoding::linear)[0], 1 + step);
}

TEST(Mip, ChannelsAndImagesStayApart) {
  const BtfShape size{2, 1, 2, 2, 2};
  const std::vector<double> values{1, 10, 2, 20, 3, 30, 4, 40, 5, 50, 6, 60, 7, 70, 8, 80};
  EXPECT_EQ(level_of(values, size, 1, DType::f32, Encoding::linear),
            (std::vector<double>{2.5, 25, 6.5, 65}));
}

TEST(Mip, LevelComesAfterTheRegion) {
  const auto source = counting_source({1, 1, 4, 6, 1});
  Selection selection;
  selection.region = Region{1, 1, 3, 2};
  selection.level = 1;
  const auto selected = select(source, selection);
  ASSERT_EQ(selected->info().shape, (BtfShape{1, 1, 1, 2, 1}));
  EXPECT_EQ(read_all(*selected), (std::vector<double>{(7 + 8 + 13 + 14) / 4.0, (9 + 15) / 2.0}));
}

}  // namespace
}  // namespace weft
