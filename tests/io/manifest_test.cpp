#include "weft/io/manifest.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "support/captures.hpp"
#include "support/expect_error.hpp"
#include "support/image_files.hpp"
#include "support/temporary_folder.hpp"
#include "weft/io/capture.hpp"
#include "weft/io/fixed_view.hpp"

namespace weft {
namespace {

using test::bytes_of_text;
using test::expect_error;
using test::Files;
using test::read_all;
using test::smooth_image;
using test::smooth_png;
using test::TemporaryFolder;
using test::write_folder;
using test::write_text;

constexpr ImageInfo small{4, 5, 3, DType::u8};

// Images a.png, b.png, ... with seeds 0, 1, ...
Files lettered(std::size_t count) {
  Files files;
  for (std::size_t i = 0; i < count; ++i) {
    files.push_back({fmt::format("{}.png", static_cast<char>('a' + i)),
                     smooth_png(small, static_cast<unsigned>(i))});
  }
  return files;
}

// The seeds of the images, in the order of the source.
std::vector<unsigned> seeds(TileSource& source, unsigned limit = 20) {
  std::vector<unsigned> found;
  std::vector<std::byte> image(source.info().image_bytes());
  for (std::size_t i = 0; i < source.info().shape.images(); ++i) {
    source.read(i, 1, image);
    for (unsigned seed = 0; seed < limit; ++seed) {
      if (image == smooth_image(small, seed)) found.push_back(seed);
    }
  }
  return found;
}

Capture open_with(const TemporaryFolder& folder, const std::string& name, const std::string& text,
                  std::size_t images = 4, CaptureOptions options = {}) {
  const std::filesystem::path path = folder / "capture";
  std::filesystem::remove_all(path);
  write_folder(path, lettered(images));
  write_text(path / name, text);
  return open_capture(path, options);
}

void expect_rejected(const std::string& name, const std::string& text,
                     std::initializer_list<std::string_view> parts) {
  const TemporaryFolder folder;
  expect_error(ErrorKind::input, parts, [&] { open_with(folder, name, text); });
}

TEST(CsvManifest, AnglesInOrderOfAppearance) {
  const TemporaryFolder folder;
  const Capture capture = open_with(folder, "manifest.csv",
                                    "# a comment\n"
                                    "light_phi,light_theta,file,view_theta,view_phi\r\n"
                                    "90,30,b.png,10,0\n"
                                    "\n"
                                    "90, 30, \"a.png\", 0, 0\n"
                                    "0,45,c.png,0,0\n"
                                    "0,45,./d.png,10,0\n");
  EXPECT_EQ(capture.kind, "manifest");
  const BtfInfo& info = capture.source->info();
  EXPECT_EQ(info.shape, (BtfShape{2, 2, 4, 5, 3}));
  EXPECT_EQ(info.encoding, Encoding::srgb);
  EXPECT_EQ(info.view_directions,
            (std::vector<Direction>{direction_from_degrees(10, 0), direction_from_degrees(0, 0)}));
  EXPECT_EQ(info.light_directions[0], direction_from_degrees(30, 90));
  EXPECT_EQ(seeds(*capture.source), (std::vector<unsigned>{1, 3, 0, 2}));
}

TEST(CsvManifest, VectorsAndAFixedView) {
  const TemporaryFolder folder;
  const Capture capture = open_with(folder, "manifest.csv",
                                    "file,light_x,light_y,light_z\n"
                                    "a.png,0.6,0,0.8\n"
                                    "c.png,0,-0.6,0.8\n");
  const BtfInfo& info = capture.source->info();
  EXPECT_EQ(info.shape.views, 1u);
  EXPECT_EQ(info.view_directions[0], (Direction{0, 0, 1}));
  EXPECT_EQ(info.light_directions[1], (Direction{0, -0.6f, 0.8f}));
  EXPECT_EQ(capture.ignored, (std::vector<std::string>{"b.png", "d.png"}));
}

TEST(CsvManifest, IndicesIntoListsBesideIt) {
  const TemporaryFolder folder;
  write_text(folder / "lists/views.txt", "2\n0 0 1\n0.6 0 0.8\n");
  write_text(folder / "lists/lights.txt", "0,0,1\n0,0.6,0.8 # the second\n");
  write_text(folder / "lists/list.csv",
             "file,view,light\na.png,1,0\nb.png,0,1\nc.png,0,0\nd.png,1,1\n");
  CaptureOptions options;
  options.manifest = folder / "lists/list.csv";
  write_folder(folder / "images", lettered(4));
  const Capture capture = open_capture(folder / "images", options);
  EXPECT_EQ(seeds(*capture.source), (std::vector<unsigned>{2, 1, 0, 3}));
  EXPECT_EQ(capture.source->info().view_directions[1], (Direction{0.6f, 0, 0.8f}));
  // In an archive the lists lie beside the manifest inside.
  Files files = lettered(4);
  files.push_back({"manifest.csv", test::file_bytes(folder / "lists/list.csv")});
  files.push_back({"views.txt", test::file_bytes(folder / "lists/views.txt")});
  files.push_back({"lights.txt", test::file_bytes(folder / "lists/lights.txt")});
  test::write_zip(folder / "capture.zip", files);
  EXPECT_EQ(seeds(*open_capture(folder / "capture.zip", {}).source),
            (std::vector<unsigned>{2, 1, 0, 3}));
  // A manifest as the input itself stands for its folder.
  write_folder(folder / "lists", lettered(4));
  EXPECT_EQ(seeds(*open_capture(folder / "lists/list.csv", {}).source),
            (std::vector<unsigned>{2, 1, 0, 3}));
}

TEST(CsvManifest, WhatIsWrongIsNamedWithItsLine) {
  const std::string header = "file,light_theta,light_phi\n";
  expect_rejected("manifest.csv", "", {"manifest.csv", "no header line"});
  expect_rejected("manifest.csv", header, {"manifest.csv: no images"});
  expect_rejected("manifest.csv", "file,exposure\n", {"manifest.csv:1", "'exposure'"});
  expect_rejected("manifest.csv", "file,file,light\n", {"column 'file' comes twice"});
  expect_rejected("manifest.csv", "light_theta,light_phi\n", {"no column 'file'"});
  expect_rejected("manifest.csv", "file,view_theta,view_phi\n", {"no columns for the light"});
  expect_rejected("manifest.csv", "file,light_theta\n", {"columns of the light are missing"});
  expect_rejected("manifest.csv", "file,light_x,light_y,light_z,light\n",
                  {"the light is given in more than one form"});
  expect_rejected("manifest.csv", "file,light\na.png,0\n", {"need a lights.txt"});
  expect_rejected("manifest.csv", header + "a.png,0\n", {"manifest.csv:2", "2 fields for 3"});
  expect_rejected("manifest.csv", header + "a.png,0,1e999\n", {":2", "'1e999'"});
  expect_rejected("manifest.csv", header + "a.png,0,nan\n", {":2", "'nan'"});
  expect_rejected("manifest.csv", header + "a.png,0,1x\n", {":2", "'1x'"});
  expect_rejected("manifest.csv", header + "\"a.png,0,1\n", {":2", "quote"});
  expect_rejected("manifest.csv", header + "z.png,0,1\n", {":2", "no file 'z.png'"});
  expect_rejected("manifest.csv", header + "../capture/a.png,0,1\n", {"no file"});
  expect_rejected("manifest.csv", header + "a.png,0,1\na.png,1,1\n",
                  {":3", "'a.png' is listed before", ":2"});
  expect_rejected("manifest.csv", header + "a.png,0,1\nb.png,0,1\n",
                  {"comes more than once", "a.png", "b.png"});
  expect_rejected("manifest.csv", "file,light_x,light_y,light_z\na.png,0.5,0,0.5\n",
                  {":2", "(0.5, 0, 0.5) is no unit vector"});
  expect_rejected("manifest.csv",
                  "file,view_theta,view_phi,light_theta,light_phi\na.png,0,0,0,0\nb.png,5,0,7,0\n",
                  {"2 of 4 view-light pairs"});
}

TEST(JsonManifest, EveryFormOfADirection) {
  const TemporaryFolder folder;
  const Capture capture = open_with(folder, "manifest.json", R"({
    "views": [[0, 0, 1], {"theta": 30, "phi": 0}], "encoding": "gamma2.2", "quantity": "brdf",
    "source": "a test", "channel_names": ["r", "g", "b"], "mask": "d.png",
    "images": [{"file": "b.png", "view": 1, "light": [15, 90]},
               {"file": "a.png", "light": {"theta": 15, "phi": 90}}]})");
  const BtfInfo& info = capture.source->info();
  EXPECT_EQ(info.shape, (BtfShape{2, 1, 4, 5, 3}));
  EXPECT_EQ(info.encoding, Encoding::gamma22);
  EXPECT_EQ(info.quantity, Quantity::brdf);
  EXPECT_EQ(info.source, "a test");
  EXPECT_EQ(info.channel_names[2], "b");
  EXPECT_EQ(info.view_directions[1], direction_from_degrees(30, 0));
  EXPECT_EQ(info.light_directions[0], direction_from_degrees(15, 90));
  EXPECT_EQ(seeds(*capture.source), (std::vector<unsigned>{0, 1}));
  EXPECT_EQ(capture.ignored, std::vector<std::string>{"c.png"});
  // The mask is that of both views.
  const std::vector<std::byte> mask_image = smooth_image(small, 3);
  ASSERT_EQ(info.mask.size(), 2 * 20u);
  for (std::size_t i = 0; i < 20; ++i) {
    const std::byte* texel = mask_image.data() + 3 * i;
    const std::uint8_t expected = *std::max_element(texel, texel + 3) >= std::byte{128} ? 1 : 0;
    EXPECT_EQ(info.mask[i], expected);
    EXPECT_EQ(info.mask[20 + i], expected);
  }
}

TEST(JsonManifest, PairsKeepTheirOrder) {
  const TemporaryFolder folder;
  const std::string images = R"("images": [
      {"file": "c.png", "view": [10, 0], "light": [20, 0]},
      {"file": "a.png", "view": [30, 0], "light": [40, 0]}])";
  const Capture capture =
      open_with(folder, "manifest.json", "{\"layout\": \"paired\", " + images + "}");
  const BtfInfo& info = capture.source->info();
  EXPECT_EQ(info.layout, Layout::paired);
  EXPECT_EQ(info.shape, (BtfShape{2, 1, 4, 5, 3}));
  EXPECT_EQ(info.light_directions[1], direction_from_degrees(40, 0));
  EXPECT_EQ(seeds(*capture.source), (std::vector<unsigned>{2, 0}));
  // The option says it as well; without it they are an incomplete grid.
  CaptureOptions options;
  options.layout = Layout::paired;
  EXPECT_EQ(
      open_with(folder, "manifest.json", "{" + images + "}", 4, options).source->info().shape.views,
      2u);
  expect_rejected("manifest.json", "{" + images + "}", {"2 of 4 view-light pairs"});
}

