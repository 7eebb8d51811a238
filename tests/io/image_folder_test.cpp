#include "weft/io/image_folder.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <cstring>

#include "support/captures.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/image_files.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "weft/btf/encoding.hpp"
#include "weft/io/capture.hpp"
#include "weft/io/ubo2003.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;
using test::expect_error;
using test::make_info;
using test::random_source;
using test::read_all;
using test::TemporaryFolder;

std::size_t entries(const fs::path& folder) {
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

BtfInfo odd_info(const BtfShape& shape, DType dtype) {
  BtfInfo info = make_info(shape, dtype);
  // Directions that no short decimal angle stands for, and not quite of unit length.
  for (Direction& direction : info.view_directions) direction[2] *= 1.0002f;
  info.source = "made for a test";
  info.quantity = Quantity::brdf;
  info.mask.assign(shape.views * shape.texels(), 1);
  info.mask[3] = 0;
  return info;
}

void write_all(ImageFolderSink& sink, std::span<const std::byte> values, std::size_t tile) {
  const std::size_t images = sink.info().shape.images();
  const std::size_t bytes = sink.info().image_bytes();
  for (std::size_t first = 0; first < images; first += tile) {
    const std::size_t count = std::min(tile, images - first);
    sink.write(first, count, values.subspan(first * bytes, count * bytes));
  }
}

TEST(ImageFolder, ReadsBackExactlyByItsManifest) {
  const TemporaryFolder folder;
  const BtfShape shape{3, 4, 6, 5, 3};
  for (const ImageFormat format : {ImageFormat::exr, ImageFormat::png}) {
    for (const std::size_t threads : {1U, 3U}) {
      ImageFolderOptions options;
      options.format = format;
      options.threads = threads;
      const DType dtype = format == ImageFormat::exr ? DType::f16 : DType::u8;
      const auto data = random_source(shape, dtype, 5);
      const fs::path path = folder / fmt::format("out{}{}", static_cast<int>(format), threads);
      const BtfInfo info = odd_info(shape, dtype);
      ImageFolderSink sink(path, info, options);
      EXPECT_EQ(sink.info().dtype, dtype);
      write_all(sink, data->bytes(), 5);
      EXPECT_FALSE(fs::exists(path));
      sink.finish();
      EXPECT_GT(sink.busy_seconds(), 0);
      EXPECT_GT(sink.bytes_written(), 12 * 50u);
      EXPECT_EQ(sink.threads(), threads);

      const Capture capture = open_capture(path, {});
      EXPECT_EQ(capture.kind, "manifest");
      EXPECT_TRUE(capture.ignored.empty());
      const BtfInfo& back = capture.source->info();
      EXPECT_EQ(back.shape, shape);
      EXPECT_EQ(back.dtype, dtype);
      EXPECT_EQ(back.encoding, format == ImageFormat::exr ? Encoding::linear : Encoding::srgb);
      EXPECT_EQ(back.quantity, Quantity::brdf);
      EXPECT_EQ(back.view_directions, info.view_directions);
      EXPECT_EQ(back.light_directions, info.light_directions);
      EXPECT_EQ(back.mask, info.mask);
      EXPECT_EQ(back.source, info.source);
      EXPECT_EQ(read_all(*capture.source),
                std::vector<std::byte>(data->bytes().begin(), data->bytes().end()));
    }
  }
}

TEST(ImageFolder, NamesAloneBringTheDirectionsBack) {
  const TemporaryFolder folder;
  const BtfShape shape{4, 7, 2, 2, 1};
  const auto data = random_source(shape, DType::f16, 9);
  ImageFolderSink sink(folder / "out", make_info(shape, DType::f16), {});
  write_all(sink, data->bytes(), 28);
  sink.finish();
  fs::remove(folder / "out/manifest.json");
  const Capture capture = open_ubo2003(open_image_collection(folder / "out"));
  const BtfInfo& back = capture.source->info();
  ASSERT_EQ(back.shape, shape);
  // Spread directions go from the zenith down, which is their order by theta too.
  for (std::size_t l = 0; l < 7; ++l) {
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(back.light_directions[l][i], sink.info().light_directions[l][i], 0x1p-22f);
    }
  }
  EXPECT_EQ(read_all(*capture.source),
            std::vector<std::byte>(data->bytes().begin(), data->bytes().end()));
}

