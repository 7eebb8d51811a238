#include "tradeoff/page.hpp"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "tradeoff/measure_point.hpp"
#include "tradeoff/pictures.hpp"
#include "tradeoff/texts.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

using nlohmann::json;

// How pictures are embedded, from the finest: as they are, then less of them.
struct PictureSize {
  StripSize strip;
  bool half_spheres;
};
constexpr std::array<PictureSize, 5> picture_sizes{
    {{{4, 128}, false}, {{4, 64}, false}, {{3, 64}, true}, {{2, 64}, true}, {{2, 40}, true}}};

std::string strip_url(const std::filesystem::path& path, std::size_t count,
                      const PictureSize& size) {
  if (!std::filesystem::exists(path)) return {};
  return data_url(reduce_strip(read_pixels(path), count, size.strip));
}

std::string sphere_url(const std::filesystem::path& path, const PictureSize& size) {
  if (!std::filesystem::exists(path)) return {};
  const PixelImage image = read_pixels(path);
  return data_url(size.half_spheres ? halve(image) : image);
}

// Adds "strip" and "sphere" to an object; returns their bytes.
std::size_t add_pictures(json& object, const std::string& strip, const std::string& sphere) {
  if (!strip.empty()) object["strip"] = strip;
  if (!sphere.empty()) object["sphere"] = sphere;
  return strip.size() + sphere.size();
}

// The images that are still in a strip.
void keep_images(json& object, const PictureSize& size) {
  auto& images = object.at("images").get_ref<json::array_t&>();
  images.resize(std::min(images.size(), size.strip.tiles));
}

// The results with pictures of this size. `bytes` is what they take; past `limit` no more are
// added.
json with_pictures(const std::filesystem::path& folder, const TradeoffResults& results,
                   const PictureSize& size, std::size_t limit, std::size_t& bytes) {
  json data = to_json(results);
  bytes = 0;
  std::size_t i = 0;
  for (const TradeoffMaterial& material : results.materials) {
    json& object = data.at("materials").at(i++);
    bytes += add_pictures(object,
                          strip_url(original_strip(folder, material), material.images.size(), size),
                          sphere_url(original_sphere(folder, material), size));
    keep_images(object, size);
  }
  i = 0;
  for (const MeasuredPoint& point : results.points) {
    json& object = data.at("points").at(i++);
    if (bytes > limit) {
      object["left_out"] = true;
      continue;
    }
    std::size_t count = point.images.size();
    if (count > 0) {
      const std::string original = strip_url(part_strip(folder, point.key), count, size);
      if (!original.empty()) object["original"] = original;
      bytes += original.size();
      keep_images(object, size);
    }
    for (const TradeoffMaterial& material : results.materials) {
      if (count == 0 && material.name == point.material) count = material.images.size();
    }
    bytes += add_pictures(object, strip_url(decoded_strip(folder, point.key), count, size),
                          sphere_url(decoded_sphere(folder, point.key), size));
  }
  return data;
}

// JSON as it may stand in a script element: nothing there ends the element or opens a comment.
std::string script_text(const json& data) {
  const std::string text = data.dump(-1, ' ', true, json::error_handler_t::replace);
  std::string escaped;
  escaped.reserve(text.size());
  for (const char c : text) {
    if (c == '<') {
      escaped += "\\u003c";
    } else {
      escaped += c;
    }
  }
  return escaped;
}

void replace(std::string& text, std::string_view place, std::string_view with) {
  const std::size_t at = text.find(place);
  if (at == std::string::npos) fail_runtime("page.html has no place for {}", place);
  text.replace(at, place.size(), with);
}

}  // namespace

std::string make_page(const std::filesystem::path& folder, const TradeoffResults& results,
                      std::size_t picture_bytes) {
  json data;
  std::size_t bytes = 0;
  for (const PictureSize& size : picture_sizes) {
    data = with_pictures(folder, results, size, picture_bytes, bytes);
    if (bytes <= picture_bytes) break;
  }
  std::string text(tradeoff_texts::page);
  replace(text, "/*style*/", tradeoff_texts::style);
  replace(text, "/*script*/", tradeoff_texts::script);
  replace(text, "/*data*/", script_text(data));
  return text;
}

}  // namespace weft