TEST(JsonManifest, WhatIsWrongIsNamed) {
  const auto image = [](const std::string& fields) { return "{\"images\": [{" + fields + "}]}"; };
  expect_rejected("manifest.json", "{", {"manifest.json", "not valid JSON"});
  expect_rejected("manifest.json", "{}", {"no list \"images\""});
  expect_rejected("manifest.json", "{\"images\": []}", {"no images"});
  expect_rejected("manifest.json", "{\"images\": [7]}", {"images[0] is not an object"});
  expect_rejected("manifest.json", image("\"light\": [0,0]"), {"images[0]", "\"file\" is missing"});
  expect_rejected("manifest.json", image("\"file\": \"a.png\""), {"\"light\" is missing"});
  expect_rejected("manifest.json", image("\"file\": \"a.png\", \"light\": 0"), {"light 0 of 0"});
  expect_rejected("manifest.json", image("\"file\": \"a.png\", \"light\": -1"), {"-1"});
  expect_rejected("manifest.json", image("\"file\": \"a.png\", \"light\": [1,2,3,4]"),
                  {"images[0]: \"light\"", "neither"});
  expect_rejected("manifest.json", image("\"file\": \"a.png\", \"light\": [0,0,2]"),
                  {"(0, 0, 2) is no unit vector"});
  expect_rejected("manifest.json", image("\"file\": \"a.png\", \"light\": [0,0,1e300]"),
                  {"is no unit vector"});
  expect_rejected("manifest.json",
                  "{\"encoding\": \"log\", \"images\": [{\"file\": \"a.png\", \"light\": [0,0]}]}",
                  {"encoding", "\"log\" is none of"});
  expect_rejected("manifest.json",
                  "{\"mask\": \"z.png\", \"images\": [{\"file\": \"a.png\", \"light\": [0,0]}]}",
                  {"\"mask\"", "z.png"});
}

