#include "weft/codecs/codec.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <utility>

#include "weft/codecs/colour_decoders.hpp"
#include "weft/codecs/kcta.hpp"
#include "weft/codecs/lpca.hpp"
#include "weft/codecs/nested_models.hpp"
#include "weft/codecs/pca.hpp"
#include "weft/codecs/slice_light_sampler.hpp"
#include "weft/codecs/sparse.hpp"
#include "weft/codecs/tt.hpp"
#include "weft/codecs/tucker.hpp"
#include "weft/codecs/view_pca.hpp"
#include "weft/codecs/vq.hpp"
#include "weft/error.hpp"
#include "weft/model/channel_part.hpp"
#include "weft/model/occlusion.hpp"
#include "weft/reference/light_sampler.hpp"
#include "weft/reference/lookup.hpp"

namespace weft {

namespace {

// Null for all models but those of some channels.
const ChannelPart* as_part(const Model& model) {
  return dynamic_cast<const ChannelPart*>(&model);
}

// The indices of a selection of a selection.
std::vector<std::size_t> chosen_of(std::span<const std::size_t> of,
                                   const std::vector<std::size_t>& chosen) {
  std::vector<std::size_t> result;
  for (const std::size_t i : chosen) result.push_back(of[i]);
  return result;
}

// The part of a model of a mask that belongs to a selection of what it is the mask of.
std::shared_ptr<const Occlusion> select_occlusion(std::shared_ptr<const Occlusion> occlusion,
                                                  const Selection& selection) {
  if (!occlusion || (!selection.views && !selection.region)) return occlusion;
  Selection of_mask;
  of_mask.views = selection.views;
  of_mask.region = selection.region;
  auto selected = std::make_shared<Occlusion>(*occlusion);
  const Model& whole = *occlusion->model;
  selected->model = find_codec(whole.info.codec).select(whole, of_mask);
  return selected;
}

// A model with the codec that its file names, without that of its mask.
std::unique_ptr<Model> read_values(const ModelFile& file) {
  const auto table = codecs();
  const auto known = std::find_if(table.begin(), table.end(), [&](const Codec* codec) {
    return codec->name() == file.info().codec;
  });
  if (known == table.end()) {
    file.reject(fmt::format("codec '{}' is not one of this version", file.info().codec));
  }
  return (*known)->read(file);
}

}  // namespace

std::unique_ptr<NestedModels> Codec::nested(Device* /*device*/, TileSource& /*source*/,
                                            const Parameters& /*parameters*/,
                                            const NestedRequest& /*request*/, Job& /*job*/) const {
  return nullptr;
}

std::unique_ptr<Model> Codec::select(const Model& model, const Selection& selection) const {
  std::unique_ptr<Model> selected = select_values(model, selection);
  selected->info.occlusion = select_occlusion(model.info.occlusion, selection);
  return selected;
}

std::unique_ptr<Model> Codec::select_values(const Model& model, const Selection& selection) const {
  const ChannelPart* part = as_part(model);
  const Model& whole = part ? part->whole() : model;
  const ColourTransform& transform = whole.info.colour_transform;
  (void)weft::select(model.info.btf, selection);  // finds what does not fit
  if (!transform.mixes_channels()) {
    std::unique_ptr<Model> selected = fitted_part(model, selection);
    if (selection.channels) {
      selected->info.colour_transform = transform.select(*selection.channels);
    }
    return selected;
  }
  Selection others = selection;
  others.channels.reset();
  std::unique_ptr<Model> selected = fitted_part(whole, others);
  if (!part && !selection.channels) return selected;
  std::vector<std::size_t> channels;
  if (!part) {
    channels = *selection.channels;
  } else if (selection.channels) {
    channels = chosen_of(part->channels(), *selection.channels);
  } else {
    channels.assign(part->channels().begin(), part->channels().end());
  }
  return std::make_unique<ChannelPart>(std::move(selected), std::move(channels));
}

std::unique_ptr<DeviceDecoder> Codec::decoder(Device& device, const Model& model) const {
  if (const ChannelPart* part = as_part(model)) {
    return with_channels(device, part->whole().info.btf.shape, part->channels(),
                         decoder(device, part->whole()));
  }
  return with_inverse(device, model, fitted_decoder(device, model));
}

std::size_t Codec::decoder_bytes(const Model& model) const {
  if (const ChannelPart* part = as_part(model)) {
    return decoder_bytes(part->whole()) +
           channel_decoder_bytes(part->whole().info.btf.shape, part->channels().size());
  }
  return fitted_decoder_bytes(model) + inverse_bytes(model);
}

std::unique_ptr<ReferenceDecoder> Codec::reference_decoder(const Model& model) const {
  if (const ChannelPart* part = as_part(model)) {
    return with_channels(part->whole().info.btf.shape, part->channels(),
                         reference_decoder(part->whole()));
  }
  return with_inverse(model, fitted_reference_decoder(model));
}

std::unique_ptr<DeviceSampler> Codec::sampler(Device& device, const Model& model) const {
  if (const ChannelPart* part = as_part(model)) {
    return with_channels(device, part->whole().info.btf.shape, part->channels(),
                         sampler(device, part->whole()));
  }
  return with_inverse(device, model, fitted_sampler(device, model));
}

std::size_t Codec::sampler_bytes(const Model& model) const {
  if (const ChannelPart* part = as_part(model)) return sampler_bytes(part->whole());
  return fitted_sampler_bytes(model) + sampler_inverse_bytes(model);
}

bool Codec::separates_texels(const Parameters& parameters, const BtfShape& shape) const {
  (void)parameters;
  (void)shape;
  return false;
}

ColourTransform::Kind Codec::own_transform(const BtfInfo& source) const {
  (void)source;
  return ColourTransform::Kind::none;
}

std::unique_ptr<ReferenceSampler> Codec::reference_sampler(const Model& model) const {
  if (const ChannelPart* part = as_part(model)) {
    return with_channels(part->whole().info.btf.shape, part->channels(),
                         reference_sampler(part->whole()));
  }
  return with_inverse(model, fitted_reference_sampler(model));
}

std::unique_ptr<LightSampler> Codec::light_sampler(Device* device, const Model& model) const {
  if (auto direct = direct_light_sampler(device, model)) return direct;
  return slice_light_sampler(device, model);
}

std::unique_ptr<LightSampler> Codec::direct_light_sampler(Device* device,
                                                          const Model& model) const {
  if (as_part(model)) return nullptr;
  return fitted_light_sampler(device, model);
}

std::unique_ptr<LightSampler> Codec::slice_light_sampler(Device* device, const Model& model) const {
  if (device) return weft::slice_light_sampler(*device, model.info.btf, sampler(*device, model));
  return reference::slice_light_sampler(model.info.btf, reference_sampler(model));
}

std::unique_ptr<Model> Codec::next_mip_level(const Model& model) const {
  if (const ChannelPart* part = as_part(model)) {
    std::unique_ptr<Model> next = next_mip_level(part->whole());
    if (!next) return nullptr;
    return std::make_unique<ChannelPart>(
        std::move(next),
        std::vector<std::size_t>(part->channels().begin(), part->channels().end()));
  }
  if (!holds_mip_level(model) && !model.info.colour_transform.is_linear()) return nullptr;
  std::unique_ptr<Model> next = fitted_mip_level(model);
  if (next) next->info.occlusion = nullptr;
  return next;
}

bool Codec::holds_mip_level(const Model& model) const {
  const ChannelPart* part = as_part(model);
  return has_fitted_mip_level(part ? part->whole() : model);
}

double Codec::decode_tolerance(const Model& model) const {
  if (const ChannelPart* part = as_part(model)) return decode_tolerance(part->whole());
  return inverted_error(model.info.colour_transform, model.info.btf.shape.channels,
                        fitted_tolerance(model));
}

std::unique_ptr<ReferenceSampler> Codec::fitted_reference_sampler(const Model& model) const {
  return reference::texel_sampler(model);
}

std::unique_ptr<LightSampler> Codec::fitted_light_sampler(Device* /*device*/,
                                                          const Model& /*model*/) const {
  return nullptr;
}

std::unique_ptr<Model> Codec::fitted_mip_level(const Model& model) const {
  (void)model;
  return nullptr;
}

bool Codec::has_fitted_mip_level(const Model& model) const {
  (void)model;
  return false;
}

// A fitted value is a sum of n >= 1 terms, whose bound is gamma_n times their magnitude. Weights
// join m = T + V L + 2 roundings to each term, in whatever order the sums are taken, and gamma_{n +
// m} <= (1 + m) gamma_n / (1 - m n u), where one more covers the denominator. A linear transform is
// inverted on the sum. Another is on each tap, looked up by itself, and weights join T + V L + 1
// roundings to what is decoded: inverted_error is at least 8 u times the largest magnitude of that,
// so they add an eighth of it each, where two more cover the denominator and the weights' own
// rounding.
double lookup_tolerance(const Codec& codec, const Model& model, const LookupShape& lookup) {
  if (const ChannelPart* part = as_part(model)) {
    return lookup_tolerance(codec, part->whole(), lookup);
  }
  const ColourTransform& transform = model.info.colour_transform;
  const auto error = [&](const LookupShape& shape) {
    return inverted_error(transform, model.info.btf.shape.channels,
                          static_cast<double>(shape.texels + shape.views * shape.lights + 4) *
                              codec.fitted_tolerance(model));
  };
  if (transform.is_linear() || lookup == LookupShape{1, 1, 1}) return error(lookup);
  const auto roundings = static_cast<double>(lookup.texels + lookup.views * lookup.lights + 3);
  return (1 + roundings / 8) * error({1, 1, 1});
}

std::span<const Codec* const> codecs() {
  static const std::array<const Codec*, 9> table{
      &pca_codec(),    &view_pca_codec(), &lpca_codec(), &sparse_codec(), &tt_codec(),
      &tucker_codec(), &cta_codec(),      &kcta_codec(), &vq_codec()};
  return table;
}

const Codec& find_codec(std::string_view name) {
  std::string names;
  for (const Codec* codec : codecs()) {
    if (codec->name() == name) return *codec;
    names += (names.empty() ? "" : ", ") + std::string(codec->name());
  }
  fail_input("codec '{}': there is none of that name, only {}", name, names);
}

std::unique_ptr<Model> read_model(const std::filesystem::path& path) {
  return read_model(ModelFile(path));
}

std::unique_ptr<Model> read_model(const ModelFile& file) {
  std::unique_ptr<Model> model = read_values(file);
  if (file.has_occlusion()) {
    auto occlusion = std::make_shared<Occlusion>(file.occlusion());
    occlusion->model = read_values(file.occlusion_model());
    model->info.occlusion = std::move(occlusion);
  }
  return model;
}

std::size_t count_parameter(const Codec& codec, const Parameters& parameters, std::string_view name,
                            std::size_t least) {
  const auto specs = codec.parameters();
  const auto spec = std::find_if(specs.begin(), specs.end(),
                                 [&](const ParameterSpec& s) { return s.name == name; });
  const auto given = parameters.find(name);
  const std::string text =
      given != parameters.end() ? given->second : std::string(spec->default_value);
  std::size_t value = 0;
  const char* end = text.data() + text.size();
  const auto [stop, status] = std::from_chars(text.data(), end, value);
  if (status != std::errc() || stop != end || value < least) {
    fail_input("--{} {}: a whole number of at least {} is needed", name, text, least);
  }
  return value;
}

}  // namespace weft
