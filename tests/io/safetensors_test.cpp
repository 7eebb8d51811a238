// The container: what is read, and every way in which a file may be wrong.
#include "weft/io/safetensors.hpp"

#include <gtest/gtest.h>

#include <cstring>

#include "io/file_bytes.hpp"
#include "support/expect_error.hpp"
#include "support/largest_allocation.hpp"
#include "support/temporary_folder.hpp"

namespace weft {
namespace {

using test::container;
using test::expect_error;
using test::little_endian;
using test::TemporaryFolder;
using test::write_bytes;

constexpr const char* name = "t.safetensors";

std::string text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// Opening must fail, name the file and `parts`, and allocate nothing large on the way.
void expect_refused(const std::string& bytes, std::initializer_list<std::string_view> parts) {
  TemporaryFolder folder;
  write_bytes(folder / name, bytes);
  test::reset_largest_allocation();
  expect_error(ErrorKind::input, {name}, [&] { SafetensorsFile file(folder / name); });
  EXPECT_LE(test::largest_allocation(), bytes.size() * 2 + 4096);
  expect_error(ErrorKind::input, parts, [&] { SafetensorsFile file(folder / name); });
}

void expect_header_refused(const std::string& header, std::initializer_list<std::string_view> parts,
                           const std::string& data = "ab") {
  SCOPED_TRACE(header.substr(0, 200));
  expect_refused(container(header, data), parts);
}

TEST(SafetensorsFile, ReadsForeignFiles) {
  TemporaryFolder folder;
  // Out of order, misaligned, a scalar, a tensor without values, spaces anywhere, a name in
  // escapes.
  const std::string header =
      R"( {"h":{"shape":[2], "data_offsets":[1,5],"dtype":"F16"},
         "\u00fc":{"dtype":"U8","shape":[],"data_offsets":[0,1]},
         "none":{"dtype":"F32","shape":[3,0,2],"data_offsets":[5,5]},
         "__metadata__":{"k":"v","empty":""}}   )";
  write_bytes(folder / name, container(header.substr(1), "Uabcd"));
  const SafetensorsFile file(folder / name);
  ASSERT_EQ(file.tensors().size(), 3u);
  EXPECT_EQ(file.tensors()[0].name, "\xc3\xbc");
  EXPECT_EQ(file.tensors()[0].elements(), 1u);
  EXPECT_EQ(text_of(file.data(file.get("\xc3\xbc"))), "U");
  EXPECT_EQ(file.get("h").dtype, DType::f16);
  EXPECT_EQ(file.get("h").shape, (std::vector<std::size_t>{2}));
  EXPECT_EQ(text_of(file.data(file.get("h"))), "abcd");
  EXPECT_EQ(file.offset(file.get("h")), 8 + header.size() - 1 + 1);
  EXPECT_EQ(file.data(file.get("none")).size(), 0u);
  EXPECT_EQ(file.find("nothing"), nullptr);
  EXPECT_EQ(file.value("k"), "v");
  EXPECT_EQ(file.value("absent"), "");
  EXPECT_EQ(file.require("empty"), "");
  expect_error(ErrorKind::input, {name, "absent"}, [&] { file.require("absent"); });
  expect_error(ErrorKind::input, {name, "nothing"}, [&] { file.get("nothing"); });
}

TEST(SafetensorsFile, ReadsAFileWithoutTensors) {
  TemporaryFolder folder;
  write_bytes(folder / name, container("{}", ""));
  EXPECT_TRUE(SafetensorsFile(folder / name).tensors().empty());
}

TEST(SafetensorsFile, RefusesWhatIsNoSuchFile) {
  expect_refused("", {"0 bytes"});
  expect_refused("1234567", {"7 bytes"});
  expect_refused(little_endian(2), {"8 bytes"});
  expect_refused(std::string(4096, '\0'), {"'{'"});
  expect_refused("\x93NUMPY and so on, and so on", {"not a safetensors file"});
  expect_refused(little_endian(~std::uint64_t{0}) + "{}", {"18446744073709551615"});
  expect_refused(little_endian(std::uint64_t{1} << 60) + "{}", {"1152921504606846976"});
  expect_refused(little_endian((std::uint64_t{100} << 20) + 1) + "{}", {"104857601"});
  // A length that is allowed but longer than the file.
  expect_refused(little_endian(std::uint64_t{100} << 20) + "{}", {"104857600", "truncated"});
  expect_refused(little_endian(3) + "{}", {"truncated"});
  TemporaryFolder folder;
  expect_error(ErrorKind::input, {"absent", "No such file"},
               [&] { SafetensorsFile file(folder / "absent"); });
  expect_error(ErrorKind::input, {folder.path().string(), "regular file"},
               [&] { SafetensorsFile file(folder.path()); });
}

