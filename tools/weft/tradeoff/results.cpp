#include "tradeoff/results.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/atomic_file.hpp"
#include "weft/io/json_text.hpp"

namespace weft {
namespace {

using nlohmann::json;

constexpr int format_version = 1;
constexpr std::string_view format_name = "weft tradeoff";

// As reports write them: JSON has no infinities.
json number_json(double value) {
  if (std::isfinite(value)) return value;
  if (std::isnan(value)) return "nan";
  return value > 0 ? "inf" : "-inf";
}

double number_of(const json& value) {
  if (!value.is_string()) return value.get<double>();
  if (value == "inf") return std::numeric_limits<double>::infinity();
  if (value == "-inf") return -std::numeric_limits<double>::infinity();
  return std::numeric_limits<double>::quiet_NaN();
}

json to_json(const std::vector<ShownImage>& list) {
  json images = json::array();
  for (const ShownImage& image : list) {
    images.push_back({{"view", image.view},
                      {"light", image.light},
                      {"view_direction", {image.view_theta, image.view_phi}},
                      {"light_direction", {image.light_theta, image.light_phi}}});
  }
  return images;
}

std::vector<ShownImage> images_of(const json& list) {
  std::vector<ShownImage> images;
  for (const json& image : list) {
    const json& view = image.at("view_direction");
    const json& light = image.at("light_direction");
    images.push_back(
        {image.at("view"), image.at("light"), view.at(0), view.at(1), light.at(0), light.at(1)});
  }
  return images;
}

json to_json(const TradeoffMaterial& material) {
  const BtfShape& s = material.shape;
  return {{"name", material.name},
          {"path", material.path},
          {"checksum", material.checksum},
          {"bytes", material.bytes},
          {"shape", {s.views, s.lights, s.height, s.width, s.channels}},
          {"dtype", material.dtype},
          {"encoding", material.encoding},
          {"images", to_json(material.images)},
          {"exposure", number_json(material.exposure)}};
}

TradeoffMaterial material_of(const json& value) {
  TradeoffMaterial material;
  material.name = value.at("name");
  material.path = value.at("path");
  material.checksum = value.at("checksum");
  material.bytes = value.at("bytes");
  const json& shape = value.at("shape");
  material.shape = {shape.at(0), shape.at(1), shape.at(2), shape.at(3), shape.at(4)};
  material.dtype = value.at("dtype");
  material.encoding = value.at("encoding");
  material.exposure = number_of(value.at("exposure"));
  material.images = images_of(value.at("images"));
  return material;
}

json to_json(const MeasuredPoint& point) {
  json figures = json::object();
  for (const auto& [name, value] : point.figures) figures[name] = number_json(value);
  json object = {{"key", point.key},           {"material", point.material},
                 {"codec", point.point.codec}, {"options", point.point.options},
                 {"command", point.command},   {"status", point.status},
                 {"message", point.message},   {"figures", std::move(figures)},
                 {"notes", point.notes}};
  if (!point.images.empty()) object["images"] = to_json(point.images);
  if (!point.parameters.empty()) object["parameters"] = json::parse(point.parameters);
  return object;
}

MeasuredPoint point_of(const json& value) {
  MeasuredPoint point;
  point.key = value.at("key");
  point.material = value.at("material");
  point.point.codec = value.at("codec");
  point.point.options = value.at("options").get<std::vector<std::string>>();
  point.command = value.at("command");
  point.status = value.at("status");
  point.message = value.at("message");
  point.notes = value.at("notes");
  for (const auto& [name, figure] : value.at("figures").items()) {
    point.figures[name] = number_of(figure);
  }
  if (value.contains("images")) point.images = images_of(value.at("images"));
  if (value.contains("parameters")) point.parameters = value.at("parameters").dump();
  return point;
}

std::string csv_field(std::string_view text) {
  if (text.find_first_of(",\"\r\n") == std::string_view::npos) return std::string(text);
  std::string field = "\"";
  for (const char c : text) field += c == '"' ? std::string("\"\"") : std::string(1, c);
  return field + "\"";
}

}  // namespace

const std::vector<FigureColumn>& figure_columns() {
  static const std::vector<FigureColumn> columns{
      {"file_size", "bytes"},
      {"raw_size", "bytes"},
      {"ratio", ""},
      {"rmse", ""},
      {"psnr", "dB"},
      {"psnr_peak", ""},
      {"snr", "dB"},
      {"relative", ""},
      {"max_error", ""},
      {"ssim", ""},
      {"lowest_ssim", ""},
      {"weighted_rmse", ""},
      {"weighted_psnr", "dB"},
      {"weighted_snr", "dB"},
      {"weighted_relative", ""},
      {"log_rmse", ""},
      {"log_snr", "dB"},
      {"encode_time", "s"},
      {"time", "s"},
      {"image_rate", "images/s"},
      {"texel_rate", "texels/s"},
      {"lookup_rate", "/s"},
      {"sorted_lookup_rate", "/s"},
      {"texel_time", "ms"},
      {"peak_memory", "bytes"},
  };
  return columns;
}

const MeasuredPoint* TradeoffResults::find(std::string_view key) const {
  const auto at = std::ranges::find(points, key, &MeasuredPoint::key);
  return at == points.end() ? nullptr : &*at;
}

void TradeoffResults::put(MeasuredPoint point) {
  const auto at = std::ranges::find(points, point.key, &MeasuredPoint::key);
  if (at != points.end()) {
    *at = std::move(point);
  } else {
    points.push_back(std::move(point));
  }
}

json to_json(const TradeoffResults& results) {
  json materials = json::array();
  for (const TradeoffMaterial& material : results.materials) materials.push_back(to_json(material));
  json points = json::array();
  for (const MeasuredPoint& point : results.points) points.push_back(to_json(point));
  return {{"format", format_name},
          {"format_version", format_version},
          {"program_version", results.program_version},
          {"device", results.device},
          {"materials", std::move(materials)},
          {"points", std::move(points)}};
}

TradeoffResults load_results(const std::filesystem::path& path) {
  if (!std::filesystem::exists(path)) return {};
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  if (!file) fail_input("{}: cannot be read", path.string());
  const json value = parse_json(text, path.string());
  try {
    if (value.at("format") != format_name || value.at("format_version") != format_version) {
      fail_input("{}: not of 'weft tradeoff', format version {}", path.string(), format_version);
    }
    TradeoffResults results;
    results.program_version = value.at("program_version");
    results.device = value.at("device");
    for (const json& material : value.at("materials")) {
      results.materials.push_back(material_of(material));
    }
    for (const json& point : value.at("points")) results.points.push_back(point_of(point));
    return results;
  } catch (const json::exception& error) {
    fail_input("{}: not written by 'weft tradeoff': {}", path.string(), shown(error.what(), 200));
  }
}

void save_text(const std::filesystem::path& path, std::string_view text) {
  AtomicFile file(path);
  file.write(std::as_bytes(std::span(text.data(), text.size())));
  file.commit();
}

void save_results(const std::filesystem::path& path, const TradeoffResults& results) {
  save_text(path, to_json(results).dump(1, ' ', false, json::error_handler_t::replace) + "\n");
}

void save_csv(const std::filesystem::path& path, const TradeoffResults& results) {
  std::string text = "material,codec,options,status,message";
  for (const FigureColumn& column : figure_columns()) text += fmt::format(",{}", column.name);
  text += "\r\n";
  for (const MeasuredPoint& point : results.points) {
    text += fmt::format("{},{},{},{},{}", csv_field(point.material), csv_field(point.point.codec),
                        csv_field(join_words(point.point.options)), point.status,
                        csv_field(point.message));
    for (const FigureColumn& column : figure_columns()) {
      const auto figure = point.figures.find(column.name);
      text += figure == point.figures.end() ? "," : fmt::format(",{}", figure->second);
    }
    text += "\r\n";
  }
  save_text(path, text);
}

}  // namespace weft
