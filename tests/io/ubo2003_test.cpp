#include "weft/io/ubo2003.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "support/captures.hpp"
#include "support/expect_error.hpp"
#include "support/image_files.hpp"
#include "support/largest_allocation.hpp"
#include "support/temporary_folder.hpp"
#include "weft/error.hpp"
#include "weft/io/ubo_names.hpp"

namespace weft {
namespace {

using test::expect_error;
using test::Files;
using test::make_jpeg;
using test::read_all;
using test::smooth_image;
using test::smooth_png;
using test::TemporaryFolder;
using test::write_folder;
using test::write_zip;

constexpr ImageInfo small{6, 5, 3, DType::u8};

TEST(NaturalOrder, NumbersCompareAsNumbers) {
  std::vector<std::string> names{"cat.10.png",
                                 "cat.2.png",
                                 "Cat.1.png",
                                 "cat.02.png",
                                 "cat.1.png",
                                 "cat.png",
                                 "cat.2b.png",
                                 "cat.99999999999999999999999.png",
                                 "cat.100000000000000000000000.png"};
  std::sort(names.begin(), names.end(), natural_less);
  EXPECT_EQ(names,
            (std::vector<std::string>{"Cat.1.png", "cat.1.png", "cat.02.png", "cat.2.png",
                                      "cat.2b.png", "cat.10.png", "cat.99999999999999999999999.png",
                                      "cat.100000000000000000000000.png", "cat.png"}));
  for (const std::string& name : names) EXPECT_FALSE(natural_less(name, name));
}

TEST(UboNames, AnglesAreFoundInAnyOrder) {
  const auto found = directions_in_name("m/tv030_pv090/00008 tl015 pl060 tv030 pv090.jpg");
  ASSERT_TRUE(found);
  EXPECT_EQ(found->view.theta, 30);
  EXPECT_EQ(found->view.phi, 90);
  EXPECT_EQ(found->light.theta, 15);
  EXPECT_EQ(found->light.phi, 60);
  const auto utia = directions_in_name("tl000_pl000_tv075_pv352.5.png");
  ASSERT_TRUE(utia);
  EXPECT_EQ(utia->view.phi, 352.5);
  const auto spectral = directions_in_name("tv22.5_pv1_tl7.25_pl359.exr");
  ASSERT_TRUE(spectral);
  EXPECT_EQ(spectral->light.theta, 7.25);
}

TEST(UboNames, WhatIsNoNameOfThatFormIsNone) {
  for (const char* name :
       {"", "preview.jpg", "00008 tl000 pl000 tv030.jpg", "tl000 pl000 tv030 pv030 pv040.jpg",
        "tl000 pl000 tv pv030.jpg", "tl000 pl000 tv-10 pv030.jpg", "atl000 pl000 tv030 pv030.jpg",
        "tl000 pl000 tv03x pv030.jpg", "tl000 pl000 tv1e3 pv030.jpg",
        "tl000 pl000 tv030_pv030/a.jpg", "tl000 pl000 tv0000000000000000000000 pv030.jpg"}) {
    EXPECT_FALSE(directions_in_name(name)) << name;
  }
}

TEST(UboNames, WrittenNamesBringTheDirectionBack) {
  EXPECT_EQ(ubo_file_name(8, direction_from_degrees(30, 30), direction_from_degrees(0, 0), ".jpg"),
            "tv030_pv030/00008 tl000 pl000 tv030 pv030.jpg");
  EXPECT_EQ(ubo_file_name(7, direction_from_degrees(67.5, 352.5), direction_from_degrees(23.5, 7.5),
                          ".exr"),
            "tv067.5_pv352.5/00007 tl023.5 pl007.5 tv067.5 pv352.5.exr");
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int trial = 0; trial < 300; ++trial) {
    const Direction view =
        direction_from_degrees(90 * uniform(generator), 360 * uniform(generator));
    const Direction light = direction_from_degrees(1e-3 * uniform(generator), 359.99999);
    const auto found = directions_in_name(ubo_file_name(0, view, light, ".png"));
    ASSERT_TRUE(found);
    const Direction view_back = direction_from_degrees(found->view.theta, found->view.phi);
    const Direction light_back = direction_from_degrees(found->light.theta, found->light.phi);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(view_back[i], view[i], 0x1p-23f);
      EXPECT_NEAR(light_back[i], light[i], 0x1p-23f);
    }
  }
}

