// Measures one point of a trade-off in processes of its own: `compress`, `bench --model`, and for
// the pictures `sheet` and `render`.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "tradeoff/results.hpp"

namespace weft {

struct MeasureSettings {
  std::filesystem::path folder;  // of the whole run; models and images lie in folders below it
  bool keep_models = false;
  bool pictures = true;
  std::size_t repeat = 2;
  std::size_t lookups = 1'000'000;
  double time_limit = 0;  // seconds per process, 0 for none
};

// What a material is, without measuring anything. Throws an input error that names the file.
TradeoffMaterial describe_material(const std::string& path, std::string name);

// Draws a material's own pictures where they are missing, and sets its exposure. What can't be
// drawn is left out: the message says why.
std::string draw_material(TradeoffMaterial& material, const MeasureSettings& settings);

std::string key_of(const TradeoffMaterial& material, const TradeoffPoint& point);

// `device` is set to the name of the device that encoded, unless that was the reference. Throws
// only where the user interrupts, or where the folder can't be written to.
MeasuredPoint measure_point(const TradeoffMaterial& material, const TradeoffPoint& point,
                            const MeasureSettings& settings, std::string& device);

// What is removed when a run ends.
std::filesystem::path work_folder(const std::filesystem::path& folder);
// Where the model of a point is kept, and the pictures of a material and of a point.
std::filesystem::path kept_model(const std::filesystem::path& folder, const MeasuredPoint& point);
std::filesystem::path original_strip(const std::filesystem::path& folder,
                                     const TradeoffMaterial& material);
std::filesystem::path original_sphere(const std::filesystem::path& folder,
                                      const TradeoffMaterial& material);
std::filesystem::path decoded_strip(const std::filesystem::path& folder, const std::string& key);
// The original's images beside a model of a part.
std::filesystem::path part_strip(const std::filesystem::path& folder, const std::string& key);
std::filesystem::path decoded_sphere(const std::filesystem::path& folder, const std::string& key);

}  // namespace weft
