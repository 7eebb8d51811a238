#include "weft/render/device_shader.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "weft/btf/mip.hpp"
#include "weft/btf/view_grid.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/error.hpp"
#include "weft/ops/shade.hpp"
#include "weft/render/raw_sampler.hpp"
#include "weft/scene/light_tables.hpp"
#include "weft/scene/texture_taps.hpp"

namespace weft {
namespace {

using Samplers = std::vector<std::unique_ptr<DeviceSampler>>;

// Bytes that a point and a light sample take in a batch, on the device and once more on the host.
constexpr std::size_t point_bytes = 512;
constexpr std::size_t sample_bytes = 384;
// Light samples of a batch where all levels are resident: what they take stays in a large cache.
// Fewer where memory is short.
constexpr std::size_t resident_batch = std::size_t{1} << 16;
constexpr std::size_t least_batch = std::size_t{1} << 10;
constexpr std::size_t streaming_batch = std::size_t{1} << 24;

// A material on the device.
struct DeviceMaterial {
  BtfInfo info;  // without its mask
  Samplers levels;
  std::size_t grid_side = 0;   // of the models' grid of views, or 0
  std::size_t own_levels = 0;  // that are looked up as `own_lookups`: those of models
  ops::ShadeLookups own_lookups = ops::ShadeLookups::measured;
  Samplers mask_levels;  // empty without a mask
  std::optional<VisibilityMapping> mapping;
  std::shared_ptr<const Model> model;
  std::size_t batch = resident_batch;
  std::size_t bytes = 0;
};

// Grows a buffer that is too small; its contents are lost.
void reserve(Device& device, Buffer& buffer, std::size_t bytes, const char* what) {
  if (buffer.size() >= bytes && buffer) return;
  buffer = Buffer();
  buffer = Buffer(device, std::max<std::size_t>(bytes, 1), what);
}

class DeviceShader final : public Shader {
 public:
  DeviceShader(Device& device, DeviceMaterial material)
      : device_(device),
        material_(std::move(material)),
        views_(device, Hemisphere(material_.info.view_directions)),
        lights_(device, Hemisphere(material_.info.light_directions)) {}

  std::size_t batch_samples() const override { return material_.batch; }
  std::size_t bytes() const override { return material_.bytes; }

  LightTables light_tables(std::size_t memory, Job& job) override {
    const StageTimer timer(job, "light tables");
    const BtfInfo& info = material_.info;
    const std::size_t level = LightTables::choose_level(info, material_.levels.size(), memory);
    std::vector<float> found;
    return {info, level, [&](std::span<const std::uint32_t> records, std::span<double> out) {
              constexpr LookupShape single{1, 1, 1};
              write(list_, records, "look-ups");
              reserve(device_, values_, out.size() * sizeof(float), "values looked up");
              material_.levels[level]->look_up(single, records.size() / single.words(), list_,
                                               values_);
              found.resize(out.size());
              device_.read(values_, std::span<float>(found));
              std::copy(found.begin(), found.end(), out.begin());
            }};
  }

  void shade(std::span<const ShadingPoint> points, std::span<const LightSample> lights,
             std::span<PointRadiance> radiance, Job& job) override {
    if (points.empty()) return;
    const std::size_t samples = lights.size() / points.size();
    const std::size_t run = std::clamp<std::size_t>(
        material_.batch / std::max<std::size_t>(samples, 1), 1, points.size());
    for (std::size_t first = 0; first < points.size(); first += run) {
      check_interrupt();
      const std::size_t count = std::min(run, points.size() - first);
      shade_run(points.subspan(first, count), lights.subspan(first * samples, count * samples),
                radiance.subspan(first, count), job);
    }
  }

 private:
  using Entries = std::vector<std::vector<std::uint32_t>>;  // of each level
  using Float4 = std::array<float, 4>;

  // What is uploaded of a run; kept, so that its memory is.
  struct HostTables {
    std::vector<Float4> views, lights, irradiance;
    std::vector<float> share;
    std::vector<std::array<float, 2>> masks;
    std::vector<std::uint32_t> first, point_of, grid_views;
    std::vector<TexelTaps> taps;

    void clear() {
      for (auto* list : {&views, &lights, &irradiance}) list->clear();
      share.clear();
      masks.clear();
      for (auto* list : {&first, &point_of, &grid_views}) list->clear();
      taps.clear();
    }
  };