TEST(Lights, NaturalOrderMaskAndAListElsewhere) {
  const TemporaryFolder folder;
  Files files;
  for (const unsigned i : {0u, 1u, 2u, 10u}) {
    files.push_back({fmt::format("cat.{}.png", i), smooth_png(small, i)});
  }
  std::vector<std::byte> mask(small.bytes(), std::byte{255});
  mask[0] = mask[1] = mask[2] = std::byte{127};
  write_folder(folder / "cat", files);
  write_png(folder / "cat/cat.mask.png", small, mask);
  write_text(folder / "lights.txt", "4\n0 0 1\n0.6 0 0.8\n0 0.6 0.8\n0.403259 0.480808 0.778592\n");
  CaptureOptions options;
  options.lights_file = folder / "lights.txt";
  const Capture capture = open_capture(folder / "cat/", options);
  EXPECT_EQ(capture.kind, "lights");
  const BtfInfo& info = capture.source->info();
  EXPECT_EQ(info.shape, (BtfShape{1, 4, 4, 5, 3}));
  EXPECT_EQ(info.source, "cat");
  EXPECT_EQ(info.view_directions[0], (Direction{0, 0, 1}));
  EXPECT_NEAR(info.light_directions[3][2], 0.778592f, 1e-5f);
  EXPECT_EQ(seeds(*capture.source), (std::vector<unsigned>{0, 1, 2, 10}));
  ASSERT_EQ(info.mask.size(), 20u);
  EXPECT_EQ(info.mask[0], 0);
  EXPECT_EQ(info.mask[1], 1);
  // The list may lie in the folder.
  write_text(folder / "cat/lights.txt", "0 0 1\n0.6 0 0.8\n0 0.6 0.8\n0 -0.6 0.8\n");
  EXPECT_EQ(open_capture(folder / "cat", {}).source->info().light_directions[3][1], -0.6f);
}

