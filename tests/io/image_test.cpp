#include "weft/io/image.hpp"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfOutputFile.h>
#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <cstring>
#include <numeric>
#include <random>

#include "support/image_files.hpp"
#include "support/largest_allocation.hpp"
#include "support/temporary_folder.hpp"
#include "weft/error.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

using test::file_bytes;
using test::make_jpeg;
using test::smooth_image;
using test::TemporaryFolder;
using test::write_bytes;

std::vector<std::byte> decode(std::span<const std::byte> file, const std::string& name) {
  const ImageInfo info = image_info(file, name);
  std::vector<std::byte> values(info.bytes());
  read_image(file, name, info, values);
  return values;
}

// The message of the input error that decoding the file throws; empty if it throws none.
std::string error_of(std::span<const std::byte> file) {
  try {
    decode(file, "folder/odd.img");
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input) << error.what();
    return error.what();
  }
  return "";
}

// Also checks that nothing was allocated in proportion to what the file claims.
void expect_input_error(std::span<const std::byte> file, const std::string& part) {
  test::reset_largest_allocation();
  const std::string message = error_of(file);
  EXPECT_LT(test::largest_allocation(), std::size_t{1} << 20);
  EXPECT_NE(message.find("folder/odd.img"), std::string::npos) << message;
  EXPECT_NE(message.find(part), std::string::npos) << message;
}

void store(std::vector<std::byte>& file, std::size_t offset, std::vector<unsigned> values) {
  for (const unsigned value : values) file.at(offset++) = static_cast<std::byte>(value);
}

std::vector<std::byte> random_bytes(std::size_t count, unsigned seed) {
  std::mt19937 generator(seed);
  std::vector<std::byte> bytes(count);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(generator() & 0xff);
  return bytes;
}

TEST(Image, NamesOfImagesAreToldByTheirEndings) {
  EXPECT_TRUE(is_image_name("a.png"));
  EXPECT_TRUE(is_image_name("x/00008 tl000 pl000 tv030 pv030.JPG"));
  EXPECT_TRUE(is_image_name("a.jpeg"));
  EXPECT_TRUE(is_image_name("a.ExR"));
  EXPECT_FALSE(is_image_name(".png"));
  EXPECT_FALSE(is_image_name("a.txt"));
  EXPECT_FALSE(is_image_name("png"));
  EXPECT_FALSE(is_image_name(""));
}

TEST(Png, RoundTripIsExactForGreyAndColour) {
  const TemporaryFolder folder;
  for (const std::size_t channels : {1U, 3U}) {
    for (const auto& [height, width] :
         std::vector<std::pair<std::size_t, std::size_t>>{{1, 1}, {7, 5}, {64, 33}}) {
      const ImageInfo info{height, width, channels, DType::u8};
      const std::vector<std::byte> values = random_bytes(info.bytes(), 7);
      write_png(folder / "a.png", info, values);
      EXPECT_EQ(image_info(folder / "a.png"), info);
      std::vector<std::byte> back(info.bytes());
      read_image(folder / "a.png", info, back);
      EXPECT_EQ(back, values);
    }
  }
}

// A PNG as libpng writes it for any colour type and depth, rows as given.
std::vector<std::byte> make_png(std::size_t width, std::size_t height, int depth, int colour_type,
                                std::vector<std::vector<unsigned char>> rows,
                                bool interlaced = false) {
  std::vector<std::byte> file;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_set_write_fn(
      png, &file,
      [](png_structp p, png_bytep from, png_size_t count) {
        auto* to = static_cast<std::vector<std::byte>*>(png_get_io_ptr(p));
        const auto* first = reinterpret_cast<const std::byte*>(from);
        to->insert(to->end(), first, first + count);
      },
      [](png_structp) {});
  png_set_IHDR(png, info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), depth,
               colour_type, interlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE, 0, 0);
  const png_color palette[2] = {{10, 20, 30}, {40, 50, 60}};
  if (colour_type == PNG_COLOR_TYPE_PALETTE) png_set_PLTE(png, info, palette, 2);
  png_write_info(png, info);
  std::vector<png_bytep> pointers;
  for (auto& row : rows) pointers.push_back(row.data());
  png_write_image(png, pointers.data());
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  return file;
}

std::vector<std::byte> bytes_of(std::vector<unsigned> values) {
  std::vector<std::byte> bytes(values.size());
  store(bytes, 0, std::move(values));
  return bytes;
}

