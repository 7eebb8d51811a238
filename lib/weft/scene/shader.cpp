#include "weft/scene/shader.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "weft/btf/mip.hpp"
#include "weft/btf/selection.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

// Images of a mask in memory.
class MaskSource final : public TileSource {
 public:
  MaskSource(const BtfInfo& info, DType dtype, std::size_t channels, std::vector<std::byte> values)
      : values_(std::move(values)) {
    info_.shape = {info.shape.views, 1, info.shape.height, info.shape.width, channels};
    info_.dtype = dtype;
    info_.view_directions = info.view_directions;
    info_.light_directions = {{0, 0, 1}};
    info_.source = info.source;
  }

  const BtfInfo& info() const override { return info_; }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    const std::span<const std::byte> images = mapped(first, count);
    std::copy(images.begin(), images.end(), out.begin());
  }
  std::span<const std::byte> mapped(std::size_t first, std::size_t count) override {
    return std::span(values_).subspan(first * info_.image_bytes(), count * info_.image_bytes());
  }

 private:
  BtfInfo info_;
  std::vector<std::byte> values_;
};

// m beside another number of each texel.
std::shared_ptr<TileSource> paired_source(const BtfInfo& info, const std::vector<float>& numbers) {
  std::vector<float> pairs;
  pairs.reserve(2 * numbers.size());
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    pairs.push_back(info.mask[i] != 0 ? 1.0f : 0.0f);
    pairs.push_back(numbers[i]);
  }
  const auto bytes = std::as_bytes(std::span(pairs));
  return std::make_shared<MaskSource>(info, DType::f32, 2,
                                      std::vector<std::byte>(bytes.begin(), bytes.end()));
}

}  // namespace

void validate_material(const BtfInfo& info) {
  if (info.layout != Layout::grid) {
    fail_input("layout 'paired': rendering needs every view with every light");
  }
  if (info.shape.channels != 1 && info.shape.channels != 3) {
    fail_input("{} channels: rendering needs 3 (red, green, blue) or 1 (grey)",
               info.shape.channels);
  }
}

MaskSources mask_sources(const BtfInfo& info, const Opacity* opacity) {
  if (info.mask.empty()) return {};
  if (!opacity) {
    std::vector<std::byte> values;
    for (const std::uint8_t value : info.mask) {
      values.push_back(value != 0 ? std::byte{255} : std::byte{0});
    }
    const auto source = std::make_shared<MaskSource>(info, DType::u8, 1, std::move(values));
    return {source, source};
  }
  if (opacity->values.size() != info.mask.size()) {
    fail_input("opacities: {} values for a mask of {}", opacity->values.size(), info.mask.size());
  }
  std::vector<float> opacities;
  for (const float value : opacity->values) {
    opacities.push_back(static_cast<float>(opacity->mapping.alpha(value)));
  }
  return {paired_source(info, opacity->values), paired_source(info, opacities)};
}

std::size_t mip_levels(const BtfShape& shape) {
  return last_mip_level(shape.height, shape.width) + 1;
}

std::shared_ptr<TileSource> next_mip_level(std::shared_ptr<TileSource> source) {
  Selection half;
  half.level = 1;
  return select(std::move(source), half);
}

void add_points(std::span<const ShadingPoint> points, std::span<const PointRadiance> radiance,
                std::size_t first_pixel, std::span<std::array<float, 4>> picture) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    const ShadingPoint& point = points[i];
    std::array<float, 4>& pixel = picture[point.pixel - first_pixel];
    const float hole = 1 - radiance[i][3];
    for (std::size_t c = 0; c < 3; ++c) {
      pixel[c] += point.weight * (radiance[i][c] + hole * point.behind[c]);
    }
    pixel[3] += point.weight * radiance[i][3];
  }
}

}  // namespace weft
