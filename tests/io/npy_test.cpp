// The NPY form: headers as NumPy writes them, and every way in which header or JSON may be wrong.
#include "weft/io/npy.hpp"

#include <gtest/gtest.h>

#include "io/file_bytes.hpp"
#include "support/expect_error.hpp"
#include "support/largest_allocation.hpp"
#include "support/temporary_folder.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft {
namespace {

using test::expect_error;
using test::TemporaryFolder;
using test::write_bytes;

std::string npy(std::string_view dict, std::string_view data, char major = 1) {
  std::string bytes("\x93NUMPY", 6);
  bytes += {major, '\0'};
  bytes += test::little_endian(dict.size()).substr(0, major == 1 ? 2 : 4);
  return bytes + std::string(dict) + std::string(data);
}

constexpr const char* good_dict = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }\n";
const std::string good_data(8, 'x');

TEST(NpyHeader, ReadsTheFormsThatNumPyWrote) {
  TemporaryFolder folder;
  const auto path = folder / "a.npy";
  struct Case {
    std::string dict;
    std::size_t bytes;
    DType dtype;
    std::vector<std::size_t> shape;
  };
  for (const Case& c : std::vector<Case>{
           {good_dict, 8, DType::f32, {1, 2}},
           {"{'descr': '|u1', 'fortran_order': False, 'shape': (3,), }", 3, DType::u8, {3}},
           {"{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }", 16, DType::f64, {2}},
           {"{'descr': '<f2', 'fortran_order': False, 'shape': (), }", 2, DType::f16, {}},
           {"{\"shape\":(0,5),\"descr\":\"<f2\",\"fortran_order\":False}  \n",
            0,
            DType::f16,
            {0, 5}},
           {"{'descr': '<f4', 'fortran_order': False, 'shape': (1L, 2L), }",
            8,
            DType::f32,
            {1, 2}}}) {
    for (const char major : {'\1', '\2', '\3'}) {
      SCOPED_TRACE(c.dict);
      write_bytes(path, npy(c.dict, std::string(c.bytes, 'd'), major));
      const NpyHeader header = read_npy_header(path);
      EXPECT_EQ(header.dtype, c.dtype);
      EXPECT_EQ(header.shape, c.shape);
      EXPECT_EQ(header.data_offset, (major == 1 ? 10 : 12) + c.dict.size());
    }
  }
}

TEST(NpyHeader, IsWrittenAsNumPyDoes) {
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    const std::string header = make_npy_header(dtype, {37, 21, 64, 64, 3});
    EXPECT_EQ(header.size() % 64, 0u);
    EXPECT_EQ(header.back(), '\n');
    EXPECT_NE(header.find("'shape': (37, 21, 64, 64, 3), }"), std::string::npos);
  }
  EXPECT_EQ(make_npy_header(DType::f16, {5}),
            std::string("\x93NUMPY\1\0v\0", 10) +
                "{'descr': '<f2', 'fortran_order': False, 'shape': (5,), }" + std::string(60, ' ') +
                "\n");
  expect_error(ErrorKind::input, {"F64"}, [] { make_npy_header(DType::f64, {1}); });
}

