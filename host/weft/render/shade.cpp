#include "weft/render/shade.hpp"

#include <utility>
#include <vector>

#include "weft/codecs/codec.hpp"
#include "weft/codecs/decoded_source.hpp"
#include "weft/reference/lookup.hpp"
#include "weft/reference/shade.hpp"
#include "weft/render/device_shader.hpp"

namespace weft {
namespace {

// A sampler with what it looks up in.
template <typename Kept>
class KeepingSampler final : public ReferenceSampler {
 public:
  KeepingSampler(std::shared_ptr<Kept> kept, std::unique_ptr<ReferenceSampler> sampler)
      : kept_(std::move(kept)), sampler_(std::move(sampler)) {}
  void look_up(const LookupShape& lookup, std::span<const std::uint32_t> lookups,
               std::span<double> out) override {
    sampler_->look_up(lookup, lookups, out);
  }

 private:
  std::shared_ptr<Kept> kept_;
  std::unique_ptr<ReferenceSampler> sampler_;
};

std::unique_ptr<ReferenceSampler> sampler_of(std::shared_ptr<TileSource> source) {
  auto sampler = reference::tile_sampler(*source);
  return std::make_unique<KeepingSampler<TileSource>>(std::move(source), std::move(sampler));
}

std::unique_ptr<ReferenceSampler> sampler_of(std::shared_ptr<const Model> model) {
  auto sampler = find_codec(model->info.codec).reference_sampler(*model);
  return std::make_unique<KeepingSampler<const Model>>(std::move(model), std::move(sampler));
}

using Samplers = std::vector<std::unique_ptr<ReferenceSampler>>;

// Levels [samplers.size(), mip_levels) of a source, the first of which it is itself.
void add_levels(std::shared_ptr<TileSource> source, std::size_t levels, Samplers& samplers) {
  while (samplers.size() < levels) {
    samplers.push_back(sampler_of(source));
    if (samplers.size() < levels) source = next_mip_level(std::move(source));
  }
}

Samplers mask_samplers(const BtfInfo& info) {
  Samplers samplers;
  if (auto mask = mask_source(info)) add_levels(std::move(mask), mip_levels(info.shape), samplers);
  return samplers;
}

}  // namespace

std::unique_ptr<Shader> make_shader(Device* device, std::shared_ptr<TileSource> raw, Job& job) {
  validate_material(raw->info());
  if (device) return make_device_shader(*device, std::move(raw), job);
  const BtfInfo info = raw->info();
  Samplers samplers;
  add_levels(std::move(raw), mip_levels(info.shape), samplers);
  return reference::make_shader(info, std::move(samplers), mask_samplers(info));
}

std::unique_ptr<Shader> make_shader(Device* device, std::shared_ptr<const Model> model, Job& job) {
  validate_material(model->info.btf);
  if (device) return make_device_shader(*device, std::move(model), job);
  const BtfInfo info = model->info.btf;
  const Codec& codec = find_codec(model->info.codec);
  const std::size_t levels = mip_levels(info.shape);
  const std::size_t grid_side = model->view_grid();
  Samplers samplers;
  samplers.push_back(sampler_of(model));
  while (samplers.size() < levels) {
    std::shared_ptr<const Model> next = codec.next_mip_level(*model);
    if (!next) break;
    model = std::move(next);
    samplers.push_back(sampler_of(model));
  }
  reference::LevelsOfGrid grid;
  if (grid_side > 0) grid = {grid_side, samplers.size()};
  if (samplers.size() < levels) {
    // the codec has no levels of its own: those of its images
    add_levels(next_mip_level(decoded_source(nullptr, std::move(model))), levels, samplers);
  }
  return reference::make_shader(info, std::move(samplers), mask_samplers(info), grid);
}

}  // namespace weft
