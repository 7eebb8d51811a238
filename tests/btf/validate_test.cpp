// What a BtfInfo must fulfil, and the names of its enumerations.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "weft/btf/btf.hpp"

namespace weft {
namespace {

using test::expect_error;
using test::make_info;

void expect_invalid(const BtfInfo& info, std::initializer_list<std::string_view> parts) {
  expect_error(ErrorKind::input, {"file.btf"}, [&] { validate(info, "file.btf"); });
  expect_error(ErrorKind::input, parts, [&] { validate(info, "file.btf"); });
}

TEST(Validate, AcceptsTheSmallestAndAFullOne) {
  EXPECT_NO_THROW(validate(make_info({1, 1, 1, 1, 1}), "file.btf"));
  BtfInfo info = make_info({3, 2, 4, 5, 3}, DType::u8);
  info.channel_names = {"R", "G", "B"};
  info.mask.assign(3 * 4 * 5, 1);
  EXPECT_NO_THROW(validate(info, "file.btf"));
}

TEST(Validate, RefusesSizesOfZeroAndTooLargeOnes) {
  BtfInfo info = make_info({2, 2, 2, 2, 1});
  info.shape.width = 0;
  expect_invalid(info, {"[2, 2, 2, 0, 1]"});
  info.shape.width = std::size_t{1} << 60;  // 2^65 bytes
  expect_invalid(info, {"too large", "1152921504606846976"});
  info.shape.width = std::numeric_limits<std::size_t>::max();
  expect_invalid(info, {"too large"});
  // 2^48 values exactly are the most: 2 * 2 * 2 * W.
  info.shape.width = std::size_t{1} << 45;
  EXPECT_NO_THROW(validate(info, "file.btf"));
  info.shape.width = (std::size_t{1} << 45) + 1;
  expect_invalid(info, {"too large"});
  info = make_info({1, 1, 2, 2, 1024});
  EXPECT_NO_THROW(validate(info, "file.btf"));
  info.shape.channels = 1025;
  expect_invalid(info, {"1025", "1024 channels"});
}

TEST(Validate, RefusesOtherDtypes) {
  for (const DType dtype : {DType::u16, DType::u32, DType::f64}) {
    BtfInfo info = make_info({1, 1, 1, 1, 1});
    info.dtype = dtype;
    expect_invalid(info, {"dtype", name_of(dtype)});
  }
}

TEST(Validate, RefusesDirectionsThatDoNotFit) {
  BtfInfo info = make_info({3, 2, 1, 1, 1});
  info.view_directions.pop_back();
  expect_invalid(info, {"view_directions", "2", "3"});
  info = make_info({3, 2, 1, 1, 1});
  info.light_directions.push_back({0, 0, 1});
  expect_invalid(info, {"light_directions", "3", "2"});
  constexpr float inf = std::numeric_limits<float>::infinity();
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  for (const Direction& bad :
       {Direction{0, 0, 0}, Direction{0, 0, 1.002f}, Direction{0, 0, 0.998f}, Direction{0, nan, 1},
        Direction{inf, 0, 1}, Direction{3e38f, 3e38f, 3e38f}}) {
    info = make_info({3, 2, 1, 1, 1});
    info.light_directions[1] = bad;
    expect_invalid(info, {"light_directions[1]"});
  }
  info.light_directions[1] = {0, 0, 1.0009f};
  EXPECT_NO_THROW(validate(info, "file.btf"));
}

TEST(Validate, PairedHasOneLightPerView) {
  BtfInfo info = make_info({3, 2, 1, 1, 1});
  info.layout = Layout::paired;
  expect_invalid(info, {"paired", "[3, 2, 1, 1, 1]"});
  info = make_info({3, 1, 1, 1, 1});
  info.layout = Layout::paired;
  expect_invalid(info, {"light_directions", "1", "3"});
  info.light_directions = info.view_directions;
  EXPECT_NO_THROW(validate(info, "file.btf"));
}

TEST(Validate, ChannelNamesAndMaskHaveTheRightCount) {
  BtfInfo info = make_info({2, 1, 2, 2, 3});
  info.channel_names = {"R", "G"};
  expect_invalid(info, {"2 channel names for 3 channels"});
  info.channel_names.clear();
  info.mask.assign(4, 1);
  expect_invalid(info, {"mask", "4", "8"});
  info.mask.assign(8, 1);
  info.mask[5] = 2;
  expect_invalid(info, {"mask value 2 at index 5"});
  info.mask.clear();
  info.mask_distance.assign(4, 1);
  expect_invalid(info, {"mask_distance", "4", "8"});
  info.mask_distance.assign(8, -1);
  info.mask_distance[6] = 1.5f;
  expect_invalid(info, {"mask_distance value 1.5 at index 6"});
  info.mask_distance[6] = std::nanf("");
  expect_invalid(info, {"mask_distance value nan at index 6"});
}

TEST(Names, GoBothWays) {
  for (const Encoding value : {Encoding::linear, Encoding::srgb, Encoding::gamma22}) {
    EXPECT_EQ(encoding_from_name(name_of(value), "f"), value);
  }
  for (const Quantity value : {Quantity::radiance, Quantity::brdf}) {
    EXPECT_EQ(quantity_from_name(name_of(value), "f"), value);
  }
  for (const Layout value : {Layout::grid, Layout::paired}) {
    EXPECT_EQ(layout_from_name(name_of(value), "f"), value);
  }
  EXPECT_EQ(name_of(Encoding::gamma22), "gamma2.2");
  expect_error(ErrorKind::input, {"file: encoding", "sRGB", "linear, srgb, gamma2.2"},
               [] { encoding_from_name("sRGB", "file: encoding"); });
  expect_error(ErrorKind::input, {"file", "\"\""}, [] { quantity_from_name("", "file"); });
  expect_error(ErrorKind::input, {"file", "x"}, [] { layout_from_name("x", "file"); });
}

}  // namespace
}  // namespace weft
