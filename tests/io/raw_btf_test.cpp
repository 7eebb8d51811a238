// Raw BTFs written and read back, in both forms, and files of others that say less than ours.
#include "weft/io/raw_btf.hpp"

#include <gtest/gtest.h>

#include <cstring>

#include "io/file_bytes.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/temporary_folder.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/safetensors.hpp"

namespace weft {
namespace {

using test::expect_error;
using test::make_info;
using test::TemporaryFolder;

// A BtfInfo in which nothing has its default.
BtfInfo full_info(DType dtype) {
  BtfInfo info = make_info({2, 3, 4, 5, 3}, dtype);
  info.encoding = Encoding::gamma22;
  info.quantity = Quantity::brdf;
  info.channel_names = {"R", "G\"", "B\xc3\xbc"};
  info.source = "a \"capture\"\nof 2024";
  info.mask.assign(info.shape.views * info.shape.texels(), 1);
  info.mask.front() = 0;
  info.mask[7] = 0;
  info.mask_distance.assign(info.mask.size(), 0.25f);
  info.mask_distance.back() = -1;
  return info;
}

std::vector<std::byte> some_bytes(std::size_t count, std::uint64_t seed) {
  test::Random random(seed);
  std::vector<std::byte> bytes(count);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(random.index(256));
  return bytes;
}

void write_all(TileSink& sink, std::span<const std::byte> bytes, std::size_t images_per_tile) {
  const BtfInfo& info = sink.info();
  for (std::size_t first = 0; first < info.shape.images(); first += images_per_tile) {
    const std::size_t count = std::min(images_per_tile, info.shape.images() - first);
    sink.write(first, count, bytes.subspan(first * info.image_bytes(), count * info.image_bytes()));
  }
  sink.finish();
}

void expect_same_info(const BtfInfo& found, const BtfInfo& wanted) {
  EXPECT_EQ(found.shape, wanted.shape);
  EXPECT_EQ(found.dtype, wanted.dtype);
  EXPECT_EQ(found.encoding, wanted.encoding);
  EXPECT_EQ(found.quantity, wanted.quantity);
  EXPECT_EQ(found.layout, wanted.layout);
  EXPECT_EQ(found.view_directions, wanted.view_directions);
  EXPECT_EQ(found.light_directions, wanted.light_directions);
  EXPECT_EQ(found.channel_names, wanted.channel_names);
  EXPECT_EQ(found.source, wanted.source);
  EXPECT_EQ(found.mask, wanted.mask);
  EXPECT_EQ(found.mask_distance, wanted.mask_distance);
}

std::unique_ptr<TileSink> create(const std::filesystem::path& path, const BtfInfo& info) {
  return path.extension() == ".npy" ? create_npy_btf(path, info) : create_raw_btf(path, info);
}

class BothForms : public testing::TestWithParam<std::tuple<const char*, DType>> {};

TEST_P(BothForms, GivesBackEverything) {
  const auto [name, dtype] = GetParam();
  TemporaryFolder folder;
  const BtfInfo info = full_info(dtype);
  const std::vector<std::byte> bytes = some_bytes(info.bytes(), 1);
  write_all(*create(folder / name, info), bytes, 4);

  const auto source = open_raw_btf(folder / name);
  BtfInfo expected = info;
  if (std::string(name).ends_with(".npy")) expected.mask_distance.clear();
  expect_same_info(source->info(), expected);
  std::vector<std::byte> found(2 * info.image_bytes());
  source->read(3, 2, found);
  EXPECT_EQ(std::memcmp(found.data(), bytes.data() + 3 * info.image_bytes(), found.size()), 0);
  const auto mapped = source->mapped(0, 6);
  ASSERT_EQ(mapped.size(), bytes.size());
  EXPECT_EQ(std::memcmp(mapped.data(), bytes.data(), bytes.size()), 0);
  // Released pages come back from the file.
  source->release(0, 6);
  EXPECT_EQ(std::memcmp(mapped.data(), bytes.data(), bytes.size()), 0);
}

TEST_P(BothForms, GivesBackThePairedLayoutWithDefaults) {
  const auto [name, dtype] = GetParam();
  TemporaryFolder folder;
  BtfInfo info = make_info({3, 1, 2, 2, 1}, dtype);
  info.layout = Layout::paired;
  info.light_directions = info.view_directions;
  write_all(*create(folder / name, info), some_bytes(info.bytes(), 2), 1);
  expect_same_info(open_raw_btf(folder / name)->info(), info);
}

TEST_P(BothForms, RefusesImagesThatAreNotThere) {
  const auto [name, dtype] = GetParam();
  TemporaryFolder folder;
  const BtfInfo info = make_info({2, 3, 1, 1, 1}, dtype);
  write_all(*create(folder / name, info), some_bytes(info.bytes(), 3), 6);
  const auto source = open_raw_btf(folder / name);
  std::vector<std::byte> out(info.bytes());
  expect_error(ErrorKind::input, {name, "[5, 7) of 6"}, [&] { source->read(5, 2, out); });
  expect_error(ErrorKind::input, {name}, [&] { source->mapped(7, 0); });
  expect_error(ErrorKind::input, {name},
               [&] { source->read(2, static_cast<std::size_t>(-1), out); });
  expect_error(ErrorKind::input, {name, "bytes"}, [&] { source->read(0, 1, out); });
}

TEST_P(BothForms, AreWrittenInOrderAndWhole) {
  const auto [name, dtype] = GetParam();
  TemporaryFolder folder;
  const BtfInfo info = make_info({2, 2, 2, 3, 1}, dtype);
  const std::vector<std::byte> image(info.image_bytes());
  const auto sink = create(folder / name, info);
  sink->write(0, 1, image);
  expect_error(ErrorKind::runtime, {name, "[2, 3) of 4"}, [&] { sink->write(2, 1, image); });
  expect_error(ErrorKind::runtime, {name}, [&] { sink->write(0, 1, image); });
  expect_error(ErrorKind::runtime, {name, "bytes"}, [&] { sink->write(1, 2, image); });
  expect_error(ErrorKind::runtime, {name, "only 1 of 4"}, [&] { sink->finish(); });
}

TEST_P(BothForms, LeaveNothingBehindUnfinished) {
  const auto [name, dtype] = GetParam();
  TemporaryFolder folder;
  const BtfInfo info = make_info({1, 2, 2, 3, 1}, dtype);
  const std::vector<std::byte> bytes = some_bytes(info.bytes(), 4);
  create(folder / name, info)->write(0, 1, std::span(bytes).first(info.image_bytes()));
  EXPECT_EQ(test::count_files(folder.path()), 0u);

  // A file that is there already stays as it was.
  write_all(*create(folder / name, info), bytes, 2);
  const std::size_t files = test::count_files(folder.path());
  const std::string before = test::read_bytes(folder / name);
  create(folder / name, info)->write(0, 1, std::span(bytes).last(info.image_bytes()));
  EXPECT_EQ(test::count_files(folder.path()), files);
  EXPECT_EQ(test::read_bytes(folder / name), before);
}

INSTANTIATE_TEST_SUITE_P(RawBtf, BothForms,
                         testing::Combine(testing::Values("a.safetensors", "a.npy"),
                                          testing::Values(DType::u8, DType::f16, DType::f32)));

TEST(RawBtf, InvalidInfoIsRefusedBeforeAnythingIsWritten) {
  TemporaryFolder folder;
  BtfInfo info = make_info({2, 2, 2, 2, 1});
  info.view_directions.pop_back();
  for (const char* name : {"a.safetensors", "a.npy"}) {
    expect_error(ErrorKind::input, {name, "view_directions"}, [&] { create(folder / name, info); });
  }
  EXPECT_EQ(test::count_files(folder.path()), 0u);
}

}  // namespace
}  // namespace weft
