// Selections as they are written: lists, ranges, conditions on directions, regions and levels, of a
// raw BTF and of models of a part of one; and text that is none.
#include "weft/btf/selection_text.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "weft/btf/directions.hpp"

namespace weft::test {
namespace {

using Indices = std::vector<std::size_t>;

// Of the 81 directions: rings of 1, 6, 12, 18, 20, 24 at theta 0, 15, ..., 75.
BtfInfo goniometer() {
  BtfInfo info = make_info({81, 81, 40, 64, 3});
  info.view_directions = ubo81_directions();
  info.light_directions = ubo81_directions();
  return info;
}

Indices range(std::size_t first, std::size_t last) {
  Indices indices;
  for (std::size_t i = first; i <= last; ++i) indices.push_back(i);
  return indices;
}

std::optional<Indices> views(const std::string& text, const BtfInfo& info = goniometer()) {
  SelectionText given;
  given.views = text;
  return parse_selection(given, info).views;
}

void expect_message(const std::string& message, const SelectionText& text, const BtfInfo& info) {
  try {
    parse_selection(text, info);
    ADD_FAILURE() << "no error; expected: " << message;
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    EXPECT_EQ(error.what(), message);
  }
}

TEST(SelectionText, ListsAndRangesKeepTheirOrder) {
  EXPECT_EQ(views("0,3,8-11"), (Indices{0, 3, 8, 9, 10, 11}));
  EXPECT_EQ(views(" 5 , 1 "), (Indices{5, 1}));
  EXPECT_EQ(views("2-2"), (Indices{2}));
  EXPECT_EQ(views("0-80:20"), (Indices{0, 20, 40, 60, 80}));
  EXPECT_EQ(views("1 - 9 : 4"), (Indices{1, 5, 9}));
  EXPECT_EQ(views("76-80:3,0"), (Indices{76, 79, 0}));
}

TEST(SelectionText, WhatSelectsEverythingIsNoSelection) {
  for (const char* text : {"", "all", " all ", "0-80", "theta<=90", "theta<=75", "phi=0..360",
                           "cone=0/0/90", "theta<30,theta>=30", "all,theta<=15"}) {
    EXPECT_EQ(views(text), std::nullopt) << text;
  }
  // in another order it is one
  EXPECT_EQ(views("1-80,0")->size(), 81U);
  EXPECT_TRUE(parse_selection({}, goniometer()).selects_all());
}

TEST(SelectionText, BoundsOfThetaBelongToTheRing) {
  EXPECT_EQ(views("theta<=60"), range(0, 56));
  EXPECT_EQ(views("theta<60"), range(0, 36));
  EXPECT_EQ(views("theta>=60"), range(37, 80));
  EXPECT_EQ(views("theta>60"), range(57, 80));
  EXPECT_EQ(views("theta=60"), range(37, 56));
  EXPECT_EQ(views("theta=15..30"), range(1, 18));
  EXPECT_EQ(views("theta = 0 .. 0"), range(0, 0));
  EXPECT_EQ(views("theta <= 1.5e1"), range(0, 6));
}

// No direction is lost for having been stored in float, or written with four decimals.
TEST(SelectionText, BoundsDoNotFallOnRounding) {
  BtfInfo info = make_info({90, 1, 1, 1, 1});
  for (const double unit : {0x1p-23, 1e-4}) {
    for (std::size_t i = 0; i < 90; ++i) {
      const Direction exact = direction_from_degrees(60, 4.0 * static_cast<double>(i));
      for (std::size_t c = 0; c < 3; ++c) {
        info.view_directions[i][c] = static_cast<float>(std::round(double{exact[c]} / unit) * unit);
      }
    }
    EXPECT_EQ(views("theta<=60", info), std::nullopt) << unit;
    EXPECT_EQ(views("theta=60", info), std::nullopt) << unit;
    EXPECT_EQ(views("cone=0/0/60", info), std::nullopt) << unit;
    EXPECT_EQ(views("phi=0..356", info), std::nullopt) << unit;
    EXPECT_EQ(views("phi=8..16", info), range(2, 4)) << unit;
    EXPECT_THROW(views("theta<60", info), Error) << unit;
    EXPECT_THROW(views("theta>60", info), Error) << unit;
  }
}

TEST(SelectionText, AzimuthsGoRound) {
  // the ring of theta 15 is 1-6, at 0, 60, ..., 300; the zenith is in every range
  EXPECT_EQ(views("theta=15&phi=60..180"), range(2, 4));
  EXPECT_EQ(views("theta=15&phi=300..60"), (Indices{1, 2, 6}));
  EXPECT_EQ(views("theta=15&phi=-60..60"), (Indices{1, 2, 6}));
  EXPECT_EQ(views("theta=15&phi=120"), (Indices{3}));
  EXPECT_EQ(views("theta<=15&phi=120"), (Indices{0, 3}));
  EXPECT_EQ(views("theta=15&phi=-360..0"), range(1, 6));
  EXPECT_EQ(views("theta=15&phi=360..360"), (Indices{1}));
}

TEST(SelectionText, ConesAreRoundADirection) {
  EXPECT_EQ(views("cone=0/0/15"), range(0, 6));
  EXPECT_EQ(views("cone=15/60/0"), (Indices{2}));
  // neighbours of a ring of 24 at theta 75: 2 asin(sin 75 sin 7.5) = 14.5 degrees apart
  EXPECT_EQ(views("cone=75/0/14.4"), (Indices{57}));
  EXPECT_EQ(views("cone=75/0/14.6&theta=75"), (Indices{57, 58, 80}));
  EXPECT_EQ(views("cone=75/360/14.6&theta=75"), (Indices{57, 58, 80}));
}

TEST(SelectionText, PartsUniteAndTermsIntersect) {
  EXPECT_EQ(views("theta=75&phi=0,theta=0"), (Indices{57, 0}));
  EXPECT_EQ(views("0-10&theta>=30"), (Indices{7, 8, 9, 10}));
  EXPECT_EQ(views("9,8&all,0"), (Indices{9, 8, 0}));
  EXPECT_EQ(views("theta<=15,theta<=15,3"), range(0, 6));  // conditions may say a thing twice
}

TEST(SelectionText, WhatIsWrongIsNamed) {
  const auto error = [](const std::string& text, const std::string& message) {
    SelectionText given;
    given.lights = text;
    expect_message("--lights: " + message, given, goniometer());
  };
  const std::string forms =
      " is not an index, a range (8-11, 0-80:4), a condition (theta<=60, theta=20..60, "
      "phi=30..120, cone=30/90/15) or all";
  for (const char* text :
       {"x", "1.5", "-3", "3-", "1-2-3", "0-8:", "0-8:x", "99999999999999999999999", "theta",
        "theta60", "phi<=90", "phi>3", "cone<3", "tilt=3", "\xff\x01", "0x10", "+1", "R"}) {
    error(text, "'" + std::string(text) + "'" + forms);
  }
  error(",", "''" + forms);
  error("1,", "''" + forms);
  error("1&", "''" + forms);
  error("&", "''" + forms);
  error("81", "'81' is out of range: there are 81, counted from 0");
  error("0-99999999999", "'0-99999999999' is out of range: there are 81, counted from 0");
  error("0-18446744073709551615:18446744073709551615",
        "'0-18446744073709551615:18446744073709551615' is out of range: there are 81, counted "
        "from 0");
  error("1,0-2", "1 is repeated by '0-2'");
  error("5-2", "the range '5-2' runs backwards");
  error("0-8:0", "the step of '0-8:0' is 0");
  error("theta<=", "'' in 'theta<=' is not an angle from 0 to 180 degrees");
  error("theta<=nan", "'nan' in 'theta<=nan' is not an angle from 0 to 180 degrees");
  error("theta>=-1", "'-1' in 'theta>=-1' is not an angle from 0 to 180 degrees");
  error("theta=1e999", "'1e999' in 'theta=1e999' is not an angle from 0 to 180 degrees");
  error("theta=<60", "'<60' in 'theta=<60' is not an angle from 0 to 180 degrees");
  error("theta=1..2..3", "'1..2..3' in 'theta=1..2..3' is not an angle from 0 to 180 degrees");
  error("theta=60..20", "the range 'theta=60..20' runs backwards");
  error("phi=inf..3", "'inf' in 'phi=inf..3' is not an angle from -360 to 360 degrees");
  error("cone=1/2", "'cone=1/2' is not a cone=THETA/PHI/HALFANGLE such as cone=30/90/15");
  error("cone=1/2/200", "'200' in 'cone=1/2/200' is not an angle from 0 to 180 degrees");
  error("theta>75", "'theta>75' selects none of the 81 there are");
  error("3,theta=75&0-9", "'theta=75&0-9' selects none of the 81 there are");
}

TEST(SelectionText, ChannelsHaveNames) {
  const auto channels = [](const std::string& text, const BtfInfo& info) {
    SelectionText given;
    given.channels = text;
    return parse_selection(given, info).channels;
  };
  BtfInfo info = goniometer();
  EXPECT_EQ(channels("B,R", info), (Indices{2, 0}));
  EXPECT_EQ(channels("0-1", info), (Indices{0, 1}));
  EXPECT_EQ(channels("R,G,B", info), std::nullopt);
  info.channel_names = {"450 nm", "550 nm", "0"};
  EXPECT_EQ(channels("550 nm", info), (Indices{1}));
  EXPECT_EQ(channels("0", info), (Indices{0}));  // an index before a name
  const auto error = [&](const std::string& text, const std::string& message) {
    SelectionText given;
    given.channels = text;
    expect_message("--channels: " + message, given, info);
  };
  error("R", "'R' is not an index, a range (0-2), a channel's name or all");
  error("theta<=3", "'theta<=3' is not an index, a range (0-2), a channel's name or all");
  error("3", "'3' is out of range: there are 3, counted from 0");
}

TEST(SelectionText, RegionsAndLevels) {
  const auto parsed = [](const std::string& region, std::optional<std::size_t> level = {}) {
    SelectionText given;
    given.region = region;
    given.level = level;
    return parse_selection(given, goniometer());
  };
  EXPECT_EQ(parsed("8,0,32x16").region, (Region{8, 0, 32, 16}));
  EXPECT_EQ(parsed(" 8 , 0 , 32 x 16 ").region, (Region{8, 0, 32, 16}));
  EXPECT_EQ(parsed("center:32x16").region, (Region{16, 12, 32, 16}));
  EXPECT_EQ(parsed("center:33x1").region, (Region{15, 19, 33, 1}));
  EXPECT_EQ(parsed("0,0,64x40").region, std::nullopt);
  EXPECT_EQ(parsed("all").region, std::nullopt);
  EXPECT_EQ(parsed("", 6).level, 6U);
  EXPECT_EQ(parsed("", 0).level, 0U);

  const std::string forms =
      " is not a region X,Y,WIDTHxHEIGHT or center:WIDTHxHEIGHT such as 64,0,128x128 or "
      "center:64x64";
  for (const std::string text :
       {"1,2,3", "1,2,3x", "1,2x3,4", "-1,2,3x4", "1,2,3x4x5", "axb", "center:", "center:3",
        "center:3x-1", "middle:3x3", "1,2,3,4x5", "1,2,99999999999999999999x1"}) {
    SelectionText given;
    given.region = text;
    expect_message("--region: '" + text + "'" + forms, given, goniometer());
  }
  for (const std::string text : {"0,0,0x4", "center:4x0"}) {
    SelectionText given;
    given.region = text;
    expect_message("--region: the region '" + text + "' is empty", given, goniometer());
  }
  for (const std::string text : {"60,0,5x1", "64,0,1x1", "0,40,1x1", "center:65x1", "center:1x41",
                                 "18446744073709551615,0,2x1", "1,0,18446744073709551615x1"}) {
    SelectionText given;
    given.region = text;
    expect_message("--region: '" + text + "' does not lie within 64 x 40 texels", given,
                   goniometer());
  }
  SelectionText given;
  given.region = "0,0,4x2";
  given.level = 3;
  expect_message("--level 3: the last mip level of 4 x 2 texels is 2", given, goniometer());
}

TEST(SelectionText, PairsAreSelectedAsViews) {
  BtfInfo info = make_info({6, 1, 2, 2, 3});
  info.layout = Layout::paired;
  info.light_directions = info.view_directions;
  SelectionText given;
  given.views = "0,2";
  EXPECT_EQ(parse_selection(given, info).views, (Indices{0, 2}));
  given.lights = "all";
  EXPECT_EQ(parse_selection(given, info).lights, std::nullopt);
  given.lights = "0";
  expect_message("--lights: '0': a paired BTF has no lights of its own; select views (pairs)",
                 given, info);
}

// A model of views theta <= 60, lights 3,1 and 8, channels B and R, and a region at level 1.
struct PartOfIt {
  RecordedSelection recorded;
  BtfInfo info;
  HeldPart held;