TEST(Png, AlphaIsDroppedPalettesAndShortDepthsAreExpanded) {
  EXPECT_EQ(decode(make_png(2, 1, 8, PNG_COLOR_TYPE_RGB_ALPHA, {{1, 2, 3, 99, 4, 5, 6, 0}}), "a"),
            bytes_of({1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(decode(make_png(2, 1, 8, PNG_COLOR_TYPE_GRAY_ALPHA, {{7, 1, 8, 2}}), "a"),
            bytes_of({7, 8}));
  EXPECT_EQ(decode(make_png(3, 1, 1, PNG_COLOR_TYPE_PALETTE, {{0b01000000}}), "a"),
            bytes_of({10, 20, 30, 40, 50, 60, 10, 20, 30}));
  EXPECT_EQ(decode(make_png(2, 1, 4, PNG_COLOR_TYPE_GRAY, {{0x0f}}), "a"), bytes_of({0, 255}));
}

TEST(Png, InterlacedRowsComeOutInOrder) {
  std::vector<std::vector<unsigned char>> rows(9, std::vector<unsigned char>(11));
  std::vector<unsigned> expected;
  for (std::size_t y = 0; y < 9; ++y) {
    for (std::size_t x = 0; x < 11; ++x) {
      rows[y][x] = static_cast<unsigned char>(17 * y + x);
      expected.push_back(rows[y][x]);
    }
  }
  EXPECT_EQ(decode(make_png(11, 9, 8, PNG_COLOR_TYPE_GRAY, rows, true), "a"), bytes_of(expected));
}

TEST(Png, SixteenBitsAreRefusedByName) {
  expect_input_error(make_png(1, 1, 16, PNG_COLOR_TYPE_GRAY, {{1, 2}}), "16 bits");
}

TEST(Png, EveryTruncationIsAnInputError) {
  const TemporaryFolder folder;
  const ImageInfo info{16, 16, 3, DType::u8};
  write_png(folder / "a.png", info, random_bytes(info.bytes(), 3));
  const std::vector<std::byte> file = file_bytes(folder / "a.png");
  for (std::size_t length = 0; length < file.size(); ++length) {
    EXPECT_NE(error_of(std::span(file).first(length)), "") << length;
  }
}

TEST(Png, DamageIsFoundByTheChecksums) {
  const TemporaryFolder folder;
  const ImageInfo info{16, 16, 3, DType::u8};
  write_png(folder / "a.png", info, random_bytes(info.bytes(), 3));
  const std::vector<std::byte> file = file_bytes(folder / "a.png");
  for (std::size_t i = 8; i < file.size(); i += 5) {
    std::vector<std::byte> damaged = file;
    damaged[i] ^= std::byte{0x41};
    EXPECT_NE(error_of(damaged), "") << i;
  }
}

TEST(Png, LyingSizesAreRefusedBeforeAnythingIsAllocated) {
  const TemporaryFolder folder;
  const ImageInfo info{2, 2, 3, DType::u8};
  write_png(folder / "a.png", info, random_bytes(info.bytes(), 3));
  std::vector<std::byte> file = file_bytes(folder / "a.png");
  store(file, 16, {0, 0, 0x80, 0, 0, 0, 0x80, 0});  // 32768 x 32768
  expect_input_error(file, "32768 x 32768");
  store(file, 16, {0, 2, 0, 0, 0, 0, 0, 1});
  expect_input_error(file, "131072 x 1");
  store(file, 16, {0, 0, 0, 0, 0, 0, 0, 1});
  expect_input_error(file, "0 x 1");
  store(file, 16, {0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff});
  expect_input_error(file, "size");
}

TEST(Jpeg, DecodesWithinTheQuantisation) {
  for (const std::size_t channels : {1U, 3U}) {
    for (const bool progressive : {false, true}) {
      const ImageInfo info{24, 17, channels, DType::u8};
      const std::vector<std::byte> values = smooth_image(info, 5);
      const std::vector<std::byte> file = make_jpeg(info, values, 100, progressive);
      ASSERT_EQ(image_info(file, "a"), info);
      const std::vector<std::byte> back = decode(file, "a");
      for (std::size_t i = 0; i < values.size(); ++i) {
        // At quality 100 the coefficients are rounded to integers: 64 of them, each off by at most
        // half times a basis value of at most 1/4, plus the roundings of the colour transform.
        EXPECT_NEAR(std::to_integer<int>(back[i]), std::to_integer<int>(values[i]), 10);
      }
    }
  }
}

TEST(Jpeg, EveryTruncationIsAnInputError) {
  const ImageInfo info{24, 24, 3, DType::u8};
  for (const bool progressive : {false, true}) {
    const std::vector<std::byte> file = make_jpeg(info, smooth_image(info, 1), 90, progressive);
    for (std::size_t length = 0; length + 2 < file.size(); ++length) {
      EXPECT_NE(error_of(std::span(file).first(length)), "") << length;
    }
  }
}

TEST(Jpeg, DamageNeverEscapesAsAnythingButAnInputError) {
  const ImageInfo info{40, 24, 3, DType::u8};
  const std::vector<std::byte> file = make_jpeg(info, smooth_image(info, 1), 90);
  std::mt19937 generator(11);
  std::size_t found = 0;
  for (int trial = 0; trial < 400; ++trial) {
    std::vector<std::byte> damaged = file;
    for (int i = 0; i < 3; ++i) {
      damaged[3 + generator() % (damaged.size() - 3)] = static_cast<std::byte>(generator() & 0xff);
    }
    found += !error_of(damaged).empty();
  }
  EXPECT_GT(found, 100u);  // the format has no checksum: the rest decodes to something
}

TEST(Jpeg, LyingSizesAreRefused) {
  const ImageInfo info{8, 8, 1, DType::u8};
  std::vector<std::byte> file = make_jpeg(info, smooth_image(info, 1));
  // The frame header: marker, length, precision, height, width.
  std::size_t frame = 0;
  while (file[frame] != std::byte{0xff} || file[frame + 1] != std::byte{0xc0}) ++frame;
  store(file, frame + 5, {0xff, 0x00, 0xff, 0x00});
  expect_input_error(file, "65280 x 65280");
}

TEST(Exr, RoundTripIsExactForEveryTypeCompressionAndChannelCount) {
  const TemporaryFolder folder;
  std::mt19937 generator(5);
  std::normal_distribution<float> normal(0.0f, 10.0f);
  for (const DType dtype : {DType::f16, DType::f32}) {
    for (const std::size_t channels : {1U, 2U, 3U, 5U}) {
      for (const auto compression :
           {ExrCompression::none, ExrCompression::zip, ExrCompression::piz}) {
        const ImageInfo info{37, 41, channels, dtype};
        std::vector<std::byte> values(info.bytes());
        for (std::size_t i = 0; i < info.height * info.width * channels; ++i) {
          const float value = normal(generator);
          const std::uint16_t half = float_to_half(value);
          if (dtype == DType::f16) {
            std::memcpy(values.data() + 2 * i, &half, 2);
          } else {
            std::memcpy(values.data() + 4 * i, &value, 4);
          }
        }
        write_exr(folder / "a.exr", info, values, compression);
        ASSERT_EQ(image_info(folder / "a.exr"), info);
        EXPECT_EQ(decode(file_bytes(folder / "a.exr"), "a"), values);
      }
    }
  }
}

// A float EXR with the given channels, each filled with its place in the list.
std::vector<std::byte> make_exr(const std::vector<std::string>& channels, int sampling = 1,
                                Imf::PixelType type = Imf::FLOAT) {
  const TemporaryFolder folder;
  constexpr int side = 4;
  Imf::Header header(side, side);
  std::vector<std::vector<float>> values;
  std::vector<std::vector<unsigned>> integers(channels.size(),
                                              std::vector<unsigned>(side * side, 1));
  Imf::FrameBuffer frame;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    values.emplace_back(side * side, static_cast<float>(c));
  }
  for (std::size_t c = 0; c < channels.size(); ++c) {
    header.channels().insert(channels[c].c_str(), Imf::Channel(type, sampling, sampling));
    char* base = type == Imf::UINT ? reinterpret_cast<char*>(integers[c].data())
                                   : reinterpret_cast<char*>(values[c].data());
    frame.insert(channels[c].c_str(), Imf::Slice(type, base, 4, 4 * side, sampling, sampling));
  }
  const std::filesystem::path path = folder / "a.exr";
  {
    Imf::OutputFile file(path.c_str(), header, 0);
    file.setFrameBuffer(frame);
    file.writePixels(side);
  }
  return file_bytes(path);
}

std::vector<float> first_pixel(const std::vector<std::byte>& file) {
  const ImageInfo info = image_info(file, "a");
  const std::vector<std::byte> values = decode(file, "a");
  std::vector<float> pixel(info.channels);
  std::memcpy(pixel.data(), values.data(), pixel.size() * sizeof(float));
  return pixel;
}

TEST(Exr, ChannelsAreFoundByName) {
  EXPECT_EQ(first_pixel(make_exr({"A", "B", "G", "R", "Z"})), (std::vector<float>{3, 2, 1}));
  EXPECT_EQ(first_pixel(make_exr({"A", "Y"})), (std::vector<float>{1}));
  EXPECT_EQ(first_pixel(make_exr({"light.B", "light.G", "light.R"})),
            (std::vector<float>{2, 1, 0}));
  EXPECT_EQ(first_pixel(make_exr({"depth.Z", "light.Y"})), (std::vector<float>{1}));
  EXPECT_EQ(first_pixel(make_exr({"B", "G", "R", "light.B", "light.G", "light.R"})),
            (std::vector<float>{2, 1, 0}));
}

TEST(Exr, WhatIsNoSingleImageIsRefusedByName) {
  expect_input_error(make_exr({"Z"}), "no channels R, G, B or Y among: Z");
  expect_input_error(make_exr({"a.Y", "b.Y"}), "several layers");
  expect_input_error(make_exr({"X", "Y", "Z"}), "XYZ");
  expect_input_error(make_exr({"Y", "RY", "BY"}), "luminance-chroma");
  expect_input_error(make_exr({"Y"}, 2), "subsampled by 2 x 2");
  expect_input_error(make_exr({"Y"}, 1, Imf::UINT), "integers");
}

TEST(Exr, EveryTruncationIsAnInputError) {
  const std::vector<std::byte> file = make_exr({"R", "G", "B"});
  for (std::size_t length = 0; length < file.size(); ++length) {
    EXPECT_NE(error_of(std::span(file).first(length)), "") << length;
  }
}

TEST(Exr, DamageNeverEscapesAsAnythingButAnInputError) {
  const std::vector<std::byte> file = make_exr({"R", "G", "B"});
  std::mt19937 generator(13);
  std::size_t found = 0;
  for (std::size_t i = 4; i < file.size(); ++i) {
    std::vector<std::byte> damaged = file;
    damaged[i] = static_cast<std::byte>(generator() & 0xff);
    found += !error_of(damaged).empty();
  }
  EXPECT_GT(found, 50u);
}

TEST(Exr, LyingWindowsAndAttributesAreRefused) {
  std::vector<std::byte> file = make_exr({"Y"});
  const auto find = [&](const std::string& text) {
    const auto bytes = std::as_bytes(std::span(text));
    return static_cast<std::size_t>(
        std::search(file.begin(), file.end(), bytes.begin(), bytes.end()) - file.begin());
  };
  // name, 0, type, 0, size: then the window's corners.
  const std::size_t window = find("dataWindow") + 11 + 6;
  std::vector<std::byte> wide = file;
  store(wide, window + 4 + 8, {0xff, 0xff, 0xff, 0x3f});
  expect_input_error(wide, "1073741824 x 4");
  std::vector<std::byte> large = file;
  store(large, window + 4 + 8, {0xff, 0xff, 0, 0, 0xff, 0xff, 0, 0});
  expect_input_error(large, "65536 x 65536");
  std::vector<std::byte> empty = file;
  store(empty, window + 4 + 8, {0xff, 0xff, 0xff, 0xff});
  expect_input_error(empty, "data window");
  std::vector<std::byte> attribute = file;
  store(attribute, find("compression") + 12 + 12, {0xff, 0xff, 0xff, 0x7f});
  expect_input_error(attribute, "attribute 'compression' claims 2147483647 bytes");
}

TEST(Image, ContentDecidesNotTheName) {
  const TemporaryFolder folder;
  const ImageInfo info{4, 4, 3, DType::u8};
  write_png(folder / "a.jpg", info, smooth_image(info, 1));
  EXPECT_EQ(image_info(folder / "a.jpg"), info);
  write_bytes(folder / "b.png", bytes_of({1, 2, 3, 4, 5, 6, 7, 8, 9}));
  try {
    image_info(folder / "b.png");
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("b.png"), std::string::npos);
  }
}

TEST(Image, AnotherSizeThanAnnouncedIsAnErrorThatNamesBoth) {
  const ImageInfo info{8, 8, 3, DType::u8};
  const std::vector<std::byte> file = make_jpeg(info, smooth_image(info, 1));
  ImageInfo expected = info;
  expected.width = 9;
  std::vector<std::byte> out(expected.bytes());
  try {
    read_image(file, "x.jpg", expected, out);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    EXPECT_STREQ(error.what(),
                 "x.jpg: 8 x 8 with 3 channels of U8 where 9 x 8 with 3 channels of U8 was "
                 "expected");
  }
}

TEST(Image, WritingWhereNothingCanBeWrittenIsARuntimeError) {
  const TemporaryFolder folder;
  const ImageInfo info{2, 2, 3, DType::u8};
  const std::vector<std::byte> values(info.bytes());
  try {
    write_png(folder.path() / "missing" / "a.png", info, values);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::runtime);
    EXPECT_NE(std::string(error.what()).find("missing/a.png"), std::string::npos);
  }
  EXPECT_THROW(write_png("/dev/full", info, values), Error);
  EXPECT_THROW(write_exr(folder / "a.exr", info, values, ExrCompression::none), Error);
  EXPECT_THROW(write_png(folder / "a.png", info, std::span(values).first(3)), Error);
}

TEST(Image, CompressionNames) {
  EXPECT_EQ(exr_compression_from_name("none", "--compression"), ExrCompression::none);
  EXPECT_EQ(exr_compression_from_name("zip", "--compression"), ExrCompression::zip);
  EXPECT_EQ(exr_compression_from_name("piz", "--compression"), ExrCompression::piz);
  EXPECT_THROW(exr_compression_from_name("zap", "--compression"), Error);
}

}  // namespace
}  // namespace weft