TEST(NpyHeader, RefusesWhatIsWrong) {
  TemporaryFolder folder;
  const auto path = folder / "a.npy";
  const auto refused = [&](const std::string& bytes,
                           std::initializer_list<std::string_view> parts) {
    SCOPED_TRACE(bytes.substr(0, 120));
    write_bytes(path, bytes);
    test::reset_largest_allocation();
    expect_error(ErrorKind::input, {"a.npy"}, [&] { read_npy_header(path); });
    EXPECT_LE(test::largest_allocation(), 4096 + 2 * bytes.size());
    expect_error(ErrorKind::input, parts, [&] { read_npy_header(path); });
  };
  const auto dict_refused = [&](const std::string& dict,
                                std::initializer_list<std::string_view> parts) {
    refused(npy(dict, good_data), parts);
  };
  const std::string whole = npy(good_dict, good_data);
  for (std::size_t size = 0; size < whole.size(); ++size) refused(whole.substr(0, size), {"a.npy"});
  refused(whole + "x", {"8 bytes", "holds 9"});
  refused("\x93NUMPX" + whole.substr(6), {"not an NPY"});
  refused(npy(good_dict, good_data, 4), {"version 4.0"});
  refused(npy(good_dict, good_data, 0), {"version 0.0"});
  refused(std::string("\x93NUMPY\2\0\xff\xff\xff\xff", 12) + good_dict, {"4294967295"});

  const auto with = [](const char* descr, const char* order, const char* shape) {
    return fmt::format("{{'descr': {}, 'fortran_order': {}, 'shape': {}, }}", descr, order, shape);
  };
  for (const char* descr : {"'>f4'", "'>f8'", "'<i4'", "'|b1'", "'|O'", "''", "'<f4\n'"}) {
    dict_refused(with(descr, "False", "(1, 2)"), {"descr", "little-endian"});
  }
  dict_refused(with("[('a', '<f4')]", "False", "(1, 2)"), {"descr"});
  dict_refused(with("'<f4'", "True", "(1, 2)"), {"Fortran"});
  dict_refused(with("'<f4'", "false", "(1, 2)"), {"True or False"});
  for (const char* shape : {"2", "[1, 2]", "(1, -2)", "(1, 2.0)", "(1, 'a')", "(1 2)", "(,)",
                            "(1, 2", "((1, 2))", "(1,, 2)"}) {
    dict_refused(with("'<f4'", "False", shape), {"a.npy"});
  }
  dict_refused(with("'<f4'", "False", "(1, 3)"), {"12 bytes", "holds 8"});
  dict_refused(with("'<f4'", "False", "(1152921504606846976,)"), {"4611686018427387904 bytes"});
  dict_refused(with("'<f4'", "False", "(4611686018427387906,)"), {"overflows"});
  dict_refused(with("'<f4'", "False", "(4294967296, 4294967296)"), {"overflows"});
  dict_refused(with("'<f4'", "False", "(99999999999999999999,)"), {"overflows"});
  dict_refused("{'descr': '<f4', 'fortran_order': False}", {"missing"});
  dict_refused("{}", {"missing"});
  dict_refused("", {"'{'"});
  dict_refused("{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (1, 2)}",
               {"'descr'", "twice"});
  dict_refused("{'more': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (1, 2)}",
               {"more"});
  dict_refused(std::string(good_dict) + "import os", {"after the closing"});
  dict_refused("{'descr: 1", {"closing quote"});
  dict_refused("{descr: '<f4'}", {"a key in quotes"});
}

// A 2 x 1 x 1 x 1 x 1 BTF of uint8 with a JSON that says `text`.
void write_pair(const TemporaryFolder& folder, std::string_view text,
                std::string_view shape = "(2, 1, 1, 1, 1)", std::size_t bytes = 2) {
  write_bytes(folder / "a.npy",
              npy(fmt::format("{{'descr': '|u1', 'fortran_order': False, 'shape': {}, }}", shape),
                  std::string(bytes, 'd')));
  write_bytes(folder / "a.json", text);
}

TEST(NpyBtf, ReadsDirectionsInAllForms) {
  TemporaryFolder folder;
  for (const char* views :
       {R"([{"dir":[0,0,1]}, {"dir":[0.6,0,0.8],"theta":12,"phi":0}])", R"([[0,0,1],[0.6,0,0.8]])",
        R"([{"theta":0,"phi":0},{"theta":36.86989764584402,"phi":0,"name":"x"}])",
        R"([[0,0],[36.86989764584402,0]])"}) {
    write_pair(folder, fmt::format(R"({{"views":{},"lights":[[0,0]],"other":[1,{{}}]}})", views));
    const auto source = open_raw_btf(folder / "a.npy");
    const BtfInfo& info = source->info();
    EXPECT_EQ(info.encoding, Encoding::srgb);
    EXPECT_EQ(info.quantity, Quantity::radiance);
    EXPECT_EQ(info.layout, Layout::grid);
    ASSERT_EQ(info.view_directions.size(), 2u);
    EXPECT_NEAR(info.view_directions[1][0], 0.6, 1e-7);
    EXPECT_NEAR(info.view_directions[1][2], 0.8, 1e-7);
  }
}