  PartOfIt() {
    recorded.views = range(0, 56);
    recorded.lights = Indices{3, 1, 8};
    recorded.channels = Indices{2, 0};
    recorded.region = Region{10, 5, 33, 20};
    recorded.level = 1;
    recorded.of = goniometer().shape;
    info = select(goniometer(), recorded);
    held = held_part(info, recorded, "part.weft");
  }
  Selection parsed(const SelectionText& text) const {
    return parse_selection(text, info, held, "part.weft");
  }
};

TEST(SelectionText, ModelsKeepTheNumbersOfTheWhole) {
  const PartOfIt model;
  EXPECT_EQ(model.info.shape, (BtfShape{57, 3, 10, 17, 2}));
  SelectionText text;
  EXPECT_TRUE(model.parsed(text).selects_all());
  text = {"56,3", "8,3", "12,5,4x20", "R", 2};
  Selection part = model.parsed(text);
  EXPECT_EQ(part.views, (Indices{56, 3}));
  EXPECT_EQ(part.lights, (Indices{2, 0}));
  EXPECT_EQ(part.channels, (Indices{1}));
  EXPECT_EQ(part.region, (Region{1, 0, 2, 10}));
  EXPECT_EQ(part.level, 1U);
  const RecordedSelection whole = composed(model.info, model.recorded, part, "part.weft");
  EXPECT_EQ(whole.views, (Indices{56, 3}));
  EXPECT_EQ(whole.lights, (Indices{8, 3}));
  EXPECT_EQ(whole.channels, (Indices{0}));
  EXPECT_EQ(whole.region, (Region{12, 5, 4, 20}));
  EXPECT_EQ(whole.level, 2U);
  // conditions choose of what is held
  text = {"theta>=30", "theta<=15", "", "", {}};
  part = model.parsed(text);
  EXPECT_EQ(part.views, range(19 - 12, 56));
  EXPECT_EQ(part.lights, (Indices{0, 1}));  // 3 and 1
  // the last texel of an odd side is half a texel
  text = {"", "", "40,23,3x2", "", 1};
  part = model.parsed(text);
  EXPECT_EQ(part.region, (Region{15, 9, 2, 1}));
  EXPECT_EQ(composed(model.info, model.recorded, part, "m").region, (Region{40, 23, 3, 2}));
  // in the middle of what is held, on whole texels of it
  text = {"", "", "center:8x8", "", {}};
  EXPECT_EQ(model.parsed(text).region, (Region{6, 3, 4, 4}));
}

TEST(SelectionText, WhatAModelDoesNotHoldIsNamed) {
  const PartOfIt model;
  const auto error = [&](const SelectionText& text, const std::string& message) {
    try {
      model.parsed(text);
      ADD_FAILURE() << "no error; expected: " << message;
    } catch (const Error& found) {
      EXPECT_EQ(found.kind(), ErrorKind::input);
      EXPECT_EQ(found.what(), message);
    }
  };
  error({"55-58", "", "", "", {}},
        "--views: 58 of '55-58' is not in part.weft, which holds 0-56 of 81");
  error({"81", "", "", "", {}}, "--views: '81' is out of range: there are 81, counted from 0");
  error({"theta>60", "", "", "", {}}, "--views: 'theta>60' selects none of the 57 there are");
  error({"", "0", "", "", {}}, "--lights: 0 of '0' is not in part.weft, which holds 3,1,8 of 81");
  error({"", "", "", "G", {}},
        "--channels: 'G' is not an index, a range (0-2), a channel's name or all");
  error({"", "", "", "1", {}}, "--channels: 1 of '1' is not in part.weft, which holds 2,0 of 3");
  error({"", "", "0,0,4x4", "", {}},
        "--region: '0,0,4x4' does not lie within the 10,5,33x20 that part.weft holds");
  error({"", "", "11,5,4x4", "", {}},
        "--region: '11,5,4x4' cuts texels of part.weft, which are 2 x 2 of the BTF's from 10,5 on");
  error({"", "", "10,5,3x4", "", {}},
        "--region: '10,5,3x4' cuts texels of part.weft, which are 2 x 2 of the BTF's from 10,5 on");
  error({"", "", "", "", 0}, "--level 0: part.weft holds mip level 1 and none that is finer");
  error({"", "", "", "", 7}, "--level 7: the last mip level of 17 x 10 texels is 6");
}

// Whatever the text, it is parsed or refused as input.
TEST(SelectionText, AnyTextIsParsedOrRefused) {
  const std::string pieces[] = {"theta", "phi", "cone", "<=", "<",   ">=",    "=",
                                "..",    "/",   ":",    "-",  ",",   "&",     "60",
                                "0",     "1e3", "x",    " ",  "all", "center"};
  Random random(7);
  const BtfInfo info = goniometer();
  std::size_t parsed = 0;
  for (std::size_t i = 0; i < 20000; ++i) {
    SelectionText text;
    for (std::string* option : {&text.views, &text.region, &text.channels}) {
      for (std::size_t k = random.index(6); k > 0; --k) *option += pieces[random.index(20)];
    }
    try {
      parse_selection(text, info);
      ++parsed;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
    }
  }
  EXPECT_GT(parsed, 100U);
}

}  // namespace
}  // namespace weft::test
