// What trade-off runs have measured, and its files: results.json, from which a stopped run goes on,
// and results.csv.
#pragma once

#include <cstddef>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "tradeoff/grid.hpp"
#include "weft/btf/btf.hpp"

namespace weft {

// One of the images that stand for a material.
struct ShownImage {
  std::size_t view = 0;
  std::size_t light = 0;
  // theta and phi of view and light, degrees
  double view_theta = 0, view_phi = 0, light_theta = 0, light_phi = 0;
};

struct TradeoffMaterial {
  std::string name;  // unique
  std::string path;  // as given
  std::string checksum;
  std::size_t bytes = 0;  // of the file
  BtfShape shape;
  std::string dtype;
  std::string encoding;
  std::vector<ShownImage> images;
  // of the rendered sphere, stops; NaN before it is rendered
  double exposure = std::numeric_limits<double>::quiet_NaN();
};

// Numbers by the name of their column; what is not known is absent.
using Figures = std::map<std::string, double, std::less<>>;

struct MeasuredPoint {
  std::string key;       // of material, options and program version: equal keys, equal work
  std::string material;  // its name
  TradeoffPoint point;
  std::string command;  // that makes the model
  int status = 0;       // of that command; 128 + N for signal N
  std::string message;  // why it failed, or what else could not be measured
  Figures figures;
  std::string parameters;  // as the codec chose them, JSON
  std::string notes;
  std::vector<ShownImage> images;  // of a model of a part, numbered within it; else the material's

  // Whether measuring it again could give something else: not of what was done, of a goal that
  // can't be met, or of options that are refused.
  bool settled() const { return status >= 0 && status <= 2; }
};

struct TradeoffResults {
  std::string program_version;
  std::string device;
  std::vector<TradeoffMaterial> materials;
  std::vector<MeasuredPoint> points;

  const MeasuredPoint* find(std::string_view key) const;
  // Replaces the point of that key, or adds it.
  void put(MeasuredPoint point);
};

// A column of figures: results.csv, and "figures" in results.json.
struct FigureColumn {
  std::string_view name;
  std::string_view unit;
};
// In the order of the CSV file.
const std::vector<FigureColumn>& figure_columns();

nlohmann::json to_json(const TradeoffResults& results);

// Empty if there is no such file. Throws an input error that names the file and the field for
// anything that save_results did not write.
TradeoffResults load_results(const std::filesystem::path& path);
void save_results(const std::filesystem::path& path, const TradeoffResults& results);

// RFC 4180, a line per point: material, codec, options, status, message, and the figures.
void save_csv(const std::filesystem::path& path, const TradeoffResults& results);

// Replaces a file whole or not at all.
void save_text(const std::filesystem::path& path, std::string_view text);

}  // namespace weft