std::string name_of_pair(int index, int tl, int pl, int tv, int pv, const char* ending = "png") {
  return fmt::format("mat/tv{3:03}_pv{4:03}/{0:05} tl{1:03} pl{2:03} tv{3:03} pv{4:03}.{5}", index,
                     tl, pl, tv, pv, ending);
}

// Two views and three lights, their seeds v 10 + l in sorted order, in a shuffled list.
Files two_by_three() {
  return {{name_of_pair(0, 15, 60, 30, 90), smooth_png(small, 12)},
          {name_of_pair(1, 0, 0, 0, 0), smooth_png(small, 0)},
          {name_of_pair(2, 15, 0, 0, 0), smooth_png(small, 1)},
          {name_of_pair(3, 15, 60, 0, 0), smooth_png(small, 2)},
          {name_of_pair(4, 0, 0, 30, 90), smooth_png(small, 10)},
          {name_of_pair(5, 15, 0, 30, 90), smooth_png(small, 11)}};
}

void expect_two_by_three(TileSource& source) {
  const BtfInfo& info = source.info();
  ASSERT_EQ(info.shape, (BtfShape{2, 3, 6, 5, 3}));
  EXPECT_EQ(info.dtype, DType::u8);
  EXPECT_EQ(info.encoding, Encoding::gamma22);
  EXPECT_EQ(info.view_directions,
            (std::vector<Direction>{direction_from_degrees(0, 0), direction_from_degrees(30, 90)}));
  EXPECT_EQ(info.light_directions,
            (std::vector<Direction>{direction_from_degrees(0, 0), direction_from_degrees(15, 0),
                                    direction_from_degrees(15, 60)}));
  std::vector<std::byte> expected;
  for (const unsigned seed : {0u, 1u, 2u, 10u, 11u, 12u}) {
    const std::vector<std::byte> image = smooth_image(small, seed);
    expected.insert(expected.end(), image.begin(), image.end());
  }
  EXPECT_EQ(read_all(source), expected);
  std::vector<std::byte> two(2 * info.image_bytes());
  source.read(3, 2, two);
  EXPECT_TRUE(std::equal(two.begin(), two.end(),
                         expected.begin() + static_cast<std::ptrdiff_t>(3 * info.image_bytes())));
}

TEST(Ubo2003, FolderAndZipGiveTheSortedGrid) {
  const TemporaryFolder folder;
  Files files = two_by_three();
  files.push_back({"mat/preview.png", smooth_png(small, 5)});
  files.push_back({"__MACOSX/mat/._a.png", test::bytes_of_text("x")});
  files.push_back({"mat/.hidden.png", test::bytes_of_text("x")});
  write_folder(folder / "ubo", files);
  write_zip(folder / "deflated.zip", files);
  write_zip(folder / "stored.zip", files, false);
  for (const char* name : {"ubo", "deflated.zip", "stored.zip"}) {
    const auto collection = open_image_collection(folder / name);
    EXPECT_TRUE(has_ubo_names(*collection));
    const Capture capture = open_ubo2003(collection);
    EXPECT_EQ(capture.ignored, std::vector<std::string>{"mat/preview.png"});
    expect_two_by_three(*capture.source);
  }
}

TEST(Ubo2003, UnderscoresDecimalsAndJpegs) {
  const TemporaryFolder folder;
  const std::vector<std::byte> jpeg = make_jpeg(small, smooth_image(small, 1));
  write_folder(folder / "utia",
               {{"tl000_pl000_tv007.5_pv352.5.jpg", jpeg}, {"tl000_pl000_tv000_pv000.jpg", jpeg}});
  const Capture capture = open_ubo2003(open_image_collection(folder / "utia"));
  EXPECT_EQ(capture.source->info().view_directions[1], direction_from_degrees(7.5, 352.5));
  std::vector<std::byte> image(small.bytes()), expected(small.bytes());
  capture.source->read(1, 1, image);
  read_image(jpeg, "a", small, expected);
  EXPECT_EQ(image, expected);
}

