#include "tradeoff/measure_point.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <fstream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "tradeoff/child_process.hpp"
#include "tradeoff/pictures.hpp"
#include "weft/btf/tile.hpp"
#include "weft/error.hpp"
#include "weft/io/contact_sheet.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/metrics/ssim.hpp"
#include "weft/model/model_metadata.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

using nlohmann::json;

constexpr std::size_t shown_images = 4;
constexpr std::size_t sphere_side = 192;
// Encodings are run again for a better time while this takes less, in seconds.
constexpr double repeat_seconds = 10;

// Of the bytes of a file, and of what belongs to it.
std::string file_checksum(const std::filesystem::path& path) {
  Checksum sum;
  std::vector<std::filesystem::path> parts{path};
  if (path.extension() == ".npy") {
    parts.push_back(std::filesystem::path(path).replace_extension(".json"));
  }
  std::vector<char> block(std::size_t{1} << 20);
  for (const std::filesystem::path& part : parts) {
    std::ifstream file(part, std::ios::binary);
    do {
      check_interrupt();
      file.read(block.data(), static_cast<std::streamsize>(block.size()));
      sum.add(std::as_bytes(std::span(block.data(), static_cast<std::size_t>(file.gcount()))));
    } while (file);
    if (!file.eof()) fail_input("{}: cannot be read", part.string());
  }
  return sum.text();
}

std::filesystem::path image_folder(const std::filesystem::path& folder) {
  return folder / "images";
}

// Letters, digits and dashes only.
std::string file_stem(std::string_view text) {
  std::string stem;
  for (const char c : text) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) != 0;
    if (plain) stem += c;
    if (!plain && !stem.empty() && stem.back() != '-') stem += '-';
  }
  while (stem.ends_with('-')) stem.pop_back();
  return stem.substr(0, 80);
}

std::string model_name(const std::string& material, const TradeoffPoint& point) {
  const std::string stem = std::filesystem::path(material).stem().string();
  return file_stem(stem + "-" + text_of(point)) + ".weft";
}

// Values of a report; infinities are texts there.
void take(Figures& figures, const std::string& name, const json& object, const char* field) {
  const auto at = object.find(field);
  if (at == object.end()) return;
  if (at->is_number()) figures[name] = at->get<double>();
  if (*at == "inf") figures[name] = std::numeric_limits<double>::infinity();
}

// Images that stand for a BTF, with their directions in degrees: (theta, phi) of views and lights.
using Degrees = std::vector<std::array<double, 2>>;
std::vector<ShownImage> shown_images_of(const BtfShape& shape, const Degrees& views,
                                        const Degrees& lights) {
  std::vector<ShownImage> images;
  for (const std::size_t image : spread_images(shape, shown_images)) {
    const std::size_t view = image / shape.lights;
    const std::size_t light = image % shape.lights;
    const auto& v = views.at(view);
    // of pairs, the light is that of the view
    const auto& l = lights.at(lights.size() == shape.lights ? light : view);
    images.push_back({view, light, v[0], v[1], l[0], l[1]});
  }
  return images;
}

Degrees directions_of(const json& list) {
  Degrees directions;
  for (const json& one : list) directions.push_back({one.at(0), one.at(1)});
  return directions;
}

Degrees directions_of(const std::vector<Direction>& list) {
  Degrees directions;
  for (const Direction& one : list) directions.push_back({theta_degrees(one), phi_degrees(one)});
  return directions;
}

class Measurement {
 public:
  Measurement(const TradeoffMaterial& material, const TradeoffPoint& point,
              const MeasureSettings& settings, std::string& device)
      : material_(material), settings_(settings), device_(device) {
    result_.key = key_of(material, point);
    result_.material = material.name;
    result_.point = point;
    result_.command = "weft " + join_words(compress_arguments(model_name(material.name, point)));
    const std::filesystem::path work = work_folder(settings.folder);
    model_ = settings.keep_models ? kept_model(settings.folder, result_) : work / "point.weft";
    sheet_ = work / "sheet.png";
    std::filesystem::create_directories(work);
    std::filesystem::create_directories(model_.parent_path());
  }
  Measurement(const Measurement&) = delete;
  Measurement& operator=(const Measurement&) = delete;

  MeasuredPoint run() {
    encode();
    if (result_.status != 0) return std::move(result_);
    decode();
    if (settings_.pictures) draw();
    return std::move(result_);
  }

 private:
  std::vector<std::string> compress_arguments(const std::string& output) const {
    std::vector<std::string> words{"compress", material_.path, "--codec", result_.point.codec};
    words.insert(words.end(), result_.point.options.begin(), result_.point.options.end());
    if (similarity_) words.emplace_back("--ssim");
    words.insert(words.end(), {"-o", output});
    return words;
  }

