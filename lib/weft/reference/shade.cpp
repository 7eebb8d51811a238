#include "weft/reference/shade.hpp"

#include <algorithm>
#include <bit>
#include <utility>

#include "weft/btf/encoding.hpp"
#include "weft/btf/hemisphere.hpp"
#include "weft/btf/mip.hpp"
#include "weft/btf/view_grid.hpp"
#include "weft/error.hpp"
#include "weft/scene/light_tables.hpp"
#include "weft/scene/texture_taps.hpp"

namespace weft::reference {
namespace {

constexpr std::size_t batch = 4096;         // light samples
constexpr std::size_t sample_bytes = 1024;  // at most, with all that is made of one

std::array<double, 3> to_double(const std::array<float, 3>& v) {
  return {static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])};
}

void append(std::vector<std::uint32_t>& words, std::span<const std::uint32_t> indices) {
  words.insert(words.end(), indices.begin(), indices.end());
}

template <typename T, std::size_t N>
void append_floats(std::vector<std::uint32_t>& words, const std::array<T, N>& values) {
  for (const T value : values) {
    words.push_back(std::bit_cast<std::uint32_t>(static_cast<float>(value)));
  }
}

class ReferenceShader final : public Shader {
 public:
  ReferenceShader(const BtfInfo& info, std::vector<std::unique_ptr<ReferenceSampler>> levels,
                  std::vector<std::unique_ptr<ReferenceSampler>> mask_levels,
                  std::optional<VisibilityMapping> mapping, OwnLevels own)
      : info_(info),
        levels_(std::move(levels)),
        mask_levels_(std::move(mask_levels)),
        mapping_(mapping),
        views_(info.view_directions),
        lights_(info.light_directions),
        own_(own) {
    info_.mask.clear();
  }

  void shade(std::span<const ShadingPoint> points, std::span<const LightSample> lights,
             std::span<PointRadiance> radiance, Job& job) override {
    if (points.empty()) return;
    const std::size_t samples = lights.size() / points.size();
    const std::size_t run =
        std::clamp<std::size_t>(batch / std::max<std::size_t>(samples, 1), 1, points.size());
    for (std::size_t first = 0; first < points.size(); first += run) {
      check_interrupt();
      const std::size_t count = std::min(run, points.size() - first);
      shade_run(points.subspan(first, count), lights.subspan(first * samples, count * samples),
                radiance.subspan(first, count), job);
    }
  }

  LightTables light_tables(std::size_t memory, Job& job) override {
    const StageTimer timer(job, "light tables");
    const std::size_t level = LightTables::choose_level(info_, levels_.size(), memory);
    return {info_, level, [&](std::span<const std::uint32_t> records, std::span<double> out) {
              levels_[level]->look_up({1, 1, 1}, records, out);
            }};
  }

  std::size_t batch_samples() const override { return batch; }
  std::size_t bytes() const override { return batch * sample_bytes; }

 private:
  // One level of one point; its light samples with irradiance are [first, end) of those of the run.
  struct Entry {
    std::size_t point = 0;
    double weight = 0;  // of the level
    TexelTaps taps;
    double mask = 1;
    double opacity = 1;
  };
  struct Light {
    std::size_t point = 0;
    DirectionWeights weights;
    const LightSample* sample = nullptr;
  };

  void shade_run(std::span<const ShadingPoint> points, std::span<const LightSample> lights,
                 std::span<PointRadiance> radiance, Job& job) {
    const std::size_t samples = lights.size() / points.size();
    std::vector<DirectionWeights> views;
    std::vector<Light> used;
    std::vector<std::vector<Entry>> entries(levels_.size());
    {
      const StageTimer timer(job, "directions");
      for (std::size_t i = 0; i < points.size(); ++i) {
        views.push_back(views_.at(to_double(points[i].view)));
        const MipTaps mip = mip_taps(points[i].footprint, info_.shape.height, info_.shape.width);
        add_entry(entries, mip.level, 1 - static_cast<double>(mip.coarser), i, points[i]);
        add_entry(entries, mip.level + 1, static_cast<double>(mip.coarser), i, points[i]);
        for (std::size_t s = 0; s < samples; ++s) {
          const LightSample& light = lights[i * samples + s];
          if (light.irradiance == std::array<float, 3>{}) continue;
          used.push_back({i, lights_.at(to_double(light.direction)), &light});
        }
      }
    }
    std::vector<std::array<double, 4>> sums(points.size(), std::array<double, 4>{});
    for (std::size_t level = 0; level < levels_.size(); ++level) {
      if (entries[level].empty()) continue;
      find_masks(level, views, entries[level], job);
      add_level(level, points, views, entries[level], used, sums, job);
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
      for (std::size_t c = 0; c < 4; ++c) radiance[i][c] = static_cast<float>(sums[i][c]);
    }
  }

  void add_entry(std::vector<std::vector<Entry>>& entries, std::size_t level, double weight,
                 std::size_t i, const ShadingPoint& point) const {
    if (weight <= 0) return;
    entries[level].push_back({i, weight,
                              texel_taps(point.uv, mip_side(info_.shape.height, level),
                                         mip_side(info_.shape.width, level)),
                              1, 1});
  }

