// Tone mapping and comparison of pictures, against values worked out by hand, and as files.
#include "weft/scene/picture.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <span>
#include <vector>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "weft/btf/encoding.hpp"
#include "weft/io/image.hpp"
#include "weft/io/picture_file.hpp"
#include "weft/metrics/ssim.hpp"

namespace weft::test {
namespace {

// Of values [height][width][3], all covered.
Picture picture_of(std::size_t width, std::size_t height, std::span<const float> rgb) {
  Picture picture{width, height, {}};
  for (std::size_t i = 0; i < rgb.size(); i += 3) {
    picture.pixels.push_back({rgb[i], rgb[i + 1], rgb[i + 2], 1.0f});
  }
  return picture;
}

std::vector<float> rgb_of(const Picture& picture) {
  std::vector<float> values;
  for (const auto& pixel : picture.pixels) values.insert(values.end(), &pixel[0], &pixel[0] + 3);
  return values;
}

Picture random_picture(std::size_t width, std::size_t height, std::uint64_t seed) {
  return picture_of(width, height, random_floats(width * height * 3, seed));
}

TEST(Picture, IsExposedInStopsAndEncodedAsSrgb) {
  const Picture picture =
      picture_of(2, 1, std::vector<float>{0.0f, 0.001f, 0.05f, 0.25f, 0.6f, -1.0f});
  const std::vector<double> shown = display_values(picture, {1.0, ToneCurve::linear});
  ASSERT_EQ(shown.size(), 6u);
  EXPECT_EQ(shown[0], 0.0);
  EXPECT_NEAR(shown[1], 0.002 * 12.92, 1e-8);
  EXPECT_NEAR(shown[2], 1.055 * std::pow(0.1, 1 / 2.4) - 0.055, 1e-8);
  EXPECT_NEAR(shown[3], 1.055 * std::pow(0.5, 1 / 2.4) - 0.055, 1e-8);
  EXPECT_EQ(shown[4], 1.0);
  EXPECT_EQ(shown[5], 0.0);
}

// L' = L (1 + L / 16) / (1 + L): 1 of 4, half of it below; hue is kept.
TEST(Picture, ReinhardShowsTheWhitePointAsWhite) {
  const Picture picture =
      picture_of(3, 1, std::vector<float>{4, 4, 4, 1, 1, 1, 0.5f, 0.25f, 0.125f});
  const std::vector<double> shown = display_values(picture, {0.0, ToneCurve::reinhard});
  EXPECT_NEAR(shown[0], 1.0, 1e-12);
  EXPECT_NEAR(decode_to_linear(Encoding::srgb, shown[3]), (1 + 1 / 16.0) / 2, 1e-12);
  const double luminance = 0.2126 * 0.5 + 0.7152 * 0.25 + 0.0722 * 0.125;
  const double factor = (1 + luminance / 16) / (1 + luminance);
  EXPECT_NEAR(decode_to_linear(Encoding::srgb, shown[6]), 0.5 * factor, 1e-12);
  EXPECT_NEAR(decode_to_linear(Encoding::srgb, shown[8]), 0.125 * factor, 1e-12);
}

TEST(Picture, WhatIsNoLightIsDefined) {
  constexpr float inf = std::numeric_limits<float>::infinity();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const ToneCurve curve : {ToneCurve::linear, ToneCurve::reinhard}) {
    const std::vector<double> shown = display_values(
        picture_of(3, 1, std::vector<float>{nan, nan, nan, inf, inf, inf, 0, 0, 0}), {0.0, curve});
    EXPECT_EQ(shown[0], 0.0);
    EXPECT_EQ(shown[3], 1.0);
    EXPECT_EQ(shown[6], 0.0);
  }
}

TEST(Picture, WithItselfIsExact) {
  const Picture picture = random_picture(12, 11, 1);
  const PictureComparison same = compare_pictures(picture, picture, {});
  EXPECT_EQ(same.display.psnr, std::numeric_limits<double>::infinity());
  EXPECT_NEAR(*same.display.ssim, 1.0, 1e-14);
  EXPECT_EQ(same.linear.rmse, 0.0);
  for (const double value : difference_values(picture, picture, {}, 4)) EXPECT_EQ(value, 0.0);
}

TEST(Picture, ErrorsAreThoseOfTheDisplayAndOfLight) {
  Picture original = picture_of(11, 11, std::vector<float>(11 * 11 * 3, 0.5f));
  original.pixels[2][1] = 2.0f;
  Picture picture = original;
  picture.pixels[2][1] = 1.5f;  // both are shown as white
  picture.pixels[2][2] = 0.25f;
  const PictureComparison found = compare_pictures(picture, original, {});
  const double step =
      encode_from_linear(Encoding::srgb, 0.5) - encode_from_linear(Encoding::srgb, 0.25);
  EXPECT_EQ(found.display.peak, 1.0);
  EXPECT_NEAR(found.display.rmse, step / std::sqrt(363.0), 1e-12);
  EXPECT_NEAR(found.display.psnr, 20 * std::log10(std::sqrt(363.0) / step), 1e-9);
  EXPECT_EQ(found.linear.peak, 2.0);
  EXPECT_NEAR(found.linear.rmse, std::sqrt((0.25 + 0.0625) / 363), 1e-12);
  EXPECT_NEAR(*found.display.ssim,
              ssim(11, 11, 3, display_values(original, {}), display_values(picture, {}), 1.0),
              1e-14);
  const std::vector<double> difference = difference_values(picture, original, {}, 2);
  EXPECT_NEAR(difference[8], 2 * step, 1e-12);
  EXPECT_EQ(difference[7], 0.0);
  EXPECT_EQ(difference_values(picture, original, {}, 100)[8], 1.0);
}

TEST(Picture, SizesMustFit) {
  expect_error(ErrorKind::input, {"12 x 11", "11 x 12"},
               [] { compare_pictures(random_picture(12, 11, 1), random_picture(11, 12, 1), {}); });
  expect_error(ErrorKind::input, {"tone", "filmy"},
               [] { tone_curve_from_name("filmy", "--tone"); });
}

TEST(PictureFile, HoldsLightAsExrAndTheDisplayAsPng) {
  const TemporaryFolder folder;
  const Picture picture = random_picture(7, 5, 2);
  const std::filesystem::path exr = folder / "a.exr", png = folder / "a.png";
  write_picture(exr, picture, {3.0, ToneCurve::reinhard});
  std::vector<float> light(5 * 7 * 3);
  read_image(exr, {5, 7, 3, DType::f32}, std::as_writable_bytes(std::span(light)));
  EXPECT_TRUE(all_equal(light, rgb_of(picture)));
  write_picture(png, picture, {-1.0, ToneCurve::linear});
  std::vector<unsigned char> bytes(5 * 7 * 3);
  read_image(png, {5, 7, 3, DType::u8}, std::as_writable_bytes(std::span(bytes)));
  const std::vector<double> shown = display_values(picture, {-1.0, ToneCurve::linear});
  for (std::size_t i = 0; i < bytes.size(); ++i) EXPECT_EQ(bytes[i], nearest_byte(shown[i]));
}

TEST(PictureFile, IsNamedByItsEndingAndWrittenWholeOrNotAtAll) {
  const TemporaryFolder folder;
  expect_error(ErrorKind::input, {"--output", "a.jpg"},
               [] { picture_format("a.jpg", "--output"); });
  expect_error(ErrorKind::input, {"missing"}, [&] {
    write_picture(std::filesystem::path(folder / "missing") / "a.png", random_picture(2, 2, 1), {});
  });
}

}  // namespace
}  // namespace weft::test