TEST(ImageFolder, PairsAndManyChannels) {
  const TemporaryFolder folder;
  const BtfShape shape{5, 1, 3, 2, 4};
  BtfInfo info = make_info(shape, DType::f32);
  info.layout = Layout::paired;
  info.light_directions = even_directions(5);
  std::reverse(info.light_directions.begin(), info.light_directions.end());
  info.channel_names = {"450", "550", "650", "750"};
  const auto data = random_source(shape, DType::f32, 3);
  ImageFolderOptions options;
  options.exr_dtype = DType::f32;
  options.compression = ExrCompression::none;
  ImageFolderSink sink(folder / "out", info, options);
  write_all(sink, data->bytes(), 2);
  sink.finish();
  const Capture capture = open_capture(folder / "out", {});
  const BtfInfo& back = capture.source->info();
  EXPECT_EQ(back.layout, Layout::paired);
  EXPECT_EQ(back.light_directions, info.light_directions);
  EXPECT_EQ(back.channel_names, info.channel_names);
  EXPECT_EQ(read_all(*capture.source),
            std::vector<std::byte>(data->bytes().begin(), data->bytes().end()));
}

TEST(ImageFolder, AnnouncesTheFormThatItTakes) {
  const TemporaryFolder folder;
  BtfInfo info = make_info({1, 1, 2, 2, 3}, DType::u8);
  info.encoding = Encoding::gamma22;
  ImageFolderOptions options;
  EXPECT_EQ(ImageFolderSink(folder / "a", info, options).info().encoding, Encoding::linear);
  EXPECT_EQ(ImageFolderSink(folder / "a", info, options).info().dtype, DType::f16);
  options.format = ImageFormat::png;
  EXPECT_EQ(ImageFolderSink(folder / "a", info, options).info().encoding, Encoding::gamma22);
  info.encoding = Encoding::linear;
  EXPECT_EQ(ImageFolderSink(folder / "a", info, options).info().encoding, Encoding::srgb);
  info.shape.channels = 2;
  expect_error(ErrorKind::input, {"PNG holds 1 or 3 channels, not 2"},
               [&] { ImageFolderSink(folder / "a", info, options); });
  EXPECT_EQ(entries(folder.path()), 0u);
}

TEST(ImageFolder, NothingIsLeftWithoutFinish) {
  const TemporaryFolder folder;
  const BtfShape shape{2, 3, 8, 8, 3};
  const auto data = random_source(shape, DType::f16, 1);
  {
    ImageFolderSink sink(folder / "out", make_info(shape, DType::f16), {});
    sink.write(0, 4, data->bytes().first(4 * sink.info().image_bytes()));
    EXPECT_THROW(sink.write(5, 1, data->bytes().first(sink.info().image_bytes())), Error);
    EXPECT_THROW(sink.finish(), Error);
  }
  EXPECT_EQ(entries(folder.path()), 0u);
}

TEST(ImageFolder, AFolderWithContentIsKeptUnlessReplaced) {
  const TemporaryFolder folder;
  const BtfShape shape{1, 1, 2, 2, 3};
  const BtfInfo info = make_info(shape, DType::f16);
  const auto data = random_source(shape, DType::f16, 1);
  test::write_text(folder / "out/notes.txt", "keep");
  expect_error(ErrorKind::input, {"out", "not empty"},
               [&] { ImageFolderSink(folder / "out", info, {}); });
  ImageFolderOptions options;
  options.replace = true;
  {
    ImageFolderSink sink(folder / "out", info, options);
    write_all(sink, data->bytes(), 1);
  }
  EXPECT_TRUE(fs::exists(folder / "out/notes.txt"));
  ImageFolderSink sink(folder / "out/", info, options);
  write_all(sink, data->bytes(), 1);
  sink.finish();
  EXPECT_FALSE(fs::exists(folder / "out/notes.txt"));
  EXPECT_TRUE(fs::exists(folder / "out/manifest.json"));
  EXPECT_EQ(entries(folder.path()), 1u);
  // An empty folder needs no permission.
  fs::create_directory(folder / "empty");
  ImageFolderSink second(folder / "empty", info, {});
  write_all(second, data->bytes(), 1);
  second.finish();
  EXPECT_TRUE(fs::exists(folder / "empty/manifest.json"));
  // A file is no folder; a missing parent can't hold one.
  test::write_text(folder / "file", "x");
  EXPECT_THROW(ImageFolderSink(folder / "file", info, {}), Error);
  EXPECT_THROW(ImageFolderSink(folder.path() / "absent" / "out", info, {}), Error);
}

TEST(ImageFolder, WhatFailsInAWritingThreadIsThrown) {
  // Files may not grow past 4 KiB for a while: the first image fails, whichever thread writes it.
  const TemporaryFolder folder;
  const BtfShape shape{4, 16, 64, 64, 3};
  const auto data = random_source(shape, DType::f16, 1);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  {
    ImageFolderSink sink(folder / "out", make_info(shape, DType::f16), {});
    rlimit limit = before;
    limit.rlim_cur = 4096;
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
    expect_error(ErrorKind::runtime, {"can't be written"}, [&] {
      write_all(sink, data->bytes(), 4);
      sink.finish();
    });
    setrlimit(RLIMIT_FSIZE, &before);
  }
  std::signal(SIGXFSZ, handler);
  EXPECT_EQ(entries(folder.path()), 0u);
}

}  // namespace
}  // namespace weft
