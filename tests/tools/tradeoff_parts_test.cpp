// The parts of weft tradeoff: points as text, pictures, and the page's limit.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "support/temporary_folder.hpp"
#include "tradeoff/grid.hpp"
#include "tradeoff/measure_point.hpp"
#include "tradeoff/page.hpp"
#include "tradeoff/pictures.hpp"
#include "tradeoff/results.hpp"
#include "weft/error.hpp"

namespace weft::test {
namespace {

using Words = std::vector<std::string>;

TEST(TradeoffPoints, WordsAreSplitAsAShellDoes) {
  EXPECT_EQ(split_words("a  --b 'c d'\t\"e 'f'\" g''h ''", "here"),
            (Words{"a", "--b", "c d", "e 'f'", "gh", ""}));
  EXPECT_EQ(split_words("", "here"), Words{});
  EXPECT_THROW(split_words("a \"b", "here"), Error);
  const Words words{"plain", "--region=0,0,4x4", "two words", "it's", "", "$HOME", "theta<=60"};
  EXPECT_EQ(split_words(join_words({"plain", "two words", "", "theta<=60"}), "here"),
            (Words{"plain", "two words", "", "theta<=60"}));
  EXPECT_EQ(join_words(words),
            R"(plain --region=0,0,4x4 'two words' 'it'\''s' '' '$HOME' 'theta<=60')");
}

PixelImage numbered(std::size_t height, std::size_t width, std::size_t channels) {
  PixelImage image{{height, width, channels, DType::u8}, {}};
  for (std::size_t i = 0; i < height * width * channels; ++i) {
    image.pixels.push_back(static_cast<std::byte>(i * 7 % 251));
  }
  return image;
}

TEST(TradeoffPictures, StripsAreCutFromTheirRow) {
  // Two images of 3 x 2 in two rows, 4 white pixels round each.
  const PixelImage sheet = numbered(4 + 2 * (2 + 4), 4 + 2 * (3 + 4), 3);
  const PixelImage strip = cut_strip(sheet, 1, 2, 3, 2, {});
  EXPECT_EQ(strip.info.width, 6U);
  EXPECT_EQ(strip.info.height, 2U);
  for (std::size_t y = 0; y < 2; ++y) {
    for (std::size_t x = 0; x < 6; ++x) {
      const std::size_t from = ((10 + y) * sheet.info.width + (x < 3 ? 4 + x : 11 + x - 3)) * 3;
      EXPECT_EQ(strip.pixels[(y * 6 + x) * 3 + 1], sheet.pixels[from + 1]) << y << " " << x;
    }
  }
  // The middle of the first tile.
  const PixelImage reduced = reduce_strip(strip, 2, {1, 1});
  EXPECT_EQ(reduced.info.bytes(), 3U);
  EXPECT_EQ(reduced.pixels[0], strip.pixels[1 * 3]);
  EXPECT_THROW(cut_strip(sheet, 2, 2, 3, 2, {}), Error);
  EXPECT_THROW(cut_strip(sheet, 0, 3, 3, 2, {}), Error);
}

TEST(TradeoffPictures, HalvesAreMeans) {
  PixelImage image{{3, 4, 1, DType::u8}, {}};
  for (const int value : {0, 2, 255, 255, 4, 6, 255, 255, 9, 9, 9, 9}) {
    image.pixels.push_back(static_cast<std::byte>(value));
  }
  const PixelImage half = halve(image);
  EXPECT_EQ(half.info.height, 1U);
  EXPECT_EQ(half.pixels, (std::vector<std::byte>{std::byte{3}, std::byte{255}}));
}

TEST(TradeoffPictures, Base64OfRfc4648) {
  const auto encoded = [](std::string_view text) {
    return base64(std::as_bytes(std::span(text.data(), text.size())));
  };
  EXPECT_EQ(encoded(""), "");
  EXPECT_EQ(encoded("f"), "Zg==");
  EXPECT_EQ(encoded("fo"), "Zm8=");
  EXPECT_EQ(encoded("foo"), "Zm9v");
  EXPECT_EQ(encoded("foob"), "Zm9vYg==");
  EXPECT_EQ(encoded("fooba"), "Zm9vYmE=");
  EXPECT_EQ(encoded("foobar"), "Zm9vYmFy");
  EXPECT_EQ(encoded("\xff\xff\xfe"), "///+");
}

// A material and points with pictures of noise, which no PNG makes small.
TradeoffResults noisy_results(const std::filesystem::path& folder, std::size_t count) {
  TradeoffResults results;
  results.program_version = "1.2.3";
  TradeoffMaterial material;
  material.name = "</script><script>alert(1)</script> <b>&amp;\"'";
  material.checksum = "0123456789abcdef";
  material.shape = {4, 4, 128, 128, 3};
  material.images.resize(4);
  std::filesystem::create_directories(folder / "images");
  std::uint32_t state = 1;
  const auto noise = [&](std::size_t height, std::size_t width) {
    PixelImage image = numbered(height, width, 3);
    for (std::byte& value : image.pixels) {
      state = state * 1664525U + 1013904223U;
      value = static_cast<std::byte>(state >> 24);
    }
    return image;
  };
  write_pixels(original_strip(folder, material), noise(128, 512));
  write_pixels(original_sphere(folder, material), noise(192, 192));
  for (std::size_t i = 0; i < count; ++i) {
    MeasuredPoint point;
    point.key = "key" + std::to_string(i);
    point.material = material.name;
    point.point = {"pca", {"--rank", std::to_string(i)}};
    write_pixels(decoded_strip(folder, point.key), noise(128, 512));
    write_pixels(decoded_sphere(folder, point.key), noise(192, 192));
    results.points.push_back(point);
  }
  results.materials.push_back(material);
  return results;
}

std::size_t count_of(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) {
    ++count;
  }
  return count;
}

TEST(TradeoffPage, PicturesKeepTheirLimit) {
  const TemporaryFolder folder;
  const TradeoffResults results = noisy_results(folder.path(), 4);
  const std::string whole = make_page(folder.path(), results);
  EXPECT_EQ(count_of(whole, "data:image/png"), 10U);
  // 307 kB of pixels in a point's two pictures; each step takes less room
  std::size_t before = whole.size();
  for (const std::size_t limit : {1'000'000U, 400'000U, 200'000U}) {
    const std::string page = make_page(folder.path(), results, limit);
    EXPECT_EQ(count_of(page, "data:image/png"), 10U) << limit;
    EXPECT_LT(page.size(), before);
    EXPECT_LT(page.size(), limit + 100'000);
    before = page.size();
  }
  const std::string least = make_page(folder.path(), results, 100'000);
  EXPECT_GT(count_of(least, "\"left_out\":true"), 0U);
  EXPECT_LT(count_of(least, "data:image/png"), 10U);
}

TEST(TradeoffPage, TextsAreNoMarkup) {
  const TemporaryFolder folder;
  const std::string page = make_page(folder.path(), noisy_results(folder.path(), 1));
  EXPECT_EQ(count_of(page, "<script"), 2U);
  EXPECT_EQ(count_of(page, "</script"), 2U);
  EXPECT_EQ(count_of(page, "<b>"), 0U);
}

TEST(TradeoffResults, SurviveTheirFile) {
  const TemporaryFolder folder;
  TradeoffResults results;
  results.program_version = "1.2.3";
  results.device = "a device";
  TradeoffMaterial material;
  material.name = "cloth";
  material.images.push_back({1, 2, 3.5, 4.5, 5.5, 6.5});
  results.materials.push_back(material);
  MeasuredPoint point;
  point.key = "k";
  point.material = "cloth";
  point.point = {"pca", {"--rank", "3"}};
  point.figures = {{"rmse", 0.1}, {"psnr", std::numeric_limits<double>::infinity()}};
  point.parameters = R"({"rank":3})";
  results.put(point);
  point.message = "again";
  results.put(point);
  save_results(folder / "r.json", results);
  const TradeoffResults read = load_results(folder / "r.json");
  ASSERT_EQ(read.points.size(), 1U);
  EXPECT_EQ(read.points[0].figures, point.figures);
  EXPECT_EQ(read.points[0].message, "again");
  EXPECT_EQ(read.points[0].parameters, point.parameters);
  ASSERT_EQ(read.materials.size(), 1U);
  EXPECT_EQ(read.materials[0].images[0].light_phi, 6.5);
  EXPECT_TRUE(std::isnan(read.materials[0].exposure));
  EXPECT_EQ(to_json(read), to_json(results));
  EXPECT_TRUE(load_results(folder / "none.json").points.empty());
}

}  // namespace
}  // namespace weft::test
