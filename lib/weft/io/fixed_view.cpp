#include "weft/io/fixed_view.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/mapped_file.hpp"

namespace weft {
namespace {

constexpr std::size_t largest_text = std::size_t{64} << 20;

// The numbers of one line.
std::vector<double> parse_numbers(std::string_view line, const std::string& where) {
  constexpr std::string_view separators = " \t\r,";
  line = line.substr(0, line.find('#'));
  std::vector<double> numbers;
  while (true) {
    const std::size_t first = line.find_first_not_of(separators);
    if (first == std::string_view::npos) return numbers;
    line.remove_prefix(first);
    const std::string_view word = line.substr(0, line.find_first_of(separators));
    double value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(value)) {
      fail_input("{}: '{}' is not a number", where, shown(word));
    }
    numbers.push_back(value);
    line.remove_prefix(word.size());
  }
}

double length_of(const std::array<double, 3>& vector) {
  return std::hypot(vector[0], vector[1], vector[2]);
}

// The one image that is named as a mask is taken out of the list.
std::optional<std::size_t> take_mask(const ImageCollection& collection,
                                     std::vector<std::size_t>& images) {
  const auto first_mask = std::stable_partition(
      images.begin(), images.end(),
      [&](std::size_t file) { return !is_mask_name(collection.files()[file]); });
  const auto count = images.end() - first_mask;
  if (count > 1) {
    fail_input("{}: {} images are named as masks, for example {} and {}; one can be used",
               collection.path().string(), count, collection.shown_name(*first_mask),
               collection.shown_name(*(first_mask + 1)));
  }
  std::optional<std::size_t> mask;
  if (count == 1) mask = *first_mask;
  images.erase(first_mask, images.end());
  return mask;
}

void check_count(const ImageCollection& collection, std::size_t images, std::size_t lines,
                 const std::string& where) {
  if (images != lines) {
    fail_input("{}: {} directions for {} images in {}", where, lines, images,
               collection.path().string());
  }
}

// The capture of images in natural order, everything but sizes and encoding being in `info`.
Capture make_capture(std::shared_ptr<ImageCollection> collection, std::vector<std::size_t> images,
                     const std::optional<std::size_t>& mask, BtfInfo info, std::string kind) {
  const ImageInfo first = collection->info_of(images.front());
  info.encoding = usual_encoding(first.dtype);
  if (mask) info.mask = read_mask_image(*collection, *mask, first, info.shape.views);
  Capture capture;
  capture.kind = std::move(kind);
  capture.source =
      std::make_shared<ImageSource>(std::move(collection), std::move(images), std::move(info));
  return capture;
}

struct Positions {
  std::vector<Direction> directions;
  double nearest = std::numeric_limits<double>::infinity();
  double farthest = 0;
};

Positions read_positions(ImageCollection& collection, const char* name) {
  const std::optional<std::size_t> file = collection.find(name);
  if (!file) fail_input("{}: no {}", collection.path().string(), name);
  const std::string where = collection.shown_name(*file);
  const auto vectors = parse_vectors(collection.text(*file), where);
  Positions positions;
  for (std::size_t i = 0; i < vectors.size(); ++i) {
    const std::string line = fmt::format("{}: position {}", where, i);
    if (!(vectors[i][2] > 0)) fail_input("{}: z = {} is not above the sample", line, vectors[i][2]);
    positions.directions.push_back(
        unit_direction(vectors[i], std::numeric_limits<double>::infinity(), line));
    positions.nearest = std::min(positions.nearest, length_of(vectors[i]));
    positions.farthest = std::max(positions.farthest, length_of(vectors[i]));
  }
  return positions;
}

}  // namespace