TEST(Ubo2003, ExrIsLinear) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "e");
  const ImageInfo half{2, 2, 3, DType::f16};
  write_exr(folder / "e/tl000 pl000 tv000 pv000.exr", half, std::vector<std::byte>(half.bytes()),
            ExrCompression::zip);
  const Capture capture = open_ubo2003(open_image_collection(folder / "e"));
  EXPECT_EQ(capture.source->info().encoding, Encoding::linear);
  EXPECT_EQ(capture.source->info().dtype, DType::f16);
}

template <typename Action>
void expect_input_error(std::initializer_list<std::string_view> parts, Action action) {
  expect_error(ErrorKind::input, parts, action);
}

TEST(Ubo2003, MissingAndRepeatedPairsAreNamed) {
  const TemporaryFolder folder;
  Files files = two_by_three();
  Files missing = files;
  missing.erase(missing.begin() + 4);
  write_folder(folder / "missing", missing);
  expect_input_error(
      {"missing: 1 of 6 view-light pairs (2 views, 3 lights) is missing: view (theta "
       "30, phi 90) with light (theta 0, phi 0)"},
      [&] { open_ubo2003(open_image_collection(folder / "missing")); });
  Files repeated = files;
  repeated.push_back({name_of_pair(6, 15, 60, 0, 0), smooth_png(small, 2)});
  write_folder(folder / "repeated", repeated);
  expect_input_error({"1 view-light pair comes more than once: view (theta 0, phi 0) with light "
                      "(theta 15, phi 60) in ",
                      "00003 tl015", "00006 tl015"},
                     [&] { open_ubo2003(open_image_collection(folder / "repeated")); });
  // The zenith has no azimuth, and a full turn is none.
  Files zenith = files;
  zenith.push_back({name_of_pair(6, 15, 60, 0, 45), smooth_png(small, 2)});
  write_folder(folder / "zenith", zenith);
  expect_input_error({"comes more than once"},
                     [&] { open_ubo2003(open_image_collection(folder / "zenith")); });
  // A diagonal of many images: the first few of the gaps and their count.
  Files diagonal;
  for (int i = 0; i < 50; ++i) {
    diagonal.push_back({name_of_pair(i, i, 0, i, 0), smooth_png({1, 1, 1, DType::u8}, 1)});
  }
  write_folder(folder / "diagonal", diagonal);
  expect_input_error({"2450 of 2500 view-light pairs (50 views, 50 lights) are missing", "; ..."},
                     [&] { open_ubo2003(open_image_collection(folder / "diagonal")); });
}

TEST(Ubo2003, OddNamesSizesAndFilesAreNamed) {
  const TemporaryFolder folder;
  write_folder(folder / "none", {{"preview.png", smooth_png(small, 1)}});
  expect_input_error({"none", "no images named by their directions"},
                     [&] { open_ubo2003(open_image_collection(folder / "none")); });
  write_folder(folder / "steep", {{"tl000 pl000 tv095 pv000.png", smooth_png(small, 1)}});
  expect_input_error({"tv095", "theta 95"},
                     [&] { open_ubo2003(open_image_collection(folder / "steep")); });
  Files files = two_by_three();
  files[1].second = smooth_png({6, 4, 3, DType::u8}, 1);
  files[4].second = test::bytes_of_text("no image at all");
  write_folder(folder / "sizes", files);
  // The first image in order is the odd one: the others differ from it.
  const Capture capture = open_ubo2003(open_image_collection(folder / "sizes"));
  std::vector<std::byte> image(capture.source->info().image_bytes());
  capture.source->read(0, 1, image);
  expect_input_error({"00002 tl015 pl000", "5 x 6", "4 x 6"},
                     [&] { capture.source->read(1, 1, image); });
  expect_input_error({"00004 tl000 pl000", "neither a PNG"},
                     [&] { capture.source->read(3, 1, image); });
}

// --- archives ---

// Also checks that memory grows with what is there, not with what is claimed: read_all itself needs
// the values of six small images.
void expect_zip_error(const std::filesystem::path& path, std::string_view part) {
  test::reset_largest_allocation();
  expect_input_error({path.filename().string(), part}, [&] {
    const Capture capture = open_ubo2003(open_image_collection(path));
    read_all(*capture.source);
  });
  EXPECT_LE(test::largest_allocation(), std::size_t{2} << 20);
}

