// The library of materials: its presets, and the strictness of its JSON.
#include "weft/scene/material.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>
#include <vector>

#include "support/temporary_folder.hpp"
#include "weft/error.hpp"

namespace weft::test {
namespace {

template <typename Action>
void expect_input_error(const Action& action, const std::vector<std::string>& parts) {
  try {
    action();
    ADD_FAILURE() << "taken; expected an error that names \"" << parts.front() << "\"";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    for (const std::string& part : parts) {
      EXPECT_NE(std::string(error.what()).find(part), std::string::npos)
          << "\"" << error.what() << "\" does not name \"" << part << "\"";
    }
  }
}

std::vector<std::string> preset_names() {
  std::vector<std::string> names;
  for (const MaterialPreset& preset : material_presets()) names.emplace_back(preset.name);
  return names;
}

class EveryPreset : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Materials, EveryPreset, testing::ValuesIn(preset_names()),
                         [](const auto& instance) { return instance.param; });

TEST_P(EveryPreset, MakesAValidSurface) {
  const Material material = find_material(GetParam(), "--material");
  EXPECT_EQ(material.name, GetParam());
  EXPECT_FALSE(material.summary.empty());
  EXPECT_EQ(material.summary.find('\n'), std::string::npos);
  const Surface surface = make_surface(material, 16, 16);
  validate(surface);
  EXPECT_GT(surface.highest, surface.lowest);
}

TEST_P(EveryPreset, HoldsWhatWasForeseen) {
  const Material material = find_material(GetParam(), "--material");
  const SurfaceExtent extent = surface_extent(material, 16, 16);
  const Surface surface = make_surface(material, 16, 16);
  EXPECT_EQ(surface.columns, extent.columns);
  EXPECT_EQ(surface.rows, extent.rows);
  EXPECT_LE(surface.layers.size(), extent.layers);
  std::size_t undersides = 0, bytes = 0;
  for (const SurfaceLayer& layer : surface.layers) {
    if (!layer.underside.empty()) ++undersides;
    bytes += (layer.elevation.size() + layer.underside.size()) * sizeof(float) +
             layer.samples.size() * sizeof(SurfaceSample) +
             layer.colors.size() * sizeof(SurfaceColor);
  }
  EXPECT_LE(undersides, extent.undersides);
  EXPECT_LE(bytes, extent.bytes());
  EXPECT_GE(3 * bytes, extent.bytes());
}

TEST_P(EveryPreset, DependsOnItsSeedOnly) {
  Material material = find_material(GetParam(), "--material");
  const Surface first = make_surface(material, 8, 8);
  const Surface again = make_surface(material, 8, 8);
  material.set_seed(material.seed() + 1);
  const Surface other = make_surface(material, 8, 8);
  ASSERT_EQ(first.layers.size(), again.layers.size());
  bool differs = false;
  for (std::size_t i = 0; i < first.layers.size(); ++i) {
    const SurfaceLayer& a = first.layers[i];
    const SurfaceLayer& b = again.layers[i];
    EXPECT_EQ(a.elevation, b.elevation);
    EXPECT_EQ(a.underside, b.underside);
    const auto same_color = [](const SurfaceColor& p, const SurfaceColor& q) {
      return p.albedo == q.albedo && p.lobe == q.lobe;
    };
    EXPECT_TRUE(std::equal(a.colors.begin(), a.colors.end(), b.colors.begin(), same_color));
    differs = differs || a.elevation != other.layers[i].elevation;
  }
  EXPECT_TRUE(differs);
}

// Mean difference, over all rows, of every column of a table to the one after it, round the border.
std::vector<double> column_steps(const Surface& surface,
                                 const std::function<double(std::size_t)>& value) {
  std::vector<double> steps(surface.columns);
  for (std::size_t c = 0; c < surface.columns; ++c) {
    const std::size_t next = (c + 1) % surface.columns;
    for (std::size_t r = 0; r < surface.rows; ++r) {
      const std::size_t row = r * surface.columns;
      steps[c] += std::abs(value(row + next) - value(row + c));
    }
  }
  return steps;
}
std::vector<double> row_steps(const Surface& surface,
                              const std::function<double(std::size_t)>& value) {
  std::vector<double> steps(surface.rows);
  for (std::size_t r = 0; r < surface.rows; ++r) {
    const std::size_t next = (r + 1) % surface.rows * surface.columns;
    for (std::size_t c = 0; c < surface.columns; ++c) {
      steps[r] += std::abs(value(next + c) - value(r * surface.columns + c));
    }
  }
  return steps;
}

// The step over the border is one like the others: no larger than all of those inside.
void expect_no_seam(const std::vector<double>& steps, const std::string& what) {
  EXPECT_LE(steps.back(), *std::max_element(steps.begin(), steps.end() - 1)) << what;
}

TEST_P(EveryPreset, TilesWithoutASeam) {
  const Surface surface = make_surface(find_material(GetParam(), "--material"), 8, 8);
  for (std::size_t i = 0; i < surface.layers.size(); ++i) {
    const SurfaceLayer& layer = surface.layers[i];
    const std::string name = "layer " + std::to_string(i);
    std::vector<std::pair<std::string, std::function<double(std::size_t)>>> values = {
        {"elevation", [&](std::size_t k) { return layer.elevation[k]; }},
        {"green", [&](std::size_t k) { return layer.colors[k].albedo[1]; }},
        {"fibres", [&](std::size_t k) { return layer.samples[k].fibre_x; }}};
    if (!layer.underside.empty()) {
      values.emplace_back("underside", [&](std::size_t k) { return layer.underside[k]; });
    }
    for (const auto& [what, value] : values) {
      expect_no_seam(column_steps(surface, value), name + ", columns of " + what);
      expect_no_seam(row_steps(surface, value), name + ", rows of " + what);
    }
  }
}

// Nothing is exactly periodic within the tile: no shift of it, by a half or a quarter, comes near
// to the surface itself.
TEST_P(EveryPreset, IsIrregular) {
  const Surface surface = make_surface(find_material(GetParam(), "--material"), 8, 8);
  const SurfaceLayer& layer = surface.layers.front();
  const std::size_t n = surface.columns;
  double mean = 0, spread = 0;
  for (const float z : layer.elevation) mean += z;
  mean /= static_cast<double>(layer.elevation.size());
  for (const float z : layer.elevation) spread += std::pow(z - mean, 2);
  for (const auto& [dx, dy] : {std::pair{n / 2, std::size_t{0}},
                               {std::size_t{0}, n / 2},
                               {n / 2, n / 2},
                               {n / 4, std::size_t{0}},
                               {std::size_t{0}, n / 4}}) {
    double change = 0;
    for (std::size_t r = 0; r < n; ++r) {
      for (std::size_t c = 0; c < n; ++c) {
        const float there = layer.elevation[(r + dy) % n * n + (c + dx) % n];
        change += std::pow(layer.elevation[r * n + c] - there, 2);
      }
    }
    EXPECT_GT(change, 0.01 * spread) << dx << " " << dy;
  }
}

TEST_P(EveryPreset, ServesOblongImages) {
  const Material material = find_material(GetParam(), "--material");
  const Surface square = make_surface(material, 4, 4);
  const Surface wide = make_surface(material, 8, 4);
  const Surface tall = make_surface(material, 4, 8);
  validate(wide);
  validate(tall);
  // As nearly as whole yarns, loops or wales allow.
  EXPECT_NEAR(wide.width / square.width, 2, 0.3);
  EXPECT_NEAR(wide.depth, square.depth, 1e-12);
  EXPECT_NEAR(tall.depth / square.depth, 2, 0.3);
  EXPECT_NEAR(tall.width, square.width, 1e-12);
  validate(make_surface(material, 8, 1));
}

// Every field stands in the preset: a copy shows all that can be edited.
TEST_P(EveryPreset, ShowsAllFields) {
  const std::string text = find_preset(GetParam(), "--print").text;
  const std::size_t at = text.find("\"kind\": \"") + 9;
  const std::string kind = text.substr(at, text.find('"', at) - at);
  for (const FieldRow& row : material_fields(kind, "test")) {
    const std::string name = row.path.substr(row.path.find_last_of('.') + 1);
    EXPECT_NE(text.find('"' + name + '"'), std::string::npos) << row.path;
  }
}

// docs/materials.md lists all fields of all kinds as they are.
TEST(Materials, AreDocumented) {
  std::ifstream file(WEFT_DOCS "/materials.md");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  for (const std::string_view kind : material_kinds()) {
    const std::size_t section = text.find("### " + std::string(kind) + "\n");
    ASSERT_NE(section, std::string::npos) << kind;
    const std::string fields = text.substr(section, text.find("\n### ", section) - section);
    for (const FieldRow& row : material_fields(kind, "test")) {
      EXPECT_NE(fields.find("| `" + row.path + "` | " + row.accepts + " | " + row.standard + " | "),
                std::string::npos)
          << kind << ": " << row.path;
    }
  }
}

TEST(Materials, TheStandardClothIsThePreset) {
  const Surface preset = make_surface(find_material("weave", "--material"), 32, 32);
  const Surface cloth = make_surface(standard_cloth(32, 32), 256, 256);
  EXPECT_EQ(preset.layers[0].elevation, cloth.layers[0].elevation);
}

TEST(Materials, AFieldLeftOutKeepsItsDefault) {
  for (const std::string_view kind : material_kinds()) {
    const Material material = parse_material("{\"kind\": \"" + std::string(kind) + "\"}", "m.json");
    validate(make_surface(material, 4, 4));
  }
}

TEST(Materials, ReadsFilesAndNamesThem) {
  const TemporaryFolder folder;
  const std::string path = (folder / "mine.json").string();
  std::ofstream(path) << R"({"kind": "leather", "seed": 18446744073709551615, "dome": 0.5})";
  const Material material = find_material(path, "--material");
  EXPECT_EQ(material.name, "mine");
  EXPECT_EQ(material.seed(), ~std::uint64_t{0});
  EXPECT_EQ(std::get<Leather>(material.geometry).dome, 0.5);
  expect_input_error([] { find_material("brick", "--material"); },
                     {"--material", "'brick'", "weave"});
  expect_input_error([&] { find_material((folder / "no.json").string(), "--material"); },
                     {"no.json"});
}

TEST(Materials, RefusesWhatIsNoMaterial) {
  struct Case {
    std::string text;
    std::vector<std::string> message;
  };
  const std::vector<Case> cases = {
      {"", {"m.json", "not valid JSON"}},
      {"[]", {"m.json", "not a JSON object"}},
      {"{", {"m.json", "not valid JSON: parse error at line 1"}},
      {"{}", {"kind is ''", "leather"}},
      {R"({"kind": 7})", {"kind is 7", "a text"}},
      {R"({"kind": "brick"})", {"kind is 'brick'", "gravel"}},
      {R"({"kind": "leather", "kind": "gravel"})", {"\"kind\" appears twice"}},
      {R"({"kind": "leather", "cell_sise": 1})", {"unknown field cell_sise", "cell_size"}},
      {R"({"kind": "leather", "gloss": {"f91": 1}})", {"unknown field gloss.f91", "f90"}},
      {R"({"kind": "leather", "gloss": 3})", {"gloss is 3", "an object"}},
      {R"({"kind": "leather", "dome": "high"})", {"dome is \"high\"", "a number"}},
      {R"({"kind": "leather", "dome": 1e999})", {"m.json"}},
      {R"({"kind": "leather", "dome": null})", {"dome is null", "a number"}},
      {R"({"kind": "leather", "dome": -1})", {"dome is -1", "[0, 10]"}},
      {R"({"kind": "leather", "gloss": {"alpha_along": 0}})", {"gloss.alpha_along is 0"}},
      {R"({"kind": "leather", "color": [1, 1]})", {"color is [1,1]", "3 numbers"}},
      {R"({"kind": "leather", "color": [1, 1, 2]})", {"color[2] is 2", "[0, 1]"}},
      {R"({"kind": "leather", "color": [1, 1, []]})", {"color[2] is []", "a number"}},
      {R"({"kind": "leather", "tile": 3})", {"tile is 3", "2 numbers"}},
      {R"({"kind": "leather", "tile": [24, 0]})", {"tile[1] is 0"}},
      {R"({"kind": "leather", "seed": -1})", {"seed is -1"}},
      {R"({"kind": "leather", "seed": 1.5})", {"seed is 1.5"}},
      {R"({"kind": "leather", "summary": 1})", {"summary is 1", "a text"}},
      {R"({"kind": "weave", "warp_count": 2.5})", {"warp_count is 2.5", "a whole number"}},
      {R"({"kind": "weave", "warp_count": 0})", {"warp_count is 0"}},
      {R"({"kind": "weave", "warp": {"gloss": {"f0": [0, 0, -1]}}})", {"warp.gloss.f0[2] is -1"}},
      {R"({"kind": "gravel", "stones": []})", {"stones has 0 entries"}},
      {R"({"kind": "gravel", "stones": {}})", {"stones is {}", "a list"}},
      {R"({"kind": "gravel", "stones": [{}, 3]})", {"stones[1] is 3", "an object"}},
      {R"({"kind": "gravel", "stones": [{"gloss": {"f0": [2, 0, 0]}}]})",
       {"stones[0].gloss.f0[0] is 2"}},
      {R"({"kind": "gravel", "stones": [{}, {"size": 1}]})", {"unknown field stones[1].size"}},
  };
  for (const Case& wrong : cases) {
    expect_input_error([&] { parse_material(wrong.text, "m.json"); }, wrong.message);
  }
}

TEST(Materials, RefusesWhatFieldsTogetherForbid) {
  const auto make = [](const std::string& text) {
    return make_surface(parse_material(text, "m.json"), 8, 8);
  };
  expect_input_error([&] { make(R"({"kind": "weave", "warp_count": 15})"); }, {"warp_count is 15"});
  expect_input_error([&] { make(R"({"kind": "gravel", "least_size": 20})"); }, {"most_size is 16"});
  expect_input_error([&] { make(R"({"kind": "gravel", "most_size": 900})"); },
                     {"most_size is 900"});
  expect_input_error([&] { make(R"({"kind": "gravel", "least_size": 0.1})"); }, {"least_size 0.1"});
}

}  // namespace
}  // namespace weft::test