TEST(NpyBtf, RefusesJsonThatDoesNotFit) {
  TemporaryFolder folder;
  const auto refused = [&](std::string_view text, std::initializer_list<std::string_view> parts) {
    SCOPED_TRACE(std::string(text.substr(0, 120)));
    write_pair(folder, text);
    expect_error(ErrorKind::input, {"a.json"}, [&] { open_npy_btf(folder / "a.npy"); });
    expect_error(ErrorKind::input, parts, [&] { open_npy_btf(folder / "a.npy"); });
  };
  const auto with = [](std::string_view more) {
    return fmt::format(R"({{"views":[[0,0],[30,0]],"lights":[[0,0]]{}}})", more);
  };
  write_pair(folder, with(""));
  EXPECT_NO_THROW(open_npy_btf(folder / "a.npy"));

  refused("", {"JSON"});
  refused("[]", {"object"});
  refused("{", {"JSON"});
  refused("{}", {"views"});
  refused(R"({"views":[[0,0],[30,0]]})", {"lights"});
  refused(R"({"views":{},"lights":[]})", {"views"});
  refused(R"({"views":[[0,0]],"lights":[[0,0]]})", {"view_directions", "1", "2"});
  refused(R"({"views":[[0,0],[1]],"lights":[[0,0]]})", {"views[1]"});
  refused(R"({"views":[[0,0],[0,0,1,0]],"lights":[[0,0]]})", {"views[1]"});
  refused(R"({"views":[[0,0],["a","b"]],"lights":[[0,0]]})", {"views[1]", "number"});
  refused(R"({"views":[[0,0],{"theta":1}],"lights":[[0,0]]})", {"views[1]"});
  refused(R"({"views":[[0,0],[0,0,2]],"lights":[[0,0]]})", {"view_directions[1]", "unit"});
  refused(R"({"views":[[0,0],[1e300,0,1]],"lights":[[0,0]]})", {"view_directions[1]"});
  refused(R"({"views":[[0,0],[1e999,0,1]],"lights":[[0,0]]})", {"JSON"});
  refused(with(R"(,"lights":[])"), {"lights", "twice"});
  refused(with(R"(,"encoding":"sRGB")"), {"encoding", "sRGB"});
  refused(with(R"(,"encoding":1)"), {"encoding"});
  refused(with(R"(,"quantity":"x")"), {"quantity"});
  refused(with(R"(,"layout":"paired")"), {"light_directions"});
  refused(with(R"(,"axes":["light","view","y","x","channel"])"), {"axes"});
  refused(with(R"(,"channel_names":["a","b"])"), {"channel names"});
  refused(with(R"(,"channel_names":[1])"), {"channel_names"});
  refused(with(R"(,"mask_runs":[1])"), {"mask_runs", "1 of the 2"});
  refused(with(R"(,"mask_runs":[1,2])"), {"mask_runs"});
  refused(with(R"(,"mask_runs":[-1,3])"), {"mask_runs"});
  refused(with(R"(,"mask_runs":[18446744073709551615,3])"), {"mask_runs"});
  refused(with(",\"source\":\"\xff\""), {"JSON"});
  std::string deep = R"({"views":)";
  for (int i = 0; i < 1000000; ++i) deep += "[";
  refused(deep, {"deeper"});
}

TEST(NpyBtf, RefusesOtherShapesAndAMissingJson) {
  TemporaryFolder folder;
  write_pair(folder, "{}", "(2, 1)");
  expect_error(ErrorKind::input, {"a.npy", "2 modes"}, [&] { open_npy_btf(folder / "a.npy"); });
  write_pair(folder, R"({"views":[],"lights":[]})", "(0, 0, 0, 0, 0)", 0);
  expect_error(ErrorKind::input, {"[0, 0, 0, 0, 0]"}, [&] { open_npy_btf(folder / "a.npy"); });
  write_pair(folder, "{}");
  std::filesystem::remove(folder / "a.json");
  expect_error(ErrorKind::input, {"a.json"}, [&] { open_npy_btf(folder / "a.npy"); });
  expect_error(ErrorKind::input, {"b.json"}, [&] { create_npy_btf(folder / "b.json", {}); });
}

TEST(NpyBtf, ValuesThatLieUnalignedAreReadButNotMapped) {
  TemporaryFolder folder;
  std::string dict = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 1, 2, 1)}";
  while ((10 + dict.size()) % 4 != 1) dict += ' ';
  write_bytes(folder / "a.npy", npy(dict, "12345678"));
  write_bytes(folder / "a.json", R"({"views":[[0,0]],"lights":[[0,0]]})");
  const auto source = open_raw_btf(folder / "a.npy");
  EXPECT_TRUE(source->mapped(0, 1).empty());
  std::string values(8, '\0');
  source->read(0, 1, std::as_writable_bytes(std::span(values)));
  EXPECT_EQ(values, "12345678");
}

}  // namespace
}  // namespace weft
