#include "weft/scene/light_tables.hpp"

#include <algorithm>

#include "weft/btf/encoding.hpp"
#include "weft/btf/mip.hpp"
#include "weft/error.hpp"
#include "weft/scene/texture_taps.hpp"

namespace weft {
namespace {

constexpr std::size_t most_texels = 256;
// Records that are looked up at once.
constexpr std::size_t batch_records = std::size_t{1} << 20;

}  // namespace

LightTables::LightTables(const BtfInfo& info, std::size_t level, const LookUp& look_up)
    : height_(mip_side(info.shape.height, level)),
      width_(mip_side(info.shape.width, level)),
      views_(info.view_directions),
      light_nodes_(info.light_directions, info.quantity) {
  const std::size_t texels = height_ * width_, lights = info.shape.lights,
                    channels = info.shape.channels, count = light_nodes_.count();
  nodes_.resize(texels * info.shape.views * count);
  const std::size_t run =
      std::clamp<std::size_t>(batch_records / (texels * lights), 1, info.shape.views);
  std::vector<std::uint32_t> records;
  std::vector<double> values, luminances(lights), nodes(count);
  for (std::size_t first = 0; first < info.shape.views; first += run) {
    check_interrupt();
    const std::size_t views = std::min(run, info.shape.views - first);
    records.clear();
    for (std::size_t v = first; v < first + views; ++v) {
      for (std::size_t l = 0; l < lights; ++l) {
        for (std::size_t p = 0; p < texels; ++p) {
          records.insert(records.end(),
                         {static_cast<std::uint32_t>(p), static_cast<std::uint32_t>(v),
                          static_cast<std::uint32_t>(l)});
        }
      }
    }
    values.resize(views * lights * texels * channels);
    look_up(records, values);
    for (double& value : values) value = decode_to_linear(info.encoding, value);
    for (std::size_t v = 0; v < views; ++v) {
      for (std::size_t p = 0; p < texels; ++p) {
        for (std::size_t l = 0; l < lights; ++l) {
          const std::size_t at = ((v * lights + l) * texels + p) * channels;
          luminances[l] = slice_luminance(std::span(values).subspan(at, channels));
        }
        light_nodes_.gather(luminances, nodes);
        float* const out = &nodes_[(p * info.shape.views + first + v) * count];
        std::transform(nodes.begin(), nodes.end(), out,
                       [](double node) { return static_cast<float>(node); });
      }
    }
  }
}

BilinearDensity LightTables::density(const std::array<float, 2>& uv,
                                     const std::array<float, 3>& view) const {
  const TexelTaps taps = texel_taps(uv, height_, width_);
  const auto nearest = static_cast<std::size_t>(
      std::max_element(taps.weight.begin(), taps.weight.end()) - taps.weight.begin());
  const DirectionWeights weights = views_.at(
      {static_cast<double>(view[0]), static_cast<double>(view[1]), static_cast<double>(view[2])});
  const std::size_t count = light_nodes_.count();
  const std::size_t views = nodes_.size() / count / (height_ * width_);
  std::vector<double> nodes(count);
  for (std::size_t k = 0; k < 3; ++k) {
    if (weights.weight[k] == 0) continue;
    const float* const of_view = &nodes_[(taps.texel[nearest] * views + weights.index[k]) * count];
    for (std::size_t i = 0; i < count; ++i) {
      nodes[i] += weights.weight[k] * static_cast<double>(of_view[i]);
    }
  }
  return light_nodes_.density(nodes);
}

std::size_t LightTables::choose_level(const BtfInfo& info, std::size_t levels, std::size_t memory) {
  std::size_t level = 0;
  while (level + 1 < levels &&
         (mip_side(info.shape.height, level) * mip_side(info.shape.width, level) > most_texels ||
          bytes(info, level) > memory)) {
    ++level;
  }
  return level;
}

std::size_t LightTables::bytes(const BtfInfo& info, std::size_t level) {
  const std::size_t texels = mip_side(info.shape.height, level) * mip_side(info.shape.width, level);
  const std::size_t side = LightNodes::side_of(info.shape.lights);
  return texels * info.shape.views * side * side * sizeof(float);
}

}  // namespace weft
