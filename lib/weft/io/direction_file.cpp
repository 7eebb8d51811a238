#include "weft/io/direction_file.hpp"

#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>

#include "weft/error.hpp"
#include "weft/io/btf_json.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/mapped_file.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft {
namespace {

constexpr std::size_t largest_count = 1'000'000;
constexpr std::string_view grid_prefix = "grid:";
constexpr double usual_theta = 75;

// What stands in `text` before `mark`, which goes with it; all of it where there is none.
std::string_view take_until(std::string_view& text, char mark) {
  const std::size_t end = text.find(mark);
  const std::string_view part = text.substr(0, end);
  text = end == std::string_view::npos ? std::string_view{} : text.substr(end + 1);
  return part;
}

template <typename T>
bool parse_whole(std::string_view text, T& value) {
  const char* const end = text.data() + text.size();
  const auto [stop, status] = std::from_chars(text.data(), end, value);
  return status == std::errc{} && stop == end && !text.empty();
}

std::vector<Direction> grid_of_angles(std::string_view text, std::string_view option) {
  std::string_view rest = text.substr(grid_prefix.size());
  const bool has_largest = rest.find(':') != std::string_view::npos;
  std::string_view sizes = take_until(rest, ':');
  const std::string_view thetas_text = take_until(sizes, 'x');
  std::size_t thetas = 0, phis = 0;
  double largest = usual_theta;
  if (!parse_whole(thetas_text, thetas) || !parse_whole(sizes, phis) || thetas < 1 || phis < 1 ||
      thetas > largest_count || phis > largest_count || thetas * phis > largest_count ||
      (has_largest && !parse_whole(rest, largest)) || !(largest > 0) || largest > 90) {
    fail_input(
        "{}: '{}' is not grid:THETASxPHIS or grid:THETASxPHIS:MAX, as grid:6x24:75, with at most "
        "{} directions up to 90 degrees",
        option, text, largest_count);
  }
  std::vector<Direction> directions{direction_from_degrees(0, 0)};
  for (std::size_t t = 1; t < thetas; ++t) {
    for (std::size_t p = 0; p < phis; ++p) {
      directions.push_back(
          direction_from_degrees(largest * static_cast<double>(t) / static_cast<double>(thetas - 1),
                                 360.0 * static_cast<double>(p) / static_cast<double>(phis)));
    }
  }
  return directions;
}

std::vector<Direction> read_json(const std::filesystem::path& path, DirectionRole role) {
  const std::string where = path.string();
  const MappedFile file(path);
  const nlohmann::json root =
      parse_json({reinterpret_cast<const char*>(file.bytes().data()), file.bytes().size()}, where);
  const char* key = role == DirectionRole::views ? "views" : "lights";
  if (root.is_array()) return read_directions({{key, root}}, key, where);
  if (!root.is_object()) fail_input("{}: neither a list of directions nor an object", where);
  return read_directions(root, key, where);
}

std::vector<Direction> read_npy(const std::filesystem::path& path) {
  const std::string where = path.string();
  const NpyHeader header = read_npy_header(path);
  const bool is_float = header.dtype == DType::f32 || header.dtype == DType::f64;
  if (header.shape.size() != 2 || header.shape[0] > largest_count ||
      (header.shape[1] != 2 && header.shape[1] != 3) || !is_float) {
    fail_input("{}: not directions [n, 3] or [n, 2] (theta, phi in degrees) of float32 or float64",
               where);
  }
  const MappedFile file(path);
  const std::size_t size = size_of(header.dtype), columns = header.shape[1];
  if (file.bytes().size() < header.data_offset + header.shape[0] * columns * size) {
    fail_input("{}: changed while it was opened", where);
  }
  const auto value = [&](std::size_t i) {
    const std::byte* at = file.bytes().data() + header.data_offset + i * size;
    if (header.dtype == DType::f64) {
      double x = 0;
      std::memcpy(&x, at, sizeof x);
      return x;
    }
    float x = 0;
    std::memcpy(&x, at, sizeof x);
    return static_cast<double>(x);
  };
  std::vector<Direction> directions;
  for (std::size_t i = 0; i < header.shape[0]; ++i) {
    if (columns == 2) {
      directions.push_back(direction_from_degrees(value(2 * i), value(2 * i + 1)));
    } else {
      directions.push_back({static_cast<float>(value(3 * i)), static_cast<float>(value(3 * i + 1)),
                            static_cast<float>(value(3 * i + 2))});
    }
  }
  return directions;
}

// Vectors a little off unit length are brought to it; others are a mistake.
void make_unit(std::vector<Direction>& directions, const std::string& where) {
  if (directions.empty()) fail_input("{}: no directions", where);
  for (std::size_t i = 0; i < directions.size(); ++i) {
    Direction& d = directions[i];
    const double length = std::hypot(double{d[0]}, double{d[1]}, double{d[2]});
    if (!(std::abs(length - 1) <= 1e-3)) {
      fail_input("{}: direction {} is ({:.6g}, {:.6g}, {:.6g}): no unit vector", where, i, d[0],
                 d[1], d[2]);
    }
    for (float& x : d) x = static_cast<float>(x / length);
  }
}

}  // namespace

std::vector<Direction> read_direction_set(const std::string& text, DirectionRole role,
                                          std::string_view option) {
  if (text.starts_with(grid_prefix)) return grid_of_angles(text, option);
  const std::filesystem::path path(text);
  const std::string ending = path.extension().string();
  std::vector<Direction> directions;
  if (ending == ".json") {
    directions = read_json(path, role);
  } else if (ending == ".npy") {
    directions = read_npy(path);
  } else if (ending == ".safetensors") {
    const std::shared_ptr<TileSource> btf = open_raw_btf(path);
    directions =
        role == DirectionRole::views ? btf->info().view_directions : btf->info().light_directions;
  } else {
    return direction_set(text, option);
  }
  make_unit(directions, text);
  return directions;
}

}  // namespace weft