TEST(Lights, WhatIsWrongIsNamed) {
  const auto rejected = [](const std::string& lights,
                           std::initializer_list<std::string_view> parts) {
    expect_rejected("lights.txt", lights, parts);
  };
  rejected("", {"lights.txt", "no vectors"});
  rejected("3\n0 0 1\n", {"1 vectors where 3 are announced"});
  rejected("0 0 1\n0 0 1\n", {"2 directions for 4 images"});
  rejected("0 0 1\n0 1\n", {"lights.txt:2", "2 numbers"});
  rejected("0 0 1\n0 x 1\n", {"lights.txt:2", "'x'"});
  rejected("0 0 1\n0 0 0\n", {"direction 1", "(0, 0, 0)"});
  rejected("0 0 1\n0 0 1.1\n", {"direction 1", "(0, 0, 1.1)"});
  rejected("0 0 1\n0 0 inf\n", {"'inf'"});
  const TemporaryFolder folder;
  Files files = lettered(1);
  files.push_back({"a.mask.png", smooth_png(small, 1)});
  files.push_back({"b_mask.png", smooth_png(small, 1)});
  files.push_back({"lights.txt", bytes_of_text("0 0 1\n")});
  write_folder(folder / "masks", files);
  expect_error(ErrorKind::input, {"2 images are named as masks"},
               [&] { open_capture(folder / "masks", {}); });
  files[2] = {"b.txt", bytes_of_text("")};
  files[1].second = smooth_png({3, 5, 3, DType::u8}, 1);
  std::filesystem::remove_all(folder / "masks");
  write_folder(folder / "masks", files);
  expect_error(ErrorKind::input, {"a.mask.png", "5 x 3", "5 x 4"},
               [&] { open_capture(folder / "masks", {}); });
}