// Where `text` comes for the n-th time.
std::size_t find(const std::vector<std::byte>& file, std::string_view text, std::size_t n) {
  const auto bytes = std::as_bytes(std::span(text));
  auto at = file.begin();
  while (true) {
    at = std::search(at, file.end(), bytes.begin(), bytes.end());
    if (at == file.end()) throw std::runtime_error("not found");
    if (n-- == 0) return static_cast<std::size_t>(at - file.begin());
    ++at;
  }
}

void store(std::vector<std::byte>& file, std::size_t offset, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) {
    file.at(offset + i) = static_cast<std::byte>(value >> (8 * i) & 0xff);
  }
}

TEST(Zip, LyingSizesAreInputErrors) {
  const TemporaryFolder folder;
  write_zip(folder / "good.zip", two_by_three());
  const std::vector<std::byte> good = test::file_bytes(folder / "good.zip");
  constexpr std::string_view central = "PK\x01\x02";
  const std::size_t first = find(good, central, 0);
  // Central directory: compressed size at 20, size at 24.
  for (const std::uint32_t claimed : {0u, 10u, 100000u, 0x3fffffffu, 0x7fffffffu, 0xfffffffeu}) {
    std::vector<std::byte> file = good;
    store(file, first + 24, claimed);
    test::write_bytes(folder / "size.zip", file);
    expect_zip_error(folder / "size.zip", "mat/");
  }
  for (const std::uint32_t claimed : {0u, 10u}) {
    std::vector<std::byte> file = good;
    store(file, first + 20, claimed);
    test::write_bytes(folder / "packed.zip", file);
    expect_zip_error(folder / "packed.zip", "mat/");
  }
  // Too much is no harm: the packed data say themselves where they end.
  std::vector<std::byte> file = good;
  store(file, first + 20, 0x3fffffff);
  test::write_bytes(folder / "packed.zip", file);
  expect_two_by_three(*open_ubo2003(open_image_collection(folder / "packed.zip")).source);
}

TEST(Zip, EncryptedMembersAreNamed) {
  const TemporaryFolder folder;
  write_zip(folder / "good.zip", two_by_three());
  std::vector<std::byte> file = test::file_bytes(folder / "good.zip");
  // The flag of encryption in the first entry of the central directory and in its local header.
  const std::size_t first = find(file, "PK\x01\x02", 0);
  file[first + 8] |= std::byte{1};
  file[find(file, "PK\x03\x04", 0) + 6] |= std::byte{1};
  test::write_bytes(folder / "locked.zip", file);
  expect_zip_error(folder / "locked.zip", "encrypted");
}

TEST(Zip, TruncatedAndDamagedArchivesAreInputErrors) {
  const TemporaryFolder folder;
  write_zip(folder / "good.zip", two_by_three());
  const std::vector<std::byte> good = test::file_bytes(folder / "good.zip");
  for (std::size_t length = 0; length < good.size(); length += 97) {
    test::write_bytes(folder / "short.zip", std::span(good).first(length));
    expect_zip_error(folder / "short.zip", "");
  }
  // Any byte of a member's data: found by the archive's checksum or the image's own.
  const std::size_t data = find(good, "PK\x03\x04", 0) + 30 + 60;
  for (std::size_t offset = data; offset < data + 40; offset += 7) {
    std::vector<std::byte> file = good;
    file[offset] ^= std::byte{0x55};
    test::write_bytes(folder / "damaged.zip", file);
    expect_zip_error(folder / "damaged.zip", "mat/");
  }
  test::write_bytes(folder / "text.zip", test::bytes_of_text("hello"));
  expect_zip_error(folder / "text.zip", "neither a folder nor a zip");
  expect_input_error({"absent.zip"}, [&] { open_image_collection(folder / "absent.zip"); });
}

TEST(Zip, TwoMembersOfOneNameAreARepeatedPair) {
  const TemporaryFolder folder;
  Files files = two_by_three();
  files.push_back({name_of_pair(9, 15, 60, 0, 0), smooth_png(small, 2)});
  write_zip(folder / "a.zip", files);
  // Rename the last member to the fourth: the writer itself refuses equal names.
  std::vector<std::byte> file = test::file_bytes(folder / "a.zip");
  for (std::size_t n = 0; n < 2; ++n) file[find(file, "/00009", 0) + 5] = std::byte{'3'};
  test::write_bytes(folder / "twice.zip", file);
  expect_zip_error(folder / "twice.zip", "comes more than once");
}

}  // namespace
}  // namespace weft