TEST(SafetensorsFile, RefusesHeadersThatAreNotTheFormats) {
  expect_header_refused("[1]", {"'{'"});
  expect_header_refused(" {}", {"'{'"});
  expect_header_refused("\xef\xbb\xbf{}", {"'{'"});
  expect_header_refused("{", {"JSON"});
  expect_header_refused("{}x", {"JSON"});
  expect_header_refused("{}{}", {"JSON"});
  expect_header_refused(std::string("{}\0 ", 4), {"NUL"});
  expect_header_refused("{\"a\":1}", {"\"a\"", "number"});
  expect_header_refused("{\"a\":\"b\"}", {"\"a\"", "string"});
  expect_header_refused("{\"a\":null}", {"\"a\"", "null"});
  expect_header_refused("{\"a\":true}", {"\"a\"", "truth value"});
  expect_header_refused("{\"a\":[]}", {"\"a\"", "list"});
  expect_header_refused("{\"a\":{}}", {"\"a\"", "dtype"});
  expect_header_refused("{\"\xff\":{}}", {"JSON"});
  expect_header_refused(R"({"\ud800":{}})", {"JSON"});
  expect_header_refused("{\"a\nb\":{}}", {"JSON"});
  expect_header_refused(R"({"a":{"b":{"c":1}}})", {"\"b\"", "unknown"});
  // A name as long as the file is not repeated whole.
  try {
    TemporaryFolder folder;
    write_bytes(folder / name, container("{\"" + std::string(100000, 'n') + "\":1}", ""));
    SafetensorsFile file(folder / name);
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_LT(std::strlen(error.what()), 1000u);
  }
}

TEST(SafetensorsFile, RefusesDeepNesting) {
  const std::size_t depth = 1000000;
  for (const std::string open : {"[", "{\"a\":"}) {
    std::string header = R"({"a":{"shape":)";
    for (std::size_t i = 0; i < depth; ++i) header += open;
    expect_refused(container(header, ""), {"\"shape\""});
  }
}

TEST(SafetensorsFile, RefusesMetadataOfOtherThanStrings) {
  for (const char* value : {"1", "-1", "1.5", "null", "true", "[]", "[\"a\"]"}) {
    expect_header_refused(fmt::format(R"({{"__metadata__":{{"key":{}}}}})", value),
                          {"metadata", "key", "strings"}, "");
  }
  expect_header_refused(R"({"__metadata__":{"key":{}}})", {"metadata", "key", "object"}, "");
  expect_header_refused(R"({"__metadata__":[]})", {"__metadata__", "list"}, "");
  expect_header_refused(R"({"__metadata__":"text"})", {"__metadata__", "string"}, "");
  expect_header_refused(R"({"__metadata__":{"k":"a","k":"b"}})", {"\"k\"", "twice"}, "");
  expect_header_refused(R"({"__metadata__":{},"__metadata__":{}})", {"__metadata__", "twice"}, "");
}

TEST(SafetensorsFile, RefusesEntriesThatAreNotTheFormats) {
  const auto entry = [](const char* fields) { return fmt::format(R"({{"a":{{{}}}}})", fields); };
  const char* dtype_missing = R"("shape":[2],"data_offsets":[0,2])";
  const char* shape_missing = R"("dtype":"U8","data_offsets":[0,2])";
  const char* offsets_missing = R"("dtype":"U8","shape":[2])";
  expect_header_refused(entry(dtype_missing), {"\"a\"", "dtype"});
  expect_header_refused(entry(shape_missing), {"\"a\"", "shape"});
  expect_header_refused(entry(offsets_missing), {"\"a\"", "data_offsets"});
  for (const char* dtype : {"\"I64\"", "\"BF16\"", "\"u8\"", "\"\"", "1", "[\"U8\"]", "null"}) {
    expect_header_refused(entry(fmt::format(R"("dtype":{},{})", dtype, dtype_missing).c_str()),
                          {"\"a\"", "dtype"});
  }
  for (const char* shape : {"[-1]", "[2.0]", "[\"2\"]", "2", "[[2]]", "[2,null]", "[1e400]", "[{}]",
                            "[18446744073709551616]", "\"[2]\""}) {
    expect_header_refused(entry(fmt::format(R"("shape":{},{})", shape, shape_missing).c_str()),
                          {"t.safetensors"});
  }
  for (const char* offsets : {"[0]", "[0,1,2]", "[]", "[0,-2]", "[0,2.0]", "2", "{}"}) {
    expect_header_refused(
        entry(fmt::format(R"("data_offsets":{},{})", offsets, offsets_missing).c_str()),
        {"t.safetensors"});
  }
  expect_header_refused(entry(R"("dtype":"U8","dtype":"U8","shape":[2],"data_offsets":[0,2])"),
                        {"dtype", "twice"});
  expect_header_refused(entry(R"("dtype":"U8","shape":[2],"data_offsets":[0,2],"more":1)"),
                        {"more", "unknown"});
  expect_header_refused(R"({"a":{"dtype":"U8","shape":[2],"data_offsets":[0,2]},)"
                        R"("a":{"dtype":"U8","shape":[2],"data_offsets":[0,2]}})",
                        {"\"a\"", "twice"});
  // The same name in other letters of JSON.
  expect_header_refused(R"({"a":{"dtype":"U8","shape":[2],"data_offsets":[0,2]},)"
                        R"("\u0061":{"dtype":"U8","shape":[0],"data_offsets":[2,2]}})",
                        {"\"a\"", "twice"});
}