TEST(Flash, PairsPointFromTheSampleCentre) {
  const TemporaryFolder folder;
  Files files = lettered(2);
  files.push_back({"camera_pos.txt", bytes_of_text("0,0,17\n3,0,4\n")});
  files.push_back({"light_pos.txt", bytes_of_text("0 6 8\n0,-3,4\n")});
  write_folder(folder / "cards", files);
  const Capture capture = open_capture(folder / "cards", {});
  EXPECT_EQ(capture.kind, "flash");
  const BtfInfo& info = capture.source->info();
  EXPECT_EQ(info.layout, Layout::paired);
  EXPECT_EQ(info.shape, (BtfShape{2, 1, 4, 5, 3}));
  EXPECT_EQ(info.view_directions, (std::vector<Direction>{{0, 0, 1}, {0.6f, 0, 0.8f}}));
  EXPECT_EQ(info.light_directions, (std::vector<Direction>{{0, 0.6f, 0.8f}, {0, -0.6f, 0.8f}}));
  EXPECT_NE(info.source.find("cameras 5 to 17"), std::string::npos) << info.source;
  EXPECT_EQ(seeds(*capture.source), (std::vector<unsigned>{0, 1}));

  write_text(folder / "cards/light_pos.txt", "0 6 8\n0,-3,-4\n");
  expect_error(ErrorKind::input, {"light_pos.txt: position 1", "z = -4"},
               [&] { open_capture(folder / "cards", {}); });
  write_text(folder / "cards/light_pos.txt", "0 6 8\n");
  expect_error(ErrorKind::input, {"light_pos.txt", "1 directions for 2 images"},
               [&] { open_capture(folder / "cards", {}); });
}

TEST(Capture, KindsAreToldApartOrAskedFor) {
  const TemporaryFolder folder;
  write_folder(folder / "nothing", lettered(2));
  expect_error(ErrorKind::input, {"nothing", "no capture", "lights.txt"},
               [&] { open_capture(folder / "nothing", {}); });
  CaptureOptions options;
  options.kind = "photos";
  expect_error(ErrorKind::input, {"'photos' is none of auto, ubo2003"},
               [&] { open_capture(folder / "nothing", options); });
  options.kind = "flash";
  expect_error(ErrorKind::input, {"no camera_pos.txt"},
               [&] { open_capture(folder / "nothing", options); });
  options.lights_file = folder / "lights.txt";
  expect_error(ErrorKind::input, {"kind 'flash'"},
               [&] { open_capture(folder / "nothing", options); });
  expect_error(ErrorKind::input, {"absent"}, [&] { open_capture(folder / "absent", {}); });
}

}  // namespace
}  // namespace weft
