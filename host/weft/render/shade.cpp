#include "weft/render/shade.hpp"

#include <utility>
#include <vector>

#include "weft/codecs/codec.hpp"
#include "weft/codecs/decoded_source.hpp"
#include "weft/codecs/occlusion.hpp"
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

// Levels [samplers.size(), levels) of a source, the level of that number it is itself.
void add_levels(std::shared_ptr<TileSource> source, std::size_t levels, Samplers& samplers) {
  while (samplers.size() < levels) {
    samplers.push_back(sampler_of(source));
    if (samplers.size() < levels) source = next_mip_level(std::move(source));
  }
}

Samplers mask_samplers(const BtfInfo& info, const Opacity* opacity) {
  Samplers samplers;
  const MaskSources masks = mask_sources(info, opacity);
  if (!masks.finest) return samplers;
  samplers.push_back(sampler_of(masks.finest));
  const std::size_t levels = mip_levels(info.shape);
  if (levels > 1) add_levels(next_mip_level(masks.coarser), levels, samplers);
  return samplers;
}

std::unique_ptr<Shader> reference_shader(const BtfInfo& info, Samplers samplers,
                                         const Opacity* opacity, reference::OwnLevels own = {}) {
  std::optional<VisibilityMapping> mapping;
  if (opacity) mapping = opacity->mapping;
  return reference::make_shader(info, std::move(samplers), mask_samplers(info, opacity), mapping,
                                own);
}

}  // namespace

std::unique_ptr<Shader> make_shader(Device* device, std::shared_ptr<TileSource> raw, Job& job,
                                    std::optional<VisibilityMapping> mapping) {
  validate_material(raw->info());
  const BtfInfo info = raw->info();
  std::optional<Opacity> opacity;
  if (mapping && !info.mask_distance.empty()) opacity = Opacity{*mapping, info.mask_distance};
  const Opacity* const used = opacity ? &*opacity : nullptr;
  if (device) return make_device_shader(*device, std::move(raw), used, job);
  Samplers samplers;
  add_levels(std::move(raw), mip_levels(info.shape), samplers);
  return reference_shader(info, std::move(samplers), used);
}

std::unique_ptr<Shader> make_shader(Device* device, std::shared_ptr<const Model> model, Job& job,
                                    std::optional<VisibilityMapping> mapping) {
  validate_material(model->info.btf);
  BtfInfo info = model->info.btf;
  std::optional<Opacity> opacity;
  if (const Occlusion* occlusion = model->info.occlusion.get()) {
    opacity =
        Opacity{mapping.value_or(occlusion->mapping), decode_occlusion(device, *occlusion, job)};
    info = with_mask(info, occlusion->kind, opacity->values);
  }
  const Opacity* const used = opacity ? &*opacity : nullptr;
  if (device) return make_device_shader(*device, std::move(model), info, used, job);
  const Codec& codec = find_codec(model->info.codec);
  const std::size_t levels = mip_levels(info.shape);
  reference::OwnLevels own{0, model->view_grid(), model->takes_directions()};
  Samplers samplers;
  samplers.push_back(sampler_of(model));
  while (samplers.size() < levels) {
    std::shared_ptr<const Model> next = codec.next_mip_level(*model);
    if (!next) break;
    model = std::move(next);
    samplers.push_back(sampler_of(model));
  }
  own.count = samplers.size();
  if (samplers.size() < levels) {
    // the codec has no levels of its own: those of its images
    add_levels(next_mip_level(decoded_source(nullptr, std::move(model))), levels, samplers);
  }
  return reference_shader(info, std::move(samplers), used, own);
}

}  // namespace weft