  ChildResult run(std::vector<std::string> arguments, bool json_report = true) const {
    if (json_report) arguments.emplace_back("--json");
    arguments.emplace_back("--quiet");
    return run_child(arguments, settings_.time_limit);
  }

  void add_message(const std::string& message) {
    result_.message += (result_.message.empty() ? "" : "; ") + message;
  }

  void encode() {
    double spent = 0;
    for (std::size_t i = 0; i < settings_.repeat && spent < repeat_seconds; ++i) {
      const ChildResult child = run(compress_arguments(model_.string()));
      spent += child.seconds;
      const double known =
          result_.figures.contains("encode_time") ? result_.figures["encode_time"] : 0;
      if (child.status != 0) {
        result_.status = child.status;
        result_.message = failure_message(child);
        result_.figures.clear();
        return;
      }
      const json report = json::parse(child.out);
      if (i > 0 && report.at("encode_time").get<double>() >= known) continue;
      take_report(report);
      result_.figures["peak_memory"] = static_cast<double>(child.peak_memory);
    }
  }

  void take_report(const json& report) {
    for (const char* name : {"file_size", "raw_size", "ratio", "encode_time", "time"}) {
      take(result_.figures, name, report, name);
    }
    take_errors(report.at("errors"), "");
    if (report.contains("weighted_errors")) take_errors(report.at("weighted_errors"), "weighted_");
    // of the selection, where there is one
    const json& sizes = report.at("shape");
    shape_ = {sizes.at(0), sizes.at(1), sizes.at(2), sizes.at(3), sizes.at(4)};
    if (shape_ != material_.shape) {
      result_.images = shown_images_of(shape_, directions_of(report.at("view_directions")),
                                       directions_of(report.at("light_directions")));
    }
    result_.parameters = report.at("parameters").dump();
    result_.notes = report.value("notes", "");
    if (report.at("device") != "reference") device_ = report.at("device").get<std::string>();
  }

  // Errors of a kind of their own stand in objects: "log" has rmse and snr.
  void take_errors(const json& errors, const std::string& prefix) {
    for (const auto& [name, value] : errors.items()) {
      if (value.is_object()) {
        take_errors(value, prefix + name + "_");
      } else {
        take(result_.figures, prefix + name, errors, name.c_str());
      }
    }
  }

  // Rates of the model on the device, also of one that the reference encoded.
  void decode() {
    std::vector<std::string> words{"bench",
                                   "--model",
                                   model_.string(),
                                   "--filter",
                                   "texel,images,look_ups",
                                   "--no-bound",
                                   "--lookups",
                                   std::to_string(settings_.lookups)};
    const std::vector<std::string>& options = result_.point.options;
    const auto device = std::ranges::find(options, "--device");
    if (device != options.end() && device + 1 != options.end() && device[1] != "reference") {
      words.insert(words.end(), {"--device", device[1]});
    }
    const ChildResult child = run(words);
    if (child.status != 0) return add_message("decoding rates: " + failure_message(child));
    const json report = json::parse(child.out);
    take(result_.figures, "texel_time", report, "texel_time");
    const json& images = report.at("images");
    take(result_.figures, "image_rate", images, "rate");
    result_.figures["texel_rate"] =
        result_.figures["image_rate"] * static_cast<double>(shape_.texels());
    take(result_.figures, "lookup_rate", report.at("look_ups"), "unsorted");
    take(result_.figures, "sorted_lookup_rate", report.at("look_ups"), "sorted_by_texel");
  }

  void draw() {
    std::filesystem::create_directories(image_folder(settings_.folder));
    // A model of a part has images of its own, beside which those of the original stand in the
    // sheet.
    const bool part = shape_ != material_.shape;
    const std::size_t count = (part ? result_.images : material_.images).size();
    const ChildResult drawn = run({"sheet", material_.path, model_.string(), "--columns",
                                   std::to_string(count), "-o", sheet_.string()},
                                  false);
    if (drawn.status == 0) {
      const PixelImage sheet = read_pixels(sheet_);
      const auto cut = [&](std::size_t row, const std::filesystem::path& path) {
        write_pixels(path, cut_strip(sheet, row, count, shape_.width, shape_.height, {}));
      };
      cut(1, decoded_strip(settings_.folder, result_.key));
      if (part) cut(0, part_strip(settings_.folder, result_.key));
    } else {
      add_message("images: " + failure_message(drawn));
    }
    if (std::isnan(material_.exposure)) return;  // the material itself can't be rendered
    const ChildResult rendered =
        run({"render", model_.string(), "--size", std::to_string(sphere_side), "--exposure",
             fmt::format("{}", material_.exposure), "-o",
             decoded_sphere(settings_.folder, result_.key).string()},
            false);
    if (rendered.status != 0) add_message("sphere: " + failure_message(rendered));
  }