std::vector<std::array<double, 3>> parse_vectors(std::string_view text, const std::string& where) {
  std::vector<std::array<double, 3>> vectors;
  std::optional<double> count;
  for (std::size_t line_number = 1; !text.empty(); ++line_number) {
    const std::size_t end = text.find('\n');
    const std::string line_name = fmt::format("{}:{}", where, line_number);
    const std::vector<double> numbers = parse_numbers(text.substr(0, end), line_name);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (numbers.empty()) continue;
    if (numbers.size() == 1 && vectors.empty() && !count) {
      count = numbers[0];
    } else if (numbers.size() == 3) {
      vectors.push_back({numbers[0], numbers[1], numbers[2]});
    } else {
      fail_input("{}: {} numbers where 3 are expected", line_name, numbers.size());
    }
  }
  if (vectors.empty()) fail_input("{}: no vectors", where);
  if (count && *count != static_cast<double>(vectors.size())) {
    fail_input("{}: {} vectors where {} are announced", where, vectors.size(), *count);
  }
  return vectors;
}

std::vector<Direction> parse_directions(std::string_view text, const std::string& where) {
  const auto vectors = parse_vectors(text, where);
  std::vector<Direction> directions;
  for (std::size_t i = 0; i < vectors.size(); ++i) {
    directions.push_back(
        unit_direction(vectors[i], 1e-3, fmt::format("{}: direction {}", where, i)));
  }
  return directions;
}

Direction unit_direction(const std::array<double, 3>& vector, double tolerance,
                         const std::string& where) {
  const double length = length_of(vector);
  if (!(length > 0) || !(std::abs(length - 1) <= tolerance)) {
    fail_input("{}: ({}, {}, {}) is no unit vector", where, vector[0], vector[1], vector[2]);
  }
  // Rounding each component to float changes the length by less than this.
  constexpr double rounding = 0x1p-22;
  const double scale = std::abs(length - 1) <= rounding ? 1 : 1 / length;
  return {static_cast<float>(vector[0] * scale), static_cast<float>(vector[1] * scale),
          static_cast<float>(vector[2] * scale)};
}

std::string read_text(const std::filesystem::path& path) {
  const MappedFile file(path);
  const auto bytes = file.bytes();
  if (bytes.size() > largest_text) {
    fail_input("{}: {} bytes, more than the {} that a text may have", path.string(), bytes.size(),
               largest_text);
  }
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

Capture open_fixed_view(std::shared_ptr<ImageCollection> collection,
                        const std::filesystem::path& lights_file) {
  // Read the lights.
  std::string text, where;
  if (!lights_file.empty()) {
    text = read_text(lights_file);
    where = lights_file.string();
  } else {
    const std::optional<std::size_t> file = collection->find("lights.txt");
    if (!file) fail_input("{}: no lights.txt", collection->path().string());
    text = collection->text(*file);
    where = collection->shown_name(*file);
  }
  BtfInfo info;
  info.light_directions = parse_directions(text, where);
  info.view_directions = {Direction{0, 0, 1}};
  info.shape.views = 1;
  info.shape.lights = info.light_directions.size();
  info.source = collection->path().filename().string();
  // Put them beside the images.
  std::vector<std::size_t> images = collection->images();
  const std::optional<std::size_t> mask = take_mask(*collection, images);
  check_count(*collection, images.size(), info.shape.lights, where);
  return make_capture(std::move(collection), std::move(images), mask, std::move(info), "lights");
}

Capture open_flash(std::shared_ptr<ImageCollection> collection) {
  Positions cameras = read_positions(*collection, "camera_pos.txt");
  Positions lights = read_positions(*collection, "light_pos.txt");
  std::vector<std::size_t> images = collection->images();
  const std::optional<std::size_t> mask = take_mask(*collection, images);
  const std::string folder = collection->path().string();
  check_count(*collection, images.size(), cameras.directions.size(), folder + "/camera_pos.txt");
  check_count(*collection, images.size(), lights.directions.size(), folder + "/light_pos.txt");
  BtfInfo info;
  info.layout = Layout::paired;
  info.shape.views = images.size();
  info.shape.lights = 1;
  info.source = fmt::format(
      "{}: near field, directions at the sample's centre, cameras {:.4g} to {:.4g} and lights "
      "{:.4g} to {:.4g} units away",
      collection->path().filename().string(), cameras.nearest, cameras.farthest, lights.nearest,
      lights.farthest);
  info.view_directions = std::move(cameras.directions);
  info.light_directions = std::move(lights.directions);
  return make_capture(std::move(collection), std::move(images), mask, std::move(info), "flash");
}

}  // namespace weft
