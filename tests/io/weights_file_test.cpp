// Weights from the command line: cos, NPY files, and every way in which they may be wrong.
#include "weft/io/weights_file.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "io/file_bytes.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/temporary_folder.hpp"

namespace weft {
namespace {

using test::expect_error;
using test::make_info;
using test::TemporaryFolder;
using test::write_bytes;

// An NPY file of version 1.0.
template <typename T>
void write_npy(const std::filesystem::path& path, const std::string& descr,
               const std::string& shape, const std::vector<T>& values) {
  const std::string dict =
      "{'descr': '" + descr + "', 'fortran_order': False, 'shape': " + shape + ", }\n";
  std::string bytes("\x93NUMPY\1\0", 8);
  bytes += {static_cast<char>(dict.size()), '\0'};
  bytes += dict;
  const std::size_t begin = bytes.size();
  bytes.resize(begin + values.size() * sizeof(T));
  std::memcpy(bytes.data() + begin, values.data(), values.size() * sizeof(T));
  write_bytes(path, bytes);
}

class WeightsFile : public testing::Test {
 protected:
  std::string at(const char* name) const { return (folder_ / name).string(); }
  BtfInfo info_ = make_info({3, 2, 2, 2, 1});

 private:
  TemporaryFolder folder_;
};

TEST_F(WeightsFile, ReadsEveryType) {
  write_npy<double>(at("v.npy"), "<f8", "(3,)", {1, 1e-3, 0});
  write_npy<float>(at("l.npy"), "<f4", "(2,)", {0.25f, 4});
  write_npy<std::uint8_t>(at("t.npy"), "|u1", "(2, 2)", {1, 2, 3, 255});
  const Weights weights = read_weights(
      "views=" + at("v.npy") + ",texels=" + at("t.npy") + ",lights=" + at("l.npy"), info_);
  EXPECT_EQ(weights.views, (std::vector<double>{1, 1e-3, 0}));
  EXPECT_EQ(weights.lights, (std::vector<double>{0.25, 4}));
  EXPECT_EQ(weights.texels, (std::vector<double>{1, 2, 3, 255}));
  write_npy<std::uint16_t>(at("h.npy"), "<f2", "(2,)", {0x3c00, 0x4000});
  EXPECT_EQ(read_weights("lights=" + at("h.npy"), info_).lights, (std::vector<double>{1, 2}));
}

TEST_F(WeightsFile, CosineIsMultipliedWithFiles) {
  write_npy<double>(at("v.npy"), "<f8", "(3,)", {1, 2, 3});
  const Weights cosines = read_weights("cos", info_);
  const Weights both = read_weights("cos,views=" + at("v.npy"), info_);
  for (std::size_t v = 0; v < 3; ++v) {
    EXPECT_EQ(both.views[v], cosines.views[v] * static_cast<double>(v + 1));
  }
}

TEST_F(WeightsFile, BadValuesAreNamed) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double bad : {-1.0, nan, infinity, 1e10, 1e-10}) {
    write_npy<double>(at("v.npy"), "<f8", "(3,)", {1, bad, 1});
    expect_error(ErrorKind::input, {"--weights", "v.npy", "view 1"},
                 [&] { read_weights("views=" + at("v.npy"), info_); });
  }
  write_npy<double>(at("t.npy"), "<f8", "(2, 2)", {1, 1, -0.5, 1});
  expect_error(ErrorKind::input, {"t.npy", "-0.5", "row 1, column 0"},
               [&] { read_weights("texels=" + at("t.npy"), info_); });
  write_npy<double>(at("z.npy"), "<f8", "(2,)", {0, 0});
  expect_error(ErrorKind::input, {"z.npy", "all lights", "zero"},
               [&] { read_weights("lights=" + at("z.npy"), info_); });
}

TEST_F(WeightsFile, WrongShapesAreNamed) {
  write_npy<float>(at("two.npy"), "<f4", "(2,)", {1, 1});
  expect_error(ErrorKind::input, {"two.npy", "(2,)", "(3,)", "views"},
               [&] { read_weights("views=" + at("two.npy"), info_); });
  write_npy<float>(at("flat.npy"), "<f4", "(4,)", {1, 1, 1, 1});
  expect_error(ErrorKind::input, {"flat.npy", "(4,)", "(2, 2)", "texels"},
               [&] { read_weights("texels=" + at("flat.npy"), info_); });
}

TEST_F(WeightsFile, OtherTextIsRefused) {
  for (const char* text : {"", "cosine", "cos,", "views", "views=", "rows=a.npy", "cos,cos",
                           "cos,,views=a.npy", "COS"}) {
    expect_error(ErrorKind::input, {"--weights"}, [&] { read_weights(text, info_); });
  }
  expect_error(ErrorKind::input, {"absent.npy"},
               [&] { read_weights("views=" + at("absent.npy"), info_); });
  write_bytes(at("no.npy"), std::string("no array"));
  expect_error(ErrorKind::input, {"no.npy"}, [&] { read_weights("views=" + at("no.npy"), info_); });
  BtfInfo paired = make_info({3, 1, 2, 2, 1});
  paired.layout = Layout::paired;
  write_npy<float>(at("one.npy"), "<f4", "(1,)", {1});
  expect_error(ErrorKind::input, {"paired"},
               [&] { read_weights("lights=" + at("one.npy"), paired); });
}

TEST_F(WeightsFile, TextOfAModelSaysWhatWasGiven) {
  const Weights weights{{1, 2}, {}, {}};
  const std::string json = weights_json("cos,views=some/where/v.npy", weights);
  EXPECT_EQ(given_weights(json, "here"), "cos,views=v.npy");
  EXPECT_EQ(json, weights_json("cos,views=v.npy", weights));
  EXPECT_NE(json, weights_json("cos,views=v.npy", {{1, 3}, {}, {}}));
  EXPECT_NE(json, weights_json("cos,views=v.npy", {{}, {}, {1, 2}}));
  for (const char* text : {"", "[]", "{}", R"({"given":1})"}) {
    expect_error(ErrorKind::input, {"here"}, [&] { given_weights(text, "here"); });
  }
}

}  // namespace
}  // namespace weft
