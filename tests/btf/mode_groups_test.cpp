// Modes merged as users say: which go together, in which order, how their indices count.
#include "weft/btf/mode_groups.hpp"

#include <gtest/gtest.h>

#include "support/expect_error.hpp"

namespace weft::test {
namespace {

constexpr BtfShape shape{2, 3, 5, 7, 11};

std::vector<std::string> names(std::string_view merge) {
  std::vector<std::string> list;
  const ModeGroups merged(shape, merge);
  for (const ModeGroup& group : merged.groups()) list.push_back(group.name);
  return list;
}
using Names = std::vector<std::string>;

TEST(ModeGroups, AloneOrTogether) {
  EXPECT_EQ(names(""), (Names{"v", "l", "c", "y", "x"}));
  EXPECT_EQ(names("yxc"), (Names{"v", "l", "yxc"}));
  EXPECT_EQ(names("cxy"), (Names{"v", "l", "yxc"}));
  EXPECT_EQ(names("xc"), (Names{"v", "l", "y", "xc"}));
  EXPECT_EQ(names("lc"), (Names{"v", "lc", "y", "x"}));
  EXPECT_EQ(names("yx"), (Names{"v", "l", "c", "yx"}));
  EXPECT_EQ(names("vl,yxc"), (Names{"vl", "yxc"}));
  EXPECT_EQ(names("vlc,yx"), (Names{"vlc", "yx"}));
}

TEST(ModeGroups, CountIndicesInStorageOrder) {
  const ModeGroups whole(shape, "vl,yxc");
  EXPECT_EQ(whole.sizes(), (std::vector<std::size_t>{6, 385}));
  EXPECT_FALSE(whole.channels_first());
  EXPECT_EQ(whole.stride(Mode::view), 3U);
  EXPECT_EQ(whole.stride(Mode::light), 1U);
  EXPECT_EQ(whole.stride(Mode::row), 77U);
  EXPECT_EQ(whole.stride(Mode::column), 11U);
  EXPECT_EQ(whole.stride(Mode::channel), 1U);
  EXPECT_EQ(whole.group_of(Mode::column), 1U);
  EXPECT_EQ(whole.merge(), "vl,yxc");
  const ModeGroups lights(shape, "lc");
  EXPECT_TRUE(lights.channels_first());
  EXPECT_EQ(lights.sizes(), (std::vector<std::size_t>{2, 33, 5, 7}));
  EXPECT_EQ(lights.stride(Mode::light), 11U);
  EXPECT_EQ(lights.merge(), "lc");
  EXPECT_TRUE(lights.groups()[1].of_directions());
  EXPECT_FALSE(lights.groups()[2].of_directions());
}

TEST(ModeGroups, RefuseWhatCannotStandTogether) {
  for (const char* merge : {"q", "y", "yy", "yx,yc", "yx,", ",yx", "vc", "yc", "lx", "vy", "vlyxc",
                            "lyx", "vl,xl", "v,l", "yx c"}) {
    expect_error(ErrorKind::input, {"--merge"}, [&] { ModeGroups(shape, merge); });
  }
  expect_error(ErrorKind::input, {"--ranks", "'c'", "v, l, yxc"},
               [] { ModeGroups(shape, "yxc").find("c", "--ranks"); });
}

}  // namespace
}  // namespace weft::test
