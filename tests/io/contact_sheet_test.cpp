#include "weft/io/contact_sheet.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <set>
#include <vector>

#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "weft/error.hpp"
#include "weft/io/image.hpp"

namespace weft::test {
namespace {

struct Png {
  ImageInfo info;
  std::vector<std::byte> pixels;
  int at(std::size_t x, std::size_t y, std::size_t c) const {
    return std::to_integer<int>(pixels[(y * info.width + x) * info.channels + c]);
  }
};

Png read_png(const std::filesystem::path& path) {
  Png png{image_info(path), {}};
  png.pixels.resize(png.info.bytes());
  read_image(path, png.info, png.pixels);
  return png;
}

TEST(ContactSheet, BeginsNewRows) {
  const TemporaryFolder folder;
  const BtfShape shape{1, 5, 2, 3, 3};
  const auto original = random_source(shape, DType::u8, 1);
  ContactSheetOptions options;
  options.images = {0, 1, 2, 3, 4};
  options.per_row = 2;
  options.spacing = 1;
  for (const bool compared : {false, true}) {
    const ContactSheet sheet = write_contact_sheet(folder / "s.png", *original,
                                                   compared ? original.get() : nullptr, options);
    const std::size_t line = compared ? 3 : 1;  // rows of images for each row of originals
    EXPECT_EQ(sheet.width, 2U * 4 + 1);
    EXPECT_EQ(sheet.height, 3U * line * 3 + 1);
    const Png png = read_png(folder / "s.png");
    for (std::size_t k = 0; k < 5; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        EXPECT_EQ(png.at(1 + k % 2 * 4, 1 + k / 2 * line * 3, c),
                  std::to_integer<int>(original->bytes()[k * shape.image_values() + c]));
      }
    }
    EXPECT_EQ(png.at(5, 1 + 2 * line * 3, 0), 255);  // no sixth image
  }
  // No more columns than images.
  options.per_row = 100;
  EXPECT_EQ(write_contact_sheet(folder / "s.png", *original, nullptr, options).width, 5U * 4 + 1);
}

TEST(ContactSheet, EightBitDataIsShownAsItIs) {
  const TemporaryFolder folder;
  const BtfShape shape{2, 2, 3, 2, 3};
  const auto original = random_source(shape, DType::u8, 1);
  const auto decoded = random_source(shape, DType::u8, 2);
  ContactSheetOptions options;
  options.images = {3, 1};
  options.difference_scale = 2;
  options.spacing = 1;
  const ContactSheet sheet =
      write_contact_sheet(folder / "s.png", *original, decoded.get(), options);
  EXPECT_EQ(sheet.width, 2U * 3 + 1);
  EXPECT_EQ(sheet.height, 3U * 4 + 1);
  EXPECT_EQ(sheet.exposure, 1.0);

  const Png png = read_png(folder / "s.png");
  ASSERT_EQ(png.info.width, sheet.width);
  ASSERT_EQ(png.info.height, sheet.height);
  for (std::size_t column = 0; column < 2; ++column) {
    for (std::size_t y = 0; y < shape.height; ++y) {
      for (std::size_t x = 0; x < shape.width; ++x) {
        for (std::size_t c = 0; c < 3; ++c) {
          const std::size_t value =
              options.images[column] * shape.image_values() + (y * shape.width + x) * 3 + c;
          const int a = std::to_integer<int>(original->bytes()[value]);
          const int b = std::to_integer<int>(decoded->bytes()[value]);
          const std::size_t px = 1 + column * 3 + x;
          EXPECT_EQ(png.at(px, 1 + y, c), a);
          EXPECT_EQ(png.at(px, 5 + y, c), b);
          EXPECT_EQ(png.at(px, 9 + y, c), std::min(255, 2 * std::abs(a - b)));
        }
      }
    }
  }
  // Spacing is white.
  EXPECT_EQ(png.at(0, 0, 0), 255);
  EXPECT_EQ(png.at(3, 2, 1), 255);
}

TEST(ContactSheet, FloatDataIsExposedToItsPercentile) {
  const TemporaryFolder folder;
  // 0, 1, ..., 100 in one image: the 99th percentile is 99.
  std::vector<double> values(101);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<double>(i);
  const auto source = source_of({1, 1, 1, 101, 1}, DType::f32, values);
  ContactSheetOptions options;
  options.images = {0};
  options.spacing = 0;
  const ContactSheet sheet = write_contact_sheet(folder / "s.png", *source, nullptr, options);
  EXPECT_EQ(sheet.exposure, 1.0 / 99.0);
  const Png png = read_png(folder / "s.png");
  EXPECT_EQ(png.info.channels, 1U);
  EXPECT_EQ(png.at(0, 0, 0), 0);
  EXPECT_EQ(png.at(99, 0, 0), 255);
  EXPECT_EQ(png.at(100, 0, 0), 255);
  // sRGB of 50/99 = 0.50505: 1.055 * 0.50505^(1/2.4) - 0.055 = 0.73866, 188.4 of 255.
  EXPECT_EQ(png.at(50, 0, 0), 188);

  options.exposure = 1.0;
  EXPECT_EQ(write_contact_sheet(folder / "s.png", *source, nullptr, options).exposure, 1.0);
  EXPECT_EQ(read_png(folder / "s.png").at(1, 0, 0), 255);
}

TEST(ContactSheet, ExtremesAreShownSomehow) {
  const TemporaryFolder folder;
  const double inf = std::numeric_limits<double>::infinity();
  ContactSheetOptions options;
  options.images = {0};
  options.spacing = 0;
  const auto odd = source_of({1, 1, 1, 4, 1}, DType::f32, std::vector<double>{inf, NAN, -inf, 0});
  EXPECT_EQ(write_contact_sheet(folder / "s.png", *odd, nullptr, options).exposure, 1.0);
  const Png png = read_png(folder / "s.png");
  EXPECT_EQ(png.at(0, 0, 0), 255);
  EXPECT_EQ(png.at(1, 0, 0), 0);
  EXPECT_EQ(png.at(2, 0, 0), 0);
}

TEST(ContactSheet, ChannelsThatAreShown) {
  const TemporaryFolder folder;
  ContactSheetOptions options;
  options.images = {0};
  for (const std::size_t channels : {1U, 2U, 3U, 5U}) {
    const auto source = random_source({1, 1, 2, 2, channels}, DType::u8, channels);
    write_contact_sheet(folder / "s.png", *source, nullptr, options);
    const Png png = read_png(folder / "s.png");
    EXPECT_EQ(png.info.channels, channels >= 3 ? 3U : 1U);
    // Second texel, first channel.
    EXPECT_EQ(png.at(5, 4, 0), std::to_integer<int>(source->bytes()[channels]));
  }
}

TEST(ContactSheet, RefusesWhatDoesNotFit) {
  const TemporaryFolder folder;
  const auto source = random_source({1, 2, 4, 4, 3}, DType::u8, 1);
  const auto other = random_source({1, 2, 4, 5, 3}, DType::u8, 1);
  const auto fails = [&](ContactSheetOptions options, TileSource* decoded) {
    EXPECT_THROW(write_contact_sheet(folder / "s.png", *source, decoded, options), Error);
    EXPECT_FALSE(std::filesystem::exists(folder / "s.png"));
  };
  ContactSheetOptions good;
  good.images = {1};
  fails(good, other.get());
  ContactSheetOptions bad = good;
  bad.images = {};
  fails(bad, nullptr);
  bad.images = {2};
  fails(bad, nullptr);
  bad.images.assign(10000, 0);
  fails(bad, nullptr);
  for (const double number : {-1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    bad = good;
    bad.exposure = number;
    fails(bad, nullptr);
    bad = good;
    bad.difference_scale = number;
    fails(bad, nullptr);
  }
}

TEST(SpreadImages, EachOnceAndWithinRange) {
  for (const BtfShape& shape : {BtfShape{81, 81, 1, 1, 1}, BtfShape{1, 12, 1, 1, 1},
                                BtfShape{9, 1, 1, 1, 1}, BtfShape{2, 2, 1, 1, 1}}) {
    for (const std::size_t count : {1U, 3U, 8U, 20U}) {
      const std::vector<std::size_t> images = spread_images(shape, count);
      EXPECT_EQ(images.size(), std::min(count, shape.images()));
      EXPECT_EQ(std::set<std::size_t>(images.begin(), images.end()).size(), images.size());
      for (const std::size_t image : images) EXPECT_LT(image, shape.images());
    }
  }
  // Both directions vary.
  std::set<std::size_t> views;
  std::set<std::size_t> lights;
  for (const std::size_t image : spread_images({81, 81, 1, 1, 1}, 8)) {
    views.insert(image / 81);
    lights.insert(image % 81);
  }
  EXPECT_EQ(views.size(), 8U);
  EXPECT_EQ(lights.size(), 8U);
}

}  // namespace
}  // namespace weft::test