std::string one_tensor(std::string_view dtype, std::string_view shape, std::string_view offsets) {
  return fmt::format(R"({{"lying":{{"dtype":"{}","shape":{},"data_offsets":{}}}}})", dtype, shape,
                     offsets);
}

TEST(SafetensorsFile, RefusesLyingShapes) {
  expect_header_refused(one_tensor("U8", "[3]", "[0,2]"), {"lying", "[3]", "3 bytes", "hold 2"});
  expect_header_refused(one_tensor("F32", "[2]", "[0,2]"), {"lying", "8 bytes"});
  expect_header_refused(one_tensor("U8", "[]", "[0,2]"), {"lying", "1 bytes"});
  expect_header_refused(one_tensor("U8", "[1152921504606846976]", "[0,2]"),
                        {"lying", "1152921504606846976"});
  expect_header_refused(one_tensor("F64", "[2305843009213693952]", "[0,2]"), {"overflows"});
  // Products that come out as 2 or 0 modulo 2^64.
  expect_header_refused(one_tensor("U8", "[4294967296,4294967296]", "[0,0]"), {"overflows"}, "");
  expect_header_refused(one_tensor("U8", "[2,9223372036854775809]", "[0,2]"), {"overflows"});
  expect_header_refused(one_tensor("U8", "[4294967296,4294967296,0]", "[0,0]"), {"overflows"}, "");
  expect_header_refused(one_tensor("U8", "[2]", "[0,1152921504606846976]"),
                        {"lying", "1152921504606846976", "pass the end"});
  expect_header_refused(one_tensor("U8", "[2]", "[0,18446744073709551615]"), {"pass the end"});
  expect_header_refused(one_tensor("U8", "[2]", "[2,0]"), {"backwards"});
  expect_header_refused(one_tensor("U8", "[2]", "[18446744073709551615,1]"), {"backwards"});
}

TEST(SafetensorsFile, RefusesGapsOverlapsAndWhatFollows) {
  const auto two = [](const char* first, const char* second) {
    return fmt::format(R"({{"a":{{"dtype":"U8","shape":[2],"data_offsets":{}}},)"
                       R"("b":{{"dtype":"U8","shape":[2],"data_offsets":{}}}}})",
                       first, second);
  };
  expect_header_refused(two("[0,2]", "[1,3]"), {"\"b\"", "overlapping"}, "abc");
  expect_header_refused(two("[0,2]", "[0,2]"), {"\"b\"", "overlapping"}, "ab");
  expect_header_refused(two("[0,2]", "[3,5]"), {"\"b\"", "gap"}, "abcde");
  expect_header_refused(two("[3,5]", "[1,3]"), {"\"b\"", "gap"}, "abcde");
  expect_header_refused(two("[0,2]", "[2,4]"), {"1 bytes after"}, "abcde");
  expect_header_refused(two("[0,2]", "[2,4]"), {"\"b\"", "pass the end"}, "abc");
  expect_header_refused("{}", {"2 bytes after"});
  // A tensor without values inside another one's bytes.
  expect_header_refused(R"({"a":{"dtype":"U8","shape":[2],"data_offsets":[0,2]},)"
                        R"("b":{"dtype":"U8","shape":[0],"data_offsets":[1,1]}})",
                        {"\"b\"", "overlapping"});
}

TEST(SafetensorsFile, LooksLike) {
  TemporaryFolder folder;
  const auto looks = [&](const std::string& bytes) {
    write_bytes(folder / name, bytes);
    return SafetensorsFile::looks_like(folder / name);
  };
  EXPECT_TRUE(looks(container("{}", "")));
  EXPECT_TRUE(looks(little_endian(1000) + "{\"trunc"));  // so that its own error is shown
  EXPECT_FALSE(looks(""));
  EXPECT_FALSE(looks(little_endian(2)));
  EXPECT_FALSE(looks(little_endian(2) + "[]"));
  EXPECT_FALSE(looks(little_endian(std::uint64_t{1} << 60) + "{}"));
  EXPECT_FALSE(SafetensorsFile::looks_like(folder / "absent"));
  EXPECT_FALSE(SafetensorsFile::looks_like(folder.path()));
}

}  // namespace
}  // namespace weft