  const TradeoffMaterial& material_;
  const MeasureSettings& settings_;
  std::string& device_;
  bool similarity_ = material_.shape.height >= ssim_window && material_.shape.width >= ssim_window;
  std::filesystem::path model_;
  std::filesystem::path sheet_;
  BtfShape shape_;  // of the model
  MeasuredPoint result_;
};

}  // namespace

TradeoffMaterial describe_material(const std::string& path, std::string name) {
  TradeoffMaterial material;
  const std::shared_ptr<TileSource> source = open_raw_btf(path);
  const BtfInfo& info = source->info();
  material.name = std::move(name);
  material.path = path;
  material.checksum = file_checksum(path);
  material.bytes = std::filesystem::file_size(path);
  material.shape = info.shape;
  material.dtype = name_of(info.dtype);
  material.encoding = name_of(info.encoding);
  material.images = shown_images_of(info.shape, directions_of(info.view_directions),
                                    directions_of(info.light_directions));
  return material;
}

std::string draw_material(TradeoffMaterial& material, const MeasureSettings& settings) {
  std::filesystem::create_directories(image_folder(settings.folder));
  std::string message;
  const auto add = [&](const char* what, const ChildResult& child) {
    message += fmt::format("{}{}: {}", message.empty() ? "" : "; ", what, failure_message(child));
  };
  const std::filesystem::path strip = original_strip(settings.folder, material);
  if (!std::filesystem::exists(strip)) {
    std::filesystem::create_directories(work_folder(settings.folder));
    const std::filesystem::path sheet = work_folder(settings.folder) / "sheet.png";
    const ChildResult drawn =
        run_child(std::vector<std::string>{"sheet", material.path, "--columns",
                                           std::to_string(material.images.size()), "--quiet", "-o",
                                           sheet.string()},
                  settings.time_limit);
    if (drawn.status == 0) {
      const BtfShape& s = material.shape;
      write_pixels(strip,
                   cut_strip(read_pixels(sheet), 0, material.images.size(), s.width, s.height, {}));
    } else {
      add("images", drawn);
    }
  }
  const std::filesystem::path sphere = original_sphere(settings.folder, material);
  if (!std::filesystem::exists(sphere) || std::isnan(material.exposure)) {
    const ChildResult rendered = run_child(
        std::vector<std::string>{"render", material.path, "--size", std::to_string(sphere_side),
                                 "--json", "--quiet", "-o", sphere.string()},
        settings.time_limit);
    if (rendered.status == 0) {
      material.exposure = json::parse(rendered.out).at("exposure").get<double>();
    } else {
      add("sphere", rendered);
    }
  }
  return message;
}

std::string key_of(const TradeoffMaterial& material, const TradeoffPoint& point) {
  std::string text = material.checksum + "\n" + version() + "\n" + point.codec;
  for (const std::string& option : point.options) text += "\n" + option;
  return checksum_of(std::as_bytes(std::span(text.data(), text.size())));
}

MeasuredPoint measure_point(const TradeoffMaterial& material, const TradeoffPoint& point,
                            const MeasureSettings& settings, std::string& device) {
  return Measurement(material, point, settings, device).run();
}

std::filesystem::path work_folder(const std::filesystem::path& folder) {
  return folder / "work";
}

std::filesystem::path kept_model(const std::filesystem::path& folder, const MeasuredPoint& point) {
  return folder / "models" / (point.key + "-" + model_name(point.material, point.point));
}

std::filesystem::path original_strip(const std::filesystem::path& folder,
                                     const TradeoffMaterial& material) {
  return image_folder(folder) / (material.checksum + "-original.png");
}

std::filesystem::path original_sphere(const std::filesystem::path& folder,
                                      const TradeoffMaterial& material) {
  return image_folder(folder) / (material.checksum + "-sphere.png");
}

std::filesystem::path decoded_strip(const std::filesystem::path& folder, const std::string& key) {
  return image_folder(folder) / (key + "-decoded.png");
}

std::filesystem::path part_strip(const std::filesystem::path& folder, const std::string& key) {
  return image_folder(folder) / (key + "-original.png");
}

std::filesystem::path decoded_sphere(const std::filesystem::path& folder, const std::string& key) {
  return image_folder(folder) / (key + "-sphere.png");
}

}  // namespace weft
