// Raw safetensors files of others, and files that are no raw BTF: built byte by byte, then damaged.
#include <gtest/gtest.h>

#include <bit>
#include <cstring>
#include <functional>

#include "io/file_bytes.hpp"
#include "support/expect_error.hpp"
#include "support/largest_allocation.hpp"
#include "support/mutate.hpp"
#include "support/temporary_folder.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/io/safetensors.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

using test::expect_error;
using test::TemporaryFolder;
using test::write_bytes;

std::string floats(std::initializer_list<float> values) {
  std::string bytes;
  for (const float value : values) {
    bytes += test::little_endian(std::bit_cast<std::uint32_t>(value)).substr(0, 4);
  }
  return bytes;
}

// A raw BTF of shape [1, 2, 1, 2, 1] as tensors and metadata, which a test may change.
struct RawFile {
  struct Tensor {
    std::string name, dtype, shape, bytes;
  };
  std::vector<Tensor> tensors{
      {"btf", "U8", "[1,2,1,2,1]", "abcd"},
      {"view_directions", "F32", "[1,3]", floats({0, 0, 1})},
      {"light_directions", "F32", "[2,3]", floats({0, 0, 1, 0.6f, 0, 0.8f})}};
  std::string metadata;  // with the comma that follows: "\"__metadata__\":{...},"

  Tensor& operator[](std::string_view name) {
    for (Tensor& tensor : tensors) {
      if (tensor.name == name) return tensor;
    }
    return tensors.emplace_back(Tensor{std::string(name), "U8", "[0]", ""});
  }

  std::string text() const {
    std::string header = "{" + metadata;
    std::string data;
    for (const Tensor& tensor : tensors) {
      header += fmt::format("{}\"{}\":{{\"dtype\":\"{}\",\"shape\":{},\"data_offsets\":[{},{}]}}",
                            &tensor == &tensors.front() ? "" : ",", tensor.name, tensor.dtype,
                            tensor.shape, data.size(), data.size() + tensor.bytes.size());
      data += tensor.bytes;
    }
    return test::container(header + "}", data);
  }
};

TEST(ForeignRawBtf, DefaultsFollowTheDtype) {
  TemporaryFolder folder;
  const auto path = folder / "a.safetensors";
  RawFile raw;
  write_bytes(path, raw.text());
  auto source = open_raw_btf(path);
  EXPECT_EQ(source->info().shape, (BtfShape{1, 2, 1, 2, 1}));
  EXPECT_EQ(source->info().encoding, Encoding::srgb);
  EXPECT_EQ(source->info().quantity, Quantity::radiance);
  EXPECT_EQ(source->info().layout, Layout::grid);
  EXPECT_TRUE(source->info().channel_names.empty());
  EXPECT_TRUE(source->info().mask.empty());
  EXPECT_EQ(source->info().source, "");
  ASSERT_EQ(source->mapped(1, 1).size(), 2u);
  EXPECT_EQ(std::memcmp(source->mapped(1, 1).data(), "cd", 2), 0);

  raw["btf"].dtype = "F16";
  raw["btf"].bytes = "abcdefgh";
  raw.tensors.push_back({"more", "F64", "[1]", "12345678"});  // what else there is does not matter
  write_bytes(path, raw.text());
  EXPECT_EQ(open_raw_btf(path)->info().encoding, Encoding::linear);
  // By content, whatever the name.
  write_bytes(folder / "b", raw.text());
  EXPECT_NO_THROW(open_raw_btf(folder / "b"));
}

TEST(ForeignRawBtf, MisalignedValuesAreReadButNotMapped) {
  TemporaryFolder folder;
  RawFile raw;
  raw.tensors.insert(raw.tensors.begin(), {"odd", "U8", "[1]", "x"});
  raw["btf"].dtype = "F32";
  raw["btf"].bytes = floats({1, 2, 3, 4});
  raw.metadata = " ";
  for (int i = 0; i < 4; ++i) {  // every alignment of the data once
    raw.metadata += " ";
    write_bytes(folder / "a", raw.text());
    const auto source = open_raw_btf(folder / "a");
    std::vector<float> values(2);
    source->read(1, 1, std::as_writable_bytes(std::span(values)));
    EXPECT_EQ(values, (std::vector<float>{3, 4}));
    const auto mapped = source->mapped(0, 2);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(mapped.data()) % 4, 0u);
    EXPECT_EQ(source->info().light_directions[1], (Direction{0.6f, 0, 0.8f}));
  }
}

