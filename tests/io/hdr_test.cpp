// Radiance pictures: the three ways to store a line, the header's fields, and damaged files.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/mutate.hpp"
#include "weft/io/image.hpp"

namespace weft::test {
namespace {

using Pixel = std::array<std::uint8_t, 4>;

std::string header(std::size_t width, std::size_t height, const std::string& fields = "") {
  return "#?RADIANCE\n# a comment\nFORMAT=32-bit_rle_rgbe\n" + fields + "\n-Y " +
         std::to_string(height) + " +X " + std::to_string(width) + "\n";
}

std::string bytes(std::initializer_list<int> values) {
  std::string text;
  for (const int value : values) text += static_cast<char>(value);
  return text;
}

std::string flat(const std::vector<Pixel>& pixels) {
  std::string text;
  for (const Pixel& p : pixels) text += bytes({p[0], p[1], p[2], p[3]});
  return text;
}

// A line in the new encoding: runs of equal bytes where there are three or more.
std::string encode_line(const std::vector<Pixel>& line) {
  const auto width = static_cast<int>(line.size());
  std::string text = bytes({2, 2, width >> 8, width & 255});
  for (std::size_t k = 0; k < 4; ++k) {
    for (std::size_t x = 0; x < line.size();) {
      std::size_t run = 1;
      while (x + run < line.size() && run < 127 && line[x + run][k] == line[x][k]) ++run;
      text += run > 2 ? bytes({static_cast<int>(128 + run), line[x][k]}) : bytes({1, line[x][k]});
      x += run > 2 ? run : 1;
    }
  }
  return text;
}

std::vector<float> read(const std::string& file) {
  const auto data = std::as_bytes(std::span(file));
  const ImageInfo info = image_info(data, "file.hdr");
  EXPECT_EQ(info.channels, 3u);
  EXPECT_EQ(info.dtype, DType::f32);
  std::vector<float> values(3 * info.width * info.height);
  read_image(data, "file.hdr", info, std::as_writable_bytes(std::span(values)));
  return values;
}

std::vector<Pixel> random_pixels(std::size_t count, std::uint64_t seed) {
  Random random(seed);
  std::vector<Pixel> pixels;
  while (pixels.size() < count) {
    Pixel p;
    for (std::uint8_t& b : p) b = static_cast<std::uint8_t>(random.index(256));
    p[2] = static_cast<std::uint8_t>(p[2] | 128);  // no marker of a run
    for (std::size_t i = random.index(20) + 1; i > 0 && pixels.size() < count; --i) {
      pixels.push_back(p);
    }
  }
  return pixels;
}

std::vector<float> expected_values(const std::vector<Pixel>& pixels) {
  std::vector<float> values;
  for (const Pixel& p : pixels) {
    for (std::size_t c = 0; c < 3; ++c) {
      values.push_back(p[3] == 0 ? 0.0f
                                 : static_cast<float>(std::ldexp(p[c] + 0.5, int{p[3]} - 136)));
    }
  }
  return values;
}

TEST(Hdr, ReadsAllEncodingsOfLines) {
  for (const std::size_t width : {1u, 7u, 8u, 9u, 127u, 128u, 300u}) {
    const std::vector<Pixel> pixels = random_pixels(3 * width, width);
    const std::vector<float> expected = expected_values(pixels);
    EXPECT_EQ(read(header(width, 3) + flat(pixels)), expected) << width;
    if (width < 8) continue;
    std::string file = header(width, 3);
    for (std::size_t row = 0; row < 3; ++row) {
      const auto begin = pixels.begin() + static_cast<std::ptrdiff_t>(row * width);
      file += encode_line({begin, begin + static_cast<std::ptrdiff_t>(width)});
    }
    EXPECT_EQ(read(file), expected) << width;
  }
}

TEST(Hdr, ReadsOldRuns) {
  // 5 pixels of one kind and 300 of another, the runs counted in two digits of base 256.
  const std::string file = header(305, 1) + bytes({10, 20, 200, 128, 1, 1, 1, 4}) +
                           bytes({30, 40, 250, 130, 1, 1, 1, 43, 1, 1, 1, 1});
  std::vector<Pixel> pixels(5, Pixel{10, 20, 200, 128});
  pixels.insert(pixels.end(), 300, Pixel{30, 40, 250, 130});
  EXPECT_EQ(read(file), expected_values(pixels));
}

TEST(Hdr, HonoursTheHeader) {
  const std::vector<Pixel> pixels{{10, 20, 200, 130}, {50, 60, 210, 131}};
  const std::vector<float> plain = expected_values(pixels);
  const std::vector<float> exposed = read(
      header(2, 1, "EXPOSURE=2.0\nSOFTWARE=x=y\nEXPOSURE= 4\nCOLORCORR=1 0.5 2\n") + flat(pixels));
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_FLOAT_EQ(exposed[i], plain[i] / 8 / (i % 3 == 1 ? 0.5f : i % 3 == 2 ? 2.0f : 1.0f));
  }
  const auto turned = [&](const std::string& size) {
    return read("#?RGBE\r\n\r\n" + size + "\n" + flat(pixels));
  };
  EXPECT_EQ(turned("-Y 1 +X 2"), plain);
  EXPECT_EQ(turned("-Y 2 +X 1"), plain);
  const std::vector<float> swapped{plain[3], plain[4], plain[5], plain[0], plain[1], plain[2]};
  EXPECT_EQ(turned("+Y 2 +X 1"), swapped);
  EXPECT_EQ(turned("-Y 1 -X 2"), swapped);
}

TEST(Hdr, NamesWhatIsWrong) {
  const auto refused = [](const std::string& file, std::initializer_list<std::string_view> parts) {
    expect_error(ErrorKind::input, parts, [&] { read(file); });
  };
  const std::string pixels(64, '\xc8');
  refused("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n" + pixels, {"file.hdr", "xyze"});
  refused(header(1, 1, "GAMMA=2.2\n") + pixels, {"file.hdr", "GAMMA=2.2"});
  refused(header(1, 1, "EXPOSURE=-1\n") + pixels, {"EXPOSURE", "-1"});
  refused(header(1, 1, "EXPOSURE=0\n") + pixels, {"EXPOSURE", "0"});
  refused(header(1, 1, "EXPOSURE=nan\n") + pixels, {"EXPOSURE", "nan"});
  refused(header(1, 1, "COLORCORR=1 1\n") + pixels, {"COLORCORR"});
  refused("#?RADIANCE\n\n+X 2 -Y 2\n" + pixels, {"+X 2 -Y 2"});
  refused("#?RADIANCE\n\n-Y 2 +X 2 2\n" + pixels, {"-Y 2 +X 2 2"});
  refused("#?RADIANCE\n\n-Y 99999999999999999999 +X 2\n" + pixels, {"9999"});
  refused(header(0, 1), {"0 x 1"});
  refused(header(65536, 65536) + pixels, {"65536 x 65536"});
  refused(header(4000, 4000) + pixels, {"4000 x 4000"});
  refused(header(4, 4) + pixels.substr(1), {"ends at byte"});
  refused("#?RADIANCE\nFORMAT", {"ends at byte"});
  refused("#?RADIANCE\n" + std::string(9000, 'x'), {"endless line"});
  std::string many;
  for (int i = 0; i < 2000; ++i) many += "A=B\n";
  refused("#?RADIANCE\n" + many + "\n-Y 1 +X 1\n" + pixels, {"endless header"});
  refused(header(8, 1) + bytes({2, 2, 0, 9}) + pixels, {"9 pixels where 8"});
  refused(header(8, 1) + bytes({2, 2, 0, 8, 137, 5}) + pixels, {"run of 9"});
  refused(header(8, 1) + bytes({2, 2, 0, 8, 0}) + pixels, {"run of 0"});
  refused(header(4, 1) + bytes({1, 1, 1, 2}) + pixels, {"run of 2 at column 0"});
  refused(header(4, 1) + bytes({9, 9, 9, 9, 1, 1, 1, 4}) + pixels, {"run of 4"});
  // 1e-30 below the exposure of 1e-30 is more than a float holds.
  refused(header(1, 1, "EXPOSURE=1e-30\n") + bytes({200, 200, 200, 255}), {"pixel (0, 0)"});
}

TEST(Hdr, SurvivesDamage) {
  const std::vector<Pixel> pixels = random_pixels(40, 7);
  const std::string file = header(20, 2, "EXPOSURE=1.5\n") +
                           encode_line({pixels.begin(), pixels.begin() + 20}) +
                           encode_line({pixels.begin() + 20, pixels.end()});
  ASSERT_EQ(read(file), [&] {
    std::vector<float> values;
    for (const Pixel& p : pixels) {
      for (std::size_t c = 0; c < 3; ++c) {
        values.push_back(
            p[3] == 0 ? 0.0f : static_cast<float>(std::ldexp(p[c] + 0.5, int{p[3]} - 136) / 1.5));
      }
    }
    return values;
  }());
  Random random(8);
  for (int i = 0; i < 3000; ++i) {
    const std::string damaged = mutate(file, file.size(), random);
    try {
      for (const float value : read(damaged)) {
        ASSERT_TRUE(std::isfinite(value) && value >= 0);
      }
    } catch (const Error& error) {
      ASSERT_EQ(error.kind(), ErrorKind::input) << error.what();
    }
  }
}

}  // namespace
}  // namespace weft::test