  void shade_run(std::span<const ShadingPoint> points, std::span<const LightSample> lights,
                 std::span<PointRadiance> radiance, Job& job) {
    for (Entries* entries : {&point_entries_, &sample_entries_}) {
      entries->resize(material_.levels.size());
      for (auto& list : *entries) list.clear();
    }
    {
      const StageTimer timer(job, "directions");
      upload(points, lights, point_entries_, sample_entries_);
      device_.finish();
    }
    for (std::size_t level = 0; level < material_.levels.size(); ++level) {
      look_up_masks(level, point_entries_[level], job);
      light_level(level, sample_entries_[level], job);
    }
    const StageTimer timer(job, "shading");
    reserve(device_, radiance_, points.size() * sizeof(PointRadiance), "radiance of points");
    ops::sum_points(device_, points.size(), tables_, radiance_);
    device_.read(radiance_, radiance);
  }

  // Fills the tables, and lists the entries of each level.
  void upload(std::span<const ShadingPoint> points, std::span<const LightSample> lights,
              Entries& point_entries, Entries& sample_entries) {
    const std::size_t samples = lights.size() / points.size();
    const BtfShape& shape = material_.info.shape;
    if (points.size() > std::numeric_limits<std::uint32_t>::max() / 2 ||
        lights.size() > std::numeric_limits<std::uint32_t>::max() / 2) {
      fail_input("{} light samples of {} points at once are too many", lights.size(),
                 points.size());
    }
    HostTables& host = host_;
    host.clear();
    static_assert(sizeof(TexelTaps) == ops::texel_tap_words * sizeof(std::uint32_t));
    for (std::size_t i = 0; i < points.size(); ++i) {
      const ShadingPoint& point = points[i];
      host.views.push_back({point.view[0], point.view[1], point.view[2], 0});
      if (material_.grid_side > 0) {
        const std::array<double, 3> view{point.view[0], point.view[1], point.view[2]};
        host.grid_views.push_back(
            static_cast<std::uint32_t>(shape.views + ViewGrid(material_.grid_side).entry(view)));
      }
      const auto first_sample = static_cast<std::uint32_t>(host.point_of.size());
      host.first.push_back(first_sample);
      for (const LightSample& light : lights.subspan(i * samples, samples)) {
        const auto& d = light.direction;
        const auto& e = light.irradiance;
        if (e[0] == 0 && e[1] == 0 && e[2] == 0) continue;
        host.lights.push_back({d[0], d[1], d[2], 0});
        host.irradiance.push_back({e[0], e[1], e[2], 0});
        host.point_of.push_back(static_cast<std::uint32_t>(i));
      }
      const MipTaps mip = mip_taps(point.footprint, shape.height, shape.width);
      const float shares[2] = {1 - mip.coarser, mip.coarser};
      for (std::uint32_t slot = 0; slot < 2; ++slot) {
        const bool used = shares[slot] > 0;
        const std::size_t level = mip.level + slot;
        host.share.push_back(shares[slot]);
        host.masks.push_back({1, 1});
        host.taps.push_back(
            used ? texel_taps(point.uv, mip_side(shape.height, level), mip_side(shape.width, level))
                 : TexelTaps{});
        if (!used) continue;
        point_entries[level].push_back(static_cast<std::uint32_t>(2 * i) + slot);
        for (auto s = first_sample; s < host.point_of.size(); ++s) {
          sample_entries[level].push_back(2 * s + slot);
        }
      }
    }
    host.first.push_back(static_cast<std::uint32_t>(host.point_of.size()));

    write(tables_.taps, std::span<const TexelTaps>(host.taps), "texels of points");
    write(tables_.share, std::span<const float>(host.share), "shares of levels");
    write(tables_.masks, std::span<const std::array<float, 2>>(host.masks), "masks of points");
    write(tables_.first, std::span<const std::uint32_t>(host.first), "light samples of points");
    write(tables_.point_of, std::span<const std::uint32_t>(host.point_of),
          "points of light samples");
    write(tables_.irradiance, std::span<const Float4>(host.irradiance), "irradiance");
    if (material_.grid_side > 0) {
      write(tables_.grid_views, std::span<const std::uint32_t>(host.grid_views), "views of a grid");
    }
    reserve(device_, tables_.light, host.point_of.size() * 2 * sizeof(PointRadiance),
            "reflected light");
    write(tables_.view_directions, std::span<const Float4>(host.views), "views");
    write(tables_.light_directions, std::span<const Float4>(host.lights), "lights");
    // where all is looked up by directions themselves, nothing is between measured ones
    bool measured = false;
    for (std::size_t level = 0; level < sample_entries.size(); ++level) {
      const bool of_directions = lookups_of(level) == ops::ShadeLookups::directions;
      measured = measured || (!of_directions && !sample_entries[level].empty());
    }
    if (measured || !material_.mask_levels.empty()) {
      weigh(views_, host.views.size(), tables_.view_directions, tables_.views);
    }
    if (measured) weigh(lights_, host.lights.size(), tables_.light_directions, tables_.lights);
  }