  void find_masks(std::size_t level, const std::vector<DirectionWeights>& views,
                  std::vector<Entry>& entries, Job& job) {
    if (mask_levels_.empty()) return;
    const StageTimer timer(job, "look-ups");
    constexpr LookupShape lookup{4, 3, 1};
    std::vector<std::uint32_t> records;
    for (const Entry& entry : entries) {
      append(records, entry.taps.texel);
      append(records, views[entry.point].index);
      records.push_back(0);
      append_floats(records, entry.taps.weight);
      append_floats(records, views[entry.point].weight);
    }
    const std::size_t channels = mapping_ ? 2 : 1;
    std::vector<double> values(channels * entries.size());
    mask_levels_[level]->look_up(lookup, records, values);
    for (std::size_t i = 0; i < entries.size(); ++i) {
      entries[i].mask = std::clamp(values[channels * i], 0.0, 1.0);
      const double last = values[channels * i + channels - 1];
      entries[i].opacity =
          mapping_ && level == 0 ? mapping_->alpha(last) : std::clamp(last, 0.0, 1.0);
    }
  }

  void add_level(std::size_t level, std::span<const ShadingPoint> points,
                 const std::vector<DirectionWeights>& views, const std::vector<Entry>& entries,
                 const std::vector<Light>& lights, std::vector<std::array<double, 4>>& sums,
                 Job& job) {
    const bool own = level < own_.count;
    const bool of_directions = own && own_.directions;
    const bool of_grid = own && !of_directions && own_.grid_side > 0;
    const bool measured = !of_directions && !of_grid;
    const LookupShape lookup = of_directions ? LookupShape{4, 1, 1, true}
                                             : LookupShape{4, of_grid ? std::size_t{1} : 3, 3};
    std::vector<const Entry*> entry_of(views.size(), nullptr);
    for (const Entry& entry : entries) {
      entry_of[entry.point] = &entry;
      sums[entry.point][3] += entry.weight * entry.opacity;
    }
    std::vector<std::uint32_t> records;
    std::vector<const Light*> looked_up;
    for (const Light& light : lights) {
      const Entry* entry = entry_of[light.point];
      if (!entry) continue;
      looked_up.push_back(&light);
      append(records, entry->taps.texel);
      if (of_directions) {
        append_floats(records, points[light.point].view);
        append_floats(records, light.sample->direction);
        append_floats(records, entry->taps.weight);
        continue;
      }
      if (of_grid) {
        const std::size_t view =
            ViewGrid(own_.grid_side).entry(to_double(points[light.point].view));
        records.push_back(static_cast<std::uint32_t>(info_.shape.views + view));
      } else {
        append(records, views[light.point].index);
      }
      append(records, light.weights.index);
      append_floats(records, entry->taps.weight);
      if (measured) append_floats(records, views[light.point].weight);
      append_floats(records, light.weights.weight);
    }
    const std::size_t channels = info_.shape.channels;
    std::vector<double> values(looked_up.size() * channels);
    {
      const StageTimer timer(job, "look-ups");
      levels_[level]->look_up(lookup, records, values);
    }
    const StageTimer timer(job, "shading");
    for (std::size_t n = 0; n < looked_up.size(); ++n) {
      const Light& light = *looked_up[n];
      const Entry& entry = *entry_of[light.point];
      const double cosine = std::max(double{light.sample->direction[2]}, 0.0);
      // what was looked up in directions has the light's scale in it
      const double scale = of_directions ? (cosine > 0 ? 1.0 : 0.0) : light.weights.scale;
      const double factor = info_.quantity == Quantity::brdf ? cosine : scale;
      for (std::size_t c = 0; c < 3; ++c) {
        const double value = values[n * channels + (channels == 3 ? c : 0)];
        sums[light.point][c] += entry.weight * factor * linear(value, entry) *
                                static_cast<double>(light.sample->irradiance[c]);
      }
    }
  }

  // A looked-up value, premultiplied by the mask, in linear light, premultiplied by the opacity.
  double linear(double value, const Entry& entry) const {
    if (!(value > 0) || entry.mask <= 0) return 0;
    // What a lossy model leaves in a hole is not made brighter than white.
    const double whole = info_.encoding == Encoding::linear
                             ? value / entry.mask
                             : std::min(value / entry.mask, std::max(value, 1.0));
    return entry.opacity * decode_to_linear(info_.encoding, whole);
  }

  BtfInfo info_;
  std::vector<std::unique_ptr<ReferenceSampler>> levels_;
  std::vector<std::unique_ptr<ReferenceSampler>> mask_levels_;
  std::optional<VisibilityMapping> mapping_;
  Hemisphere views_;
  Hemisphere lights_;
  OwnLevels own_;
};

}  // namespace

std::unique_ptr<Shader> make_shader(const BtfInfo& info,
                                    std::vector<std::unique_ptr<ReferenceSampler>> levels,
                                    std::vector<std::unique_ptr<ReferenceSampler>> mask_levels,
                                    std::optional<VisibilityMapping> mapping, OwnLevels own) {
  validate_material(info);
  return std::make_unique<ReferenceShader>(info, std::move(levels), std::move(mask_levels), mapping,
                                           own);
}

}  // namespace weft::reference
