// Writing the container: order, alignment, room kept in the header, and whole files only.
#include <gtest/gtest.h>

#include "io/file_bytes.hpp"
#include "support/expect_error.hpp"
#include "support/temporary_folder.hpp"
#include "weft/io/safetensors.hpp"

namespace weft {
namespace {

using test::expect_error;
using test::TemporaryFolder;

std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text));
}

std::string text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

TEST(SafetensorsWriter, OrdersAndAlignsTensors) {
  TemporaryFolder folder;
  SafetensorsWriter writer(folder / "t",
                           {{"u8", DType::u8, {3}},
                            {"f16", DType::f16, {1}},
                            {"f64", DType::f64, {1}},
                            {"f32", DType::f32, {1}},
                            {"u32", DType::u32, {}},
                            {"u16", DType::u16, {0}}},
                           {{"key", "value"}});
  writer.write("u8", 2, bytes_of("c"));
  writer.write("f64", 0, bytes_of("12345678"));
  writer.write("u8", 0, bytes_of("ab"));
  writer.write("f32", 0, bytes_of("abcd"));
  writer.write("f16", 0, bytes_of("hf"));
  writer.write("u32", 0, bytes_of("ABCD"));
  EXPECT_FALSE(std::filesystem::exists(folder / "t"));
  writer.finish();

  const SafetensorsFile file(folder / "t");
  std::string order;
  for (const TensorInfo& tensor : file.tensors()) order += tensor.name + " ";
  EXPECT_EQ(order, "f64 f32 u32 f16 u16 u8 ");
  for (const TensorInfo& tensor : file.tensors()) {
    EXPECT_EQ(file.offset(tensor) % size_of(tensor.dtype), 0u) << tensor.name;
  }
  EXPECT_EQ(file.offset(file.get("f64")) % 64, 0u);
  EXPECT_EQ(text_of(file.data(file.get("u8"))), "abc");
  EXPECT_EQ(text_of(file.data(file.get("u32"))), "ABCD");
  EXPECT_EQ(file.value("key"), "value");
  EXPECT_EQ(std::filesystem::file_size(folder / "t"), writer.file_size());
  EXPECT_EQ(safetensors_file_size({{"a", DType::u8, {3}}}, {}, 0), 64u + 3);
}

TEST(SafetensorsWriter, KeepsRoomForMetadata) {
  TemporaryFolder folder;
  const std::vector<TensorInfo> tensors{{"a", DType::u8, {1}}};
  SafetensorsWriter writer(folder / "t", tensors, {{"k", ""}}, 1000);
  writer.write("a", 0, bytes_of("x"));
  writer.set_metadata("late", std::string(500, 'l'));
  writer.set_metadata("k", "\"quoted\" \n");
  writer.finish();
  const SafetensorsFile file(folder / "t");
  EXPECT_EQ(file.value("late"), std::string(500, 'l'));
  EXPECT_EQ(file.value("k"), "\"quoted\" \n");
  EXPECT_EQ(safetensors_file_size(tensors, {{"k", ""}}, 1000), writer.file_size());
  const std::string bytes = test::read_bytes(folder / "t");
  EXPECT_EQ(bytes[bytes.size() - 2], ' ');  // padded with spaces

  SafetensorsWriter small(folder / "u", tensors, {}, 0);
  small.write("a", 0, bytes_of("x"));
  small.set_metadata("late", std::string(500, 'l'));
  expect_error(ErrorKind::runtime, {"u", "room"}, [&] { small.finish(); });
}

TEST(SafetensorsWriter, RefusesWhatDoesNotFit) {
  TemporaryFolder folder;
  {
    SafetensorsWriter writer(folder / "t", {{"a", DType::u8, {2}}, {"b", DType::f32, {1}}}, {});
    expect_error(ErrorKind::runtime, {"t", "\"c\""}, [&] { writer.write("c", 0, {}); });
    expect_error(ErrorKind::runtime, {"t", "\"a\""}, [&] { writer.write("a", 1, bytes_of("xy")); });
    expect_error(ErrorKind::runtime, {"t", "\"a\""},
                 [&] { writer.write("a", static_cast<std::size_t>(-1), bytes_of("xy")); });
    writer.write("b", 0, bytes_of("1234"));
    writer.write("a", 1, bytes_of("x"));
    expect_error(ErrorKind::runtime, {"t", "\"a\"", "1 of 2"}, [&] { writer.finish(); });
  }
  EXPECT_EQ(test::count_files(folder.path()), 0u);
  const auto refused = [&](std::vector<TensorInfo> tensors, Metadata metadata) {
    expect_error(ErrorKind::input, {"t"}, [&] {
      SafetensorsWriter writer(folder / "t", std::move(tensors), std::move(metadata));
    });
  };
  refused({{"", DType::u8, {1}}}, {});
  refused({{"__metadata__", DType::u8, {1}}}, {});
  refused({{"a", DType::u8, {1}}, {"a", DType::f32, {1}}}, {});
  refused({{"a", DType::f64, {std::size_t{1} << 62}}}, {});
  refused({{"a", DType::u8, {std::size_t{1} << 63}}, {"b", DType::u8, {std::size_t{1} << 63}}}, {});
  refused({{"a", DType::u8, {1}}}, {{"key", "\xff"}});
  EXPECT_EQ(test::count_files(folder.path()), 0u);
}

TEST(SafetensorsWriter, WritesTheSameBytesTwice) {
  TemporaryFolder folder;
  for (const char* name : {"a", "b"}) {
    SafetensorsWriter writer(folder / name, {{"x", DType::u16, {2}}}, {{"z", "1"}, {"a", "2"}}, 7);
    writer.write("x", 0, bytes_of("abcd"));
    writer.finish();
  }
  EXPECT_EQ(test::read_bytes(folder / "a"), test::read_bytes(folder / "b"));
}

}  // namespace
}  // namespace weft