  ops::ShadeLookups lookups_of(std::size_t level) const {
    return level < material_.own_levels ? material_.own_lookups : ops::ShadeLookups::measured;
  }

  template <typename T>
  void write(Buffer& buffer, std::span<const T> values, const char* what) {
    reserve(device_, buffer, values.size_bytes(), what);
    device_.write(buffer, values);
  }

  void weigh(const ops::DeviceHemisphere& hemisphere, std::size_t count, const Buffer& directions,
             Buffer& out) {
    reserve(device_, out, count * ops::direction_words * sizeof(std::uint32_t),
            "weights of directions");
    hemisphere.weigh(device_, count, directions, out);
  }

  void look_up_masks(std::size_t level, const std::vector<std::uint32_t>& entries, Job& job) {
    if (entries.empty() || material_.mask_levels.empty()) return;
    const StageTimer timer(job, "look-ups");
    constexpr LookupShape lookup{4, 3, 1};
    const std::size_t count = entries.size();
    write(list_, std::span<const std::uint32_t>(entries), "entries of a level");
    reserve(device_, lookups_, count * lookup.words() * sizeof(std::uint32_t), "look-ups");
    const std::size_t channels = material_.mapping ? 2 : 1;
    reserve(device_, values_, count * channels * sizeof(float), "values looked up");
    ops::write_mask_lookups(device_, count, list_, tables_, lookups_);
    material_.mask_levels[level]->look_up(lookup, count, lookups_, values_);
    if (material_.mapping) {
      ops::set_opacities(device_, count, list_, values_, level == 0 ? &*material_.mapping : nullptr,
                         tables_);
    } else {
      ops::set_masks(device_, count, list_, values_, tables_);
    }
    device_.finish();
  }

  void light_level(std::size_t level, const std::vector<std::uint32_t>& entries, Job& job) {
    if (entries.empty()) return;
    const ops::ShadeLookups kind = lookups_of(level);
    const LookupShape lookup = ops::lookup_shape(kind);
    const std::size_t count = entries.size();
    {
      const StageTimer timer(job, "shading");
      write(list_, std::span<const std::uint32_t>(entries), "entries of a level");
      reserve(device_, lookups_, count * lookup.words() * sizeof(std::uint32_t), "look-ups");
      reserve(device_, values_, count * material_.info.shape.channels * sizeof(float),
              "values looked up");
      ops::write_lookups(device_, count, list_, tables_, kind, lookups_);
      device_.finish();
    }
    {
      DeviceSampler& sampler = *material_.levels[level];
      const StageTimer timer(job, "look-ups",
                             static_cast<double>(count) * sampler.lookup_flops(lookup));
      sampler.look_up(lookup, count, lookups_, values_);
      device_.finish();
    }
    const StageTimer timer(job, "shading");
    ops::light_entries(device_, material_.info, kind, count, list_, values_, tables_);
    device_.finish();
  }

  Device& device_;
  DeviceMaterial material_;
  ops::DeviceHemisphere views_;
  ops::DeviceHemisphere lights_;
  ops::ShadeTables tables_;
  HostTables host_;
  Entries point_entries_, sample_entries_;
  Buffer list_, lookups_, values_, radiance_;
};

// What is common to raw materials and models: `plan` holds what the finest levels take.
class MaterialMaker {
 public:
  MaterialMaker(Device& device, const BtfInfo& info, const Opacity* opacity, Job& job)
      : device_(device), job_(job), levels_(mip_levels(info.shape)) {
    material_.info = info;
    material_.info.mask.clear();
    material_.info.mask_distance.clear();
    if (opacity) material_.mapping = opacity->mapping;
    const MaskSources masks = mask_sources(info, opacity);
    material_.batch =
        std::clamp(job.memory / 4 / (point_bytes + sample_bytes), least_batch, resident_batch);
    plan_.add("batch of light samples", batch_bytes(material_.batch));
    if (!masks.finest) return;
    plan_.add("mask", 2 * masks.finest->info().bytes());
    // one source for all levels, where it is one
    const std::size_t own = masks.finest == masks.coarser ? levels_ : 1;
    add_mask_levels(masks.finest, 0, own);
    if (own < levels_) add_mask_levels(masks.coarser, own, levels_);
  }

