// Selections that are recorded: their text, their JSON, what a model holds by them, selections of
// selections, and records that don't fit.
#include "weft/btf/recorded_selection.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/memory_btf.hpp"

namespace weft::test {
namespace {

using Indices = std::vector<std::size_t>;

constexpr BtfShape shape{5, 4, 11, 14, 3};

RecordedSelection everything_at_once() {
  RecordedSelection selection;
  selection.views = Indices{4, 0, 2};
  selection.lights = Indices{3, 1};
  selection.region = Region{2, 1, 11, 9};
  selection.channels = Indices{2, 0};
  selection.level = 1;
  selection.of = shape;
  return selection;
}

TEST(RecordedSelection, JsonComesBack) {
  const RecordedSelection selection = everything_at_once();
  const std::string json = to_json(selection);
  EXPECT_EQ(json, R"({"views":[4,0,2],"lights":[3,1],"region":{"x":2,"y":1,"width":11,"height":9},)"
                  R"("channels":[2,0],"level":1,"of":[5,4,11,14,3]})");
  const RecordedSelection back = recorded_from_json(json, "m");
  EXPECT_EQ(to_json(back), json);
  EXPECT_EQ(back.of, shape);
  RecordedSelection whole;
  whole.of = shape;
  EXPECT_EQ(to_json(whole), "{}");
}

TEST(RecordedSelection, WhatIsNoSelectionIsRefused) {
  for (const char* text :
       {"", "[]", "3", "{\"view\":[1]}", "{\"views\":3}", "{\"views\":[-1]}", "{\"views\":[1.5]}",
        "{\"views\":[\"a\"]}", "{\"level\":-1}", "{\"level\":[1]}", "{\"region\":[0,0,1,1]}",
        "{\"region\":{\"x\":0,\"y\":0,\"width\":1}}", "{\"of\":[1,2,3,4]}", "{\"of\":3}",
        "{\"views\":[99999999999999999999999]}"}) {
    expect_error(ErrorKind::input, {"m.weft", "is not a selection"},
                 [&] { recorded_from_json(text, "m.weft"); });
  }
}

TEST(RecordedSelection, TextIsShort) {
  EXPECT_EQ(to_text({}), "all");
  EXPECT_EQ(to_text(everything_at_once()),
            "views 4,0,2 of 5; lights 3,1 of 4; region 2,1,11x9 of 14 x 11; channels 2,0 of 3; "
            "level 1");
  RecordedSelection unknown = everything_at_once();
  unknown.of.reset();
  EXPECT_EQ(to_text(unknown), "views 4,0,2; lights 3,1; region 2,1,11x9; channels 2,0; level 1");
  EXPECT_EQ(ranges_text(Indices{0, 1, 2, 8, 10, 11}), "0-2,8,10-11");
  EXPECT_EQ(ranges_text(Indices{2, 1, 0}), "2,1,0");
  EXPECT_EQ(ranges_text(Indices{}), "");
  EXPECT_EQ(ranges_text(Indices{0, 2, 4, 6}, 3), "0,2,4,...");
  EXPECT_EQ(ranges_text(Indices{0, 2, 4, 5}, 3), "0,2,4-5");
}

std::vector<std::byte> read_all(TileSource& source) {
  std::vector<std::byte> bytes(source.info().bytes());
  source.read(0, source.info().shape.images(), bytes);
  return bytes;
}

// select(select(T, a), b) = select(T, composed(a, b)), bit by bit.
TEST(RecordedSelection, SelectionsOfSelectionsCompose) {
  const auto source = random_source(shape, DType::f32, 3);
  const RecordedSelection recorded = everything_at_once();
  const auto first = select(source, recorded);
  ASSERT_EQ(first->info().shape, (BtfShape{3, 2, 5, 6, 2}));
  Selection views;
  views.views = Indices{2, 0};
  Selection lights;
  lights.lights = Indices{1};
  Selection channels;
  channels.channels = Indices{1};
  Selection inside;
  inside.region = Region{1, 1, 3, 2};
  Selection edge;
  edge.region = Region{3, 2, 3, 3};
  Selection level;
  level.level = 2;
  Selection all = edge;
  all.views = views.views;
  all.lights = lights.lights;
  all.channels = channels.channels;
  all.level = 1;
  for (const Selection& part : {Selection{}, views, lights, channels, inside, edge, level, all}) {
    const RecordedSelection at_once = composed(first->info(), recorded, part, "m");
    EXPECT_EQ(at_once.of, shape);
    const auto direct = select(source, at_once);
    const auto stepwise = select(first, part);
    ASSERT_EQ(direct->info().shape, stepwise->info().shape) << to_text(at_once);
    EXPECT_EQ(direct->info().view_directions, stepwise->info().view_directions);
    EXPECT_EQ(direct->info().light_directions, stepwise->info().light_directions);
    if (part.level == 0) {
      EXPECT_EQ(read_all(*direct), read_all(*stepwise)) << to_text(at_once);
    }
  }
}

TEST(RecordedSelection, OfAllThatThereIs) {
  const BtfInfo info = make_info(shape);
  const HeldPart held = held_part(info, {}, "m");
  EXPECT_EQ(held.whole, shape);
  EXPECT_EQ(held.views, (Indices{0, 1, 2, 3, 4}));
  EXPECT_EQ(held.region, (Region{0, 0, 14, 11}));
  Selection part;
  part.views = Indices{3};
  const RecordedSelection whole = composed(info, {}, part, "m");
  EXPECT_EQ(to_json(whole), R"({"views":[3],"of":[5,4,11,14,3]})");
  EXPECT_TRUE(composed(info, {}, {}, "m").selects_all());
}

// Of a record without the BTF's sizes: as much as follows.
TEST(RecordedSelection, SizesOfTheWholeMayBeUnknown) {
  RecordedSelection recorded;
  recorded.level = 2;
  recorded.views = Indices{7, 9};
  BtfInfo info = make_info({2, 4, 3, 4, 3});
  const HeldPart held = held_part(info, recorded, "m");
  EXPECT_EQ(held.whole, std::nullopt);
  EXPECT_EQ(held.region, (Region{0, 0, 16, 12}));
  Selection part;
  part.region = Region{1, 0, 3, 3};
  EXPECT_EQ(composed(info, recorded, part, "m").region, (Region{4, 0, 12, 12}));
}

TEST(RecordedSelection, RecordsThatDoNotFitAreRefused) {
  const RecordedSelection good = everything_at_once();
  const BtfInfo info = select(make_info(shape), good);
  const auto refused = [&](std::string_view what, const auto& change) {
    RecordedSelection bad = good;
    change(bad);
    expect_error(ErrorKind::input, {"m.weft", what}, [&] { held_part(info, bad, "m.weft"); });
    expect_error(ErrorKind::input, {"m.weft", what}, [&] { composed(info, bad, {}, "m.weft"); });
  };
  EXPECT_NO_THROW(held_part(info, good, "m.weft"));
  refused("2 views for 3", [](RecordedSelection& s) { s.views->pop_back(); });
  refused("0 views for 3", [](RecordedSelection& s) { s.views->clear(); });
  refused("5 of 5 views", [](RecordedSelection& s) { s.views->back() = 5; });
  refused("views are repeated", [](RecordedSelection& s) { s.views->back() = 4; });
  refused("3 of 5 views", [](RecordedSelection& s) { s.views.reset(); });
  refused("3 lights for 2", [](RecordedSelection& s) { s.lights->push_back(0); });
  refused("2 of 3 channels", [](RecordedSelection& s) { s.channels.reset(); });
  refused("region 2,1,13x9", [](RecordedSelection& s) { s.region->width = 13; });
  refused("region 2,1,9x9", [](RecordedSelection& s) { s.region->width = 9; });
  refused("region 2,1,0x9", [](RecordedSelection& s) { s.region->width = 0; });
  refused("region 4,1,11x9", [](RecordedSelection& s) { s.region->x = 4; });
  refused("region 18446744073709551615,1",
          [](RecordedSelection& s) { s.region->x = static_cast<std::size_t>(-1); });
  refused("region 0,0,14x11", [](RecordedSelection& s) { s.region.reset(); });
  refused("level 0", [](RecordedSelection& s) { s.level = 0; });
  refused("level 48", [](RecordedSelection& s) { s.level = 48; });
  refused("level 18446744073709551615",
          [](RecordedSelection& s) { s.level = static_cast<std::size_t>(-1); });
}

}  // namespace
}  // namespace weft::test