TEST(ForeignRawBtf, RefusesWhatIsNoRawBtf) {
  TemporaryFolder folder;
  const auto path = folder / "a.safetensors";
  const auto refused = [&](std::initializer_list<std::string_view> parts,
                           const std::function<void(RawFile&)>& change) {
    RawFile raw;
    change(raw);
    write_bytes(path, raw.text());
    test::reset_largest_allocation();
    expect_error(ErrorKind::input, {"a.safetensors"}, [&] { open_raw_btf(path); });
    EXPECT_LE(test::largest_allocation(), 65536u);
    expect_error(ErrorKind::input, parts, [&] { open_raw_btf(path); });
  };
  const auto metadata = [&](const char* text, std::initializer_list<std::string_view> parts) {
    refused(parts,
            [&](RawFile& raw) { raw.metadata = fmt::format("\"__metadata__\":{{{}}},", text); });
  };
  refused({"no tensor \"btf\""}, [](RawFile& raw) { raw["btf"].name = "values"; });
  refused({"no tensor \"view_directions\""},
          [](RawFile& raw) { raw["view_directions"].name = "v"; });
  refused({"no tensor \"light_directions\""},
          [](RawFile& raw) { raw["light_directions"].name = "l"; });
  refused({"btf", "4 modes"}, [](RawFile& raw) { raw["btf"].shape = "[1,2,1,2]"; });
  refused({"btf", "6 modes"}, [](RawFile& raw) { raw["btf"].shape = "[1,2,1,2,1,1]"; });
  refused({"light_directions", "[2, 3]", "[4, 3]"},
          [](RawFile& raw) { raw["btf"].shape = "[1,4,1,1,1]"; });
  refused({"view_directions", "[1, 3]", "[0, 3]"}, [](RawFile& raw) {
    raw["btf"].shape = "[0,2,1152921504606846976,1,1]";
    raw["btf"].bytes = "";
  });
  refused({"[1, 2, 0, 2, 1]"}, [](RawFile& raw) {
    raw["btf"].shape = "[1,2,0,2,1]";
    raw["btf"].bytes = "";
  });
  refused({"U16"}, [](RawFile& raw) {
    raw["btf"].dtype = "U16";
    raw["btf"].bytes = "abcdefgh";
  });
  refused({"F64"}, [](RawFile& raw) {
    raw["btf"].dtype = "F64";
    raw["btf"].bytes = std::string(32, 'x');
  });
  refused({"view_directions", "F16"}, [](RawFile& raw) {
    raw["view_directions"].dtype = "F16";
    raw["view_directions"].bytes = "abcdef";
  });
  refused({"view_directions", "[3]"}, [](RawFile& raw) { raw["view_directions"].shape = "[3]"; });
  refused({"view_directions[0]", "unit"}, [](RawFile& raw) {
    raw["view_directions"].bytes = floats({0, 0, 2});
  });
  refused({"light_directions[1]"}, [](RawFile& raw) {
    raw["light_directions"].bytes = floats({0, 0, 1, std::nanf(""), 0, 1});
  });
  refused({"mask", "[2]", "[1, 1, 2]"}, [](RawFile& raw) {
    raw.tensors.push_back({"mask", "U8", "[2]", {1, 1}});
  });
  refused({"mask", "F16"}, [](RawFile& raw) {
    raw.tensors.push_back({"mask", "F16", "[1,1,2]", "abcd"});
  });
  refused({"mask_distance", "[2]", "[1, 1, 2]"}, [](RawFile& raw) {
    raw.tensors.push_back({"mask_distance", "F32", "[2]", std::string(8, 0)});
  });
  refused({"mask_distance", "U8"}, [](RawFile& raw) {
    raw.tensors.push_back({"mask_distance", "U8", "[1,1,2]", {1, 1}});
  });
  refused({"mask_distance value nan at index 1"}, [](RawFile& raw) {
    raw.tensors.push_back({"mask_distance", "F32", "[1,1,2]", floats({0, std::nanf("")})});
  });
  refused({"mask value 97 at index 1"}, [](RawFile& raw) {
    raw.tensors.push_back({"mask", "U8", "[1,1,2]", {1, 'a'}});
  });
  metadata(R"("modes":"l,v,y,x,c")", {"modes", "l,v,y,x,c"});
  metadata(R"("encoding":"log")", {"encoding", "log"});
  metadata(R"("encoding":"")", {"encoding"});
  metadata(R"("quantity":"flux")", {"quantity", "flux"});
  metadata(R"("layout":"paired")", {"light_directions", "[2, 3]", "[1, 3]"});
  metadata(R"("layout":"spiral")", {"layout", "spiral"});
  metadata(R"("channel_names":"R")", {"channel_names"});
  metadata(R"("channel_names":"{}")", {"channel_names"});
  metadata(R"("channel_names":"[1]")", {"channel_names"});
  metadata(R"("channel_names":"[\"R\",\"G\"]")", {"2 channel names"});
  metadata(R"("weft.format":"2","weft.version":"9.1.0")", {"weft.format 2", "9.1.0"});
  metadata(R"("weft.format":"one")", {"weft.format", "one"});
}

TEST(ForeignRawBtf, AModelIsNamedAsSuch) {
  TemporaryFolder folder;
  RawFile raw;
  raw["btf"].name = "core";
  raw.metadata = R"("__metadata__":{"codec":"tucker"},)";
  write_bytes(folder / "m.weft", raw.text());
  expect_error(ErrorKind::input, {"m.weft", "model"}, [&] { open_raw_btf(folder / "m.weft"); });
}

TEST(RawBtfGolden, BytesOfATinyFile) {
  TemporaryFolder folder;
  BtfInfo info;
  info.shape = {1, 2, 1, 2, 1};
  info.dtype = DType::u8;
  info.encoding = Encoding::srgb;
  info.view_directions = {{0, 0, 1}};
  info.light_directions = {{0, 0, 1}, {0.6f, 0, 0.8f}};
  info.channel_names = {"Y"};
  info.source = "made";
  info.mask = {0, 1};
  const auto sink = create_raw_btf(folder / "a", info);
  sink->write(0, 2, std::as_bytes(std::span("abcd", 4)));
  sink->finish();

  std::string header =
      R"({"__metadata__":{"channel_names":"[\"Y\"]","encoding":"srgb","layout":"grid",)"
      R"("modes":"v,l,y,x,c","quantity":"radiance","source":"made","weft.format":"1",)"
      R"("weft.version":")" +
      std::string(version()) +
      R"("},"view_directions":{"dtype":"F32","shape":[1,3],"data_offsets":[0,12]},)"
      R"("light_directions":{"dtype":"F32","shape":[2,3],"data_offsets":[12,36]},)"
      R"("btf":{"dtype":"U8","shape":[1,2,1,2,1],"data_offsets":[36,40]},)"
      R"("mask":{"dtype":"U8","shape":[1,1,2],"data_offsets":[40,42]}})";
  header.resize((8 + header.size() + 63) / 64 * 64 - 8, ' ');
  const std::string data =
      floats({0, 0, 1, 0, 0, 1, 0.6f, 0, 0.8f}) + "abcd" + std::string("\0\1", 2);
  EXPECT_EQ(test::read_bytes(folder / "a"), test::container(header, data));
}