  // A model's levels before those of images.
  void add_model(std::shared_ptr<const Model> model) {
    const Codec& codec = find_codec(model->info.codec);
    material_.model = model;
    std::vector<std::shared_ptr<const Model>> models{std::move(model)};
    std::size_t bytes = codec.sampler_bytes(*models[0]);
    while (models.size() < levels_) {
      std::shared_ptr<const Model> next = codec.next_mip_level(*models.back());
      if (!next) break;
      bytes += codec.sampler_bytes(*next);
      models.push_back(std::move(next));
    }
    plan_.add("model on the device", bytes);
    for (const auto& one : models) pending_.push_back(one);
    material_.grid_side = material_.model->view_grid();
    material_.own_levels = pending_.size();
    if (material_.grid_side > 0) material_.own_lookups = ops::ShadeLookups::grid;
    if (material_.model->takes_directions()) {
      material_.own_lookups = ops::ShadeLookups::directions;
    }
  }

  std::unique_ptr<Shader> finish(const std::shared_ptr<ImageStream>& images) {
    const std::size_t first = pending_.size();
    RawLevelsPlan raw_plan;
    bool streams = false;
    if (images) {
      // A share is left to those who make the points.
      const std::size_t share = job_.memory / 8;
      raw_plan =
          plan_raw_levels(device_, *images, first, levels_, room() - std::min(room(), share));
      plan_.add("images on the device", raw_plan.resident_bytes);
      plan_.add("images on their way", raw_plan.streaming_bytes);
      streams = raw_plan.first_resident > first;
    }
    if (streams) {
      // The more samples there are at once, the less often the images have to be gone through.
      const std::size_t bytes = batch_bytes(material_.batch) + room() / 2;
      material_.batch = std::clamp(bytes / (point_bytes + sample_bytes), material_.batch,
                                   std::min(streaming_batch, largest_batch()));
      plan_.items[0].bytes = batch_bytes(material_.batch);
    }
    job_.plan(plan_);
    material_.bytes = plan_.total();
    const StageTimer timer(job_, "load material");
    for (const auto& model : pending_) {
      material_.levels.push_back(find_codec(model->info.codec).sampler(device_, *model));
    }
    if (images) {
      for (auto& sampler : raw_samplers(device_, images, first, levels_, raw_plan)) {
        material_.levels.push_back(std::move(sampler));
      }
    }
    for (const MaskLevels& mask : masks_) {
      for (auto& sampler : raw_samplers(device_, mask.images, mask.first, mask.end, mask.plan)) {
        material_.mask_levels.push_back(std::move(sampler));
      }
    }
    device_.finish();
    return std::make_unique<DeviceShader>(device_, std::move(material_));
  }

  bool complete() const { return pending_.size() == levels_; }

 private:
  // Levels [first, end) of images of a mask.
  struct MaskLevels {
    std::shared_ptr<ImageStream> images;
    std::size_t first = 0;
    std::size_t end = 0;
    RawLevelsPlan plan;
  };

  void add_mask_levels(const std::shared_ptr<TileSource>& source, std::size_t first,
                       std::size_t end) {
    MaskLevels mask{source_images(device_, source), first, end, {}};
    mask.plan = plan_raw_levels(device_, *mask.images, first, end, job_.memory);
    plan_.add("mask on the device", mask.plan.resident_bytes + mask.plan.streaming_bytes);
    masks_.push_back(std::move(mask));
  }

  // What the plan and what the caller holds leave of the memory.
  std::size_t room() const {
    std::size_t taken = plan_.total();
    for (const MemoryItem& item : job_.held) taken += item.bytes;
    return job_.memory > taken ? job_.memory - taken : 0;
  }
  static std::size_t batch_bytes(std::size_t samples) {
    return samples * (point_bytes + sample_bytes);
  }
  // Samples whose records fit one allocation.
  std::size_t largest_batch() const {
    const std::size_t record = LookupShape{4, 3, 3}.words() * sizeof(std::uint32_t);
    return std::max(device_.limits().largest_allocation / record, resident_batch);
  }

  Device& device_;
  Job& job_;
  std::size_t levels_;
  DeviceMaterial material_;
  std::vector<MaskLevels> masks_;
  std::vector<std::shared_ptr<const Model>> pending_;
  MemoryPlan plan_;
};

}  // namespace

std::unique_ptr<Shader> make_device_shader(Device& device, std::shared_ptr<TileSource> raw,
                                           const Opacity* opacity, Job& job) {
  MaterialMaker maker(device, raw->info(), opacity, job);
  return maker.finish(source_images(device, std::move(raw)));
}

std::unique_ptr<Shader> make_device_shader(Device& device, std::shared_ptr<const Model> model,
                                           const BtfInfo& info, const Opacity* opacity, Job& job) {
  MaterialMaker maker(device, info, opacity, job);
  maker.add_model(model);
  if (maker.complete()) return maker.finish(nullptr);
  return maker.finish(decoded_images(device, std::move(model)));
}

}  // namespace weft
