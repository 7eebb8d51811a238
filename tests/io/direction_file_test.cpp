#include "weft/io/direction_file.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <string>

#include "io/file_bytes.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

constexpr auto views = DirectionRole::views;
constexpr auto lights = DirectionRole::lights;

// As NumPy writes it, doubles too.
template <typename T>
std::string npy_bytes(DType dtype, const std::vector<std::size_t>& shape,
                      const std::vector<T>& values) {
  std::string bytes = make_npy_header(dtype == DType::f64 ? DType::f32 : dtype, shape);
  if (dtype == DType::f64) bytes.replace(bytes.find("<f4"), 3, "<f8");
  bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  return bytes;
}

TEST(DirectionFile, NamesOfUsualSets) {
  EXPECT_EQ(read_direction_set("ubo81", views, "--view-set"), ubo81_directions());
  EXPECT_EQ(read_direction_set("17", lights, "--light-set"), even_directions(17));
  expect_error(ErrorKind::input, {"--light-set", "'many'"},
               [] { read_direction_set("many", lights, "--light-set"); });
}

TEST(DirectionFile, GridsOfAngles) {
  const std::vector<Direction> grid = read_direction_set("grid:4x6:60", views, "--view-set");
  ASSERT_EQ(grid.size(), 1u + 3 * 6);
  EXPECT_EQ(grid[0], (Direction{0, 0, 1}));
  EXPECT_NEAR(theta_degrees(grid[1]), 20, 1e-5);
  EXPECT_NEAR(theta_degrees(grid[18]), 60, 1e-5);
  EXPECT_NEAR(phi_degrees(grid[18]), 300, 1e-4);
  EXPECT_EQ(read_direction_set("grid:1x5", views, "--view-set").size(), 1u);
  EXPECT_NEAR(theta_degrees(read_direction_set("grid:2x1", views, "-")[1]), 75, 1e-5);
  for (const std::string bad :
       {"grid:", "grid:4", "grid:4x", "grid:0x3", "grid:4x6:", "grid:4x6:91", "grid:4x6:0",
        "grid:4x6:nan", "grid:-4x6", "grid:9999999x1"}) {
    expect_error(ErrorKind::input, {"--view-set", bad},
                 [&] { read_direction_set(bad, views, "--view-set"); });
  }
}

TEST(DirectionFile, FilesOfDirections) {
  const TemporaryFolder folder;
  const auto read = [&](const char* name, DirectionRole role) {
    return read_direction_set((folder / name).string(), role, "--view-set");
  };
  write_bytes(folder / "both.json",
              R"({"views": [[0, 0, 1]], "lights": [{"theta": 30, "phi": 90}, [0.6, 0, 0.8]]})");
  EXPECT_EQ(read("both.json", views), (std::vector<Direction>{{0, 0, 1}}));
  EXPECT_EQ(read("both.json", lights).size(), 2u);
  write_bytes(folder / "list.json", R"([[0, 0], [45, 180]])");
  EXPECT_EQ(read("list.json", lights).size(), 2u);
  write_bytes(folder / "v.npy", npy_bytes<float>(DType::f32, {2, 3}, {0, 0, 1, 0.6f, 0, 0.8f}));
  EXPECT_EQ(read("v.npy", views)[1][0], 0.6f);
  write_bytes(folder / "a.npy", npy_bytes<double>(DType::f64, {2, 2}, {0, 0, 60, 90}));
  EXPECT_NEAR(theta_degrees(read("a.npy", views)[1]), 60, 1e-5);
  const auto data = random_source({3, 5, 1, 1, 1}, DType::u8, 1);
  const auto sink = create_raw_btf(folder / "raw.safetensors", data->info());
  sink->write(0, 15, data->bytes());
  sink->finish();
  EXPECT_EQ(read("raw.safetensors", views).size(), 3u);
  EXPECT_EQ(read("raw.safetensors", lights).size(), 5u);
}

TEST(DirectionFile, BadFilesAreNamed) {
  const TemporaryFolder folder;
  const auto refused = [&](const char* name, const std::string& bytes, std::string_view part) {
    write_bytes(folder / name, bytes);
    expect_error(ErrorKind::input, {name, part},
                 [&] { read_direction_set((folder / name).string(), lights, "--light-set"); });
  };
  refused("a.json", "{", "");
  refused("a.json", "3", "neither a list");
  refused("a.json", "{\"views\": []}", "lights");
  refused("a.json", "[]", "no directions");
  refused("a.json", "[[0, 0, 2]]", "direction 0");
  refused("a.json", "[[0, 0, 1], [0, 0, 0]]", "direction 1");
  refused("a.json", "[[1, 2, 3, 4]]", "lights[0]");
  refused("a.npy", "", "");
  refused("a.npy", npy_bytes<float>(DType::f32, {3}, {0, 0, 1}), "[n, 3]");
  refused("a.npy", npy_bytes<float>(DType::f32, {1, 4}, {0, 0, 1, 0}), "[n, 3]");
  refused("a.npy", npy_bytes<float>(DType::f32, {0, 3}, {}), "");
  refused("a.npy", npy_bytes<unsigned char>(DType::u8, {1, 3}, {0, 0, 1}), "float32");
  refused("a.npy", npy_bytes<float>(DType::f32, {2, 3}, {0, 0, 1}), "");
  refused("a.npy", npy_bytes<double>(DType::f64, {1, 3}, {0, std::stod("nan"), 1}), "direction 0");
  expect_error(ErrorKind::input, {"absent.json"}, [&] {
    read_direction_set((folder / "absent.json").string(), lights, "--light-set");
  });
}

}  // namespace
}  // namespace weft::test