// Reads all there is; anything but success and an Error ends the test program or fails the test.
void read_whatever(const std::filesystem::path& path) {
  try {
    const auto source = open_raw_btf(path);
    const BtfInfo& info = source->info();
    std::vector<std::byte> values(info.bytes());
    source->read(0, info.shape.images(), values);
    source->mapped(0, info.shape.images());
    source->release(0, info.shape.images());
  } catch (const Error& error) {
    EXPECT_EQ(static_cast<int>(error.kind()), 2) << error.what();
  }
}

TEST(RawBtfFuzz, DamagedFilesGiveErrorsOnly) {
  TemporaryFolder folder;
  RawFile raw;
  raw.metadata = R"("__metadata__":{"weft.format":"1","modes":"v,l,y,x,c","encoding":"srgb",)"
                 R"("channel_names":"[\"Y\"]","layout":"grid","source":"caf\u00e9"},)";
  raw.tensors.push_back({"mask", "U8", "[1,1,2]", {1, 1}});
  const std::string good = raw.text();
  write_bytes(folder / "a", good);
  ASSERT_NO_THROW(open_raw_btf(folder / "a"));
  test::Random random(11);
  for (int i = 0; i < 3000; ++i) {
    write_bytes(folder / "a", i % 3 == 0 ? test::mutate(good, good.size(), random)
                                         : test::mutate_header(good, random));
    read_whatever(folder / "a");
    if (testing::Test::HasFailure()) FAIL() << "variant " << i;
  }
}

TEST(RawBtfFuzz, DamagedNpyPairsGiveErrorsOnly) {
  TemporaryFolder folder;
  const std::string header = make_npy_header(DType::u8, {1, 2, 1, 2, 1});
  const std::string npy = header + "abcd";
  const std::string json =
      R"({"axes":["view","light","y","x","channel"],"views":[{"dir":[0,0,1]}],)"
      R"("lights":[{"theta":0,"phi":0},[0.6,0,0.8]],"mask_runs":[0,1,1],"channel_names":["Y"],)"
      R"("encoding":"srgb","quantity":"radiance","layout":"grid","source":"caf\u00e9"})";
  write_bytes(folder / "a.npy", npy);
  write_bytes(folder / "a.json", json);
  ASSERT_NO_THROW(open_raw_btf(folder / "a.npy"));
  test::Random random(12);
  for (int i = 0; i < 2000; ++i) {
    write_bytes(folder / "a.npy", i % 2 == 0 ? npy : test::mutate(npy, 80, random));
    write_bytes(folder / "a.json", i % 2 == 1 ? json : test::mutate(json, json.size(), random));
    read_whatever(folder / "a.npy");
    if (testing::Test::HasFailure()) FAIL() << "variant " << i;
  }
}

}  // namespace
}  // namespace weft
