// What a codec is to the program: one object of the table of codecs. A codec is added there and in
// no other place, and every subcommand has it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "weft/btf/lookup.hpp"
#include "weft/btf/selection.hpp"
#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/model/model.hpp"
#include "weft/model/model_file.hpp"

namespace weft {

class LightSampler;
class NestedModels;
struct NestedRequest;

// One parameter of a codec, an option `--NAME` of `weft compress`.
struct ParameterSpec {
  std::string_view name;
  std::string_view default_value;
  std::string_view help;
};

// Values of parameters by name, as text; absent ones take their default.
using Parameters = std::map<std::string, std::string, std::less<>>;

// Decodes images of one model in bulk, in order or not. Values are floats [count][Y][X][C] in the
// model's encoding, 8-bit data as [0, 1], not clamped.
class DeviceDecoder {
 public:
  virtual ~DeviceDecoder() = default;
  // Enqueues the decoding of images [first, first + count) into `out`; does not wait.
  virtual void decode(std::size_t first, std::size_t count, Buffer& out) = 0;
  // Flops of decoding one image.
  virtual double image_flops() const = 0;
};

// The same in double by the reference.
class ReferenceDecoder {
 public:
  virtual ~ReferenceDecoder() = default;
  virtual void decode(std::size_t first, std::size_t count, std::span<double> out) = 0;
};

// Looks up single texels of one model, or of whatever else has texels. Values are floats in its
// stored encoding, 8-bit data as [0, 1], not clamped.
class DeviceSampler {
 public:
  virtual ~DeviceSampler() = default;
  // Enqueues `count` look-ups (see weft/btf/lookup.hpp) from the records in `lookups`, which are
  // valid, into `out`, [count][C]; need not wait. A look-up's bits depend on nothing but its
  // record. Directions in the place of indices are for models that take them.
  virtual void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
                       Buffer& out) = 0;
  // Flops of one look-up, about.
  virtual double lookup_flops(const LookupShape& lookup) const = 0;
};

class Codec {
 public:
  virtual ~Codec() = default;

  virtual std::string_view name() const = 0;
  // One line for --help.
  virtual std::string_view summary() const = 0;
  virtual std::span<const ParameterSpec> parameters() const = 0;

  // Whether it takes a mean ABRDF from the texels before it fits them; what matters to weights, see
  // weighted_fit.hpp.
  virtual bool removes_mean() const { return false; }
  // Whether rows and columns are modes of their own, so that its models can only be divided by
  // products of factors of both.
  virtual bool separates_texels(const Parameters& parameters, const BtfShape& shape) const;

  // Whether weights can be divided out of its models.
  virtual bool takes_weights() const { return true; }
  // The colour transform of what it is to fit, where a user asks for none.
  virtual ColourTransform::Kind own_transform(const BtfInfo& source) const;

  // Fits a model to all of `source`. Its real-valued tensors are rounded to `storage`; info.errors
  // is left to the caller, who measures (see measure.hpp). Throws input errors for parameters that
  // make no sense, for NaN or infinite values (naming the first) and for a plan beyond job.memory.
  virtual std::unique_ptr<Model> encode(Device& device, TileSource& source,
                                        const Parameters& parameters, Storage storage,
                                        Job& job) const = 0;
  virtual std::unique_ptr<Model> encode_reference(TileSource& source, const Parameters& parameters,
                                                  Storage storage, Job& job) const = 0;

  // Whether it can be asked for a goal: by nested models, or by its own search.
  virtual bool takes_goals() const { return false; }
  // A decomposition of all of `source`, by the reference if the device is null, from which models
  // of several sizes can be cut: see nested_models.hpp. Parameters that are given bound it. Null
  // for a codec whose models are not nested; its parameter `target` then takes rel=EPS and
  // size=BYTES.
  virtual std::unique_ptr<NestedModels> nested(Device* device, TileSource& source,
                                               const Parameters& parameters,
                                               const NestedRequest& request, Job& job) const;

  // The part of a model that decodes to a selection (without its mip level, which is taken of
  // decoded images), with that of the model of its mask; the model itself is not changed.
  std::unique_ptr<Model> select(const Model& model, const Selection& selection) const;

  std::unique_ptr<DeviceDecoder> decoder(Device& device, const Model& model) const;
  // Bytes of device memory that the decoder holds.
  std::size_t decoder_bytes(const Model& model) const;
  std::unique_ptr<ReferenceDecoder> reference_decoder(const Model& model) const;

  // Look-ups in a model, and the bytes of device memory that they take. What is interpolated are
  // decoded values: a model with a nonlinear colour transform looks up every tap by itself, which
  // takes longer.
  std::unique_ptr<DeviceSampler> sampler(Device& device, const Model& model) const;
  std::size_t sampler_bytes(const Model& model) const;
  std::unique_ptr<ReferenceSampler> reference_sampler(const Model& model) const;

  // Draws directions to light as a model reflects them (weft/scene/light_sampling.hpp), on the
  // device or by the reference if it is null; device and model must outlive it. From the codec's
  // own tables, or by looking slices up and inverting them.
  std::unique_ptr<LightSampler> light_sampler(Device* device, const Model& model) const;
  // From the codec's own tables alone, null where they can't be drawn from; and by slices alone.
  std::unique_ptr<LightSampler> direct_light_sampler(Device* device, const Model& model) const;
  std::unique_ptr<LightSampler> slice_light_sampler(Device* device, const Model& model) const;

  // The model of the next mip level of a model of more than one texel, where averaging 2 x 2 texels
  // is exact in the model itself, as it needs a linear encoding and colour transform, or where the
  // model holds it; else null: levels are then taken of decoded images. A model of the mask is left
  // out.
  std::unique_ptr<Model> next_mip_level(const Model& model) const;
  // Whether the model holds the next level as it was fitted to the averages.
  bool holds_mip_level(const Model& model) const;

  // Bound of |device - reference| for one decoded value, from the lengths and magnitudes of the
  // sums behind it: the unit of `weft verify`.
  double decode_tolerance(const Model& model) const;

  virtual std::unique_ptr<Model> read(const ModelFile& file) const = 0;

 private:
  // What a codec itself knows of a model's tensors: the values that it was fitted to. The functions
  // above put the inverse of the model's colour transform behind it.
  virtual std::unique_ptr<Model> fitted_part(const Model& model,
                                             const Selection& selection) const = 0;
  std::unique_ptr<Model> select_values(const Model& model, const Selection& selection) const;
  virtual std::unique_ptr<DeviceDecoder> fitted_decoder(Device& device,
                                                        const Model& model) const = 0;
  virtual std::size_t fitted_decoder_bytes(const Model& model) const = 0;
  virtual std::unique_ptr<ReferenceDecoder> fitted_reference_decoder(const Model& model) const = 0;
  virtual std::unique_ptr<DeviceSampler> fitted_sampler(Device& device,
                                                        const Model& model) const = 0;
  virtual std::size_t fitted_sampler_bytes(const Model& model) const = 0;
  // By Model::fitted_texel, unless the codec knows a faster way.
  virtual std::unique_ptr<ReferenceSampler> fitted_reference_sampler(const Model& model) const;
  // None, unless the codec's tensors can be drawn from as they are.
  virtual std::unique_ptr<LightSampler> fitted_light_sampler(Device* device,
                                                             const Model& model) const;
  // None, unless the codec can.
  virtual std::unique_ptr<Model> fitted_mip_level(const Model& model) const;
  // Not, unless the codec's models do.
  virtual bool has_fitted_mip_level(const Model& model) const;
  // At least the rounding of a value to float: 2^-24 of the largest magnitude.
  virtual double fitted_tolerance(const Model& model) const = 0;

  friend double lookup_tolerance(const Codec& codec, const Model& model, const LookupShape& lookup);
};

// Bound of |device - reference| for one value of a look-up whose groups' weights are at least 0 and
// sum to 1.
double lookup_tolerance(const Codec& codec, const Model& model, const LookupShape& lookup);

// All codecs, by name.
std::span<const Codec* const> codecs();

// Throws an input error that lists the names if there is none of that name.
const Codec& find_codec(std::string_view name);

// Opens a `.weft` file with the codec it names, and the model of its mask with that one's.
std::unique_ptr<Model> read_model(const std::filesystem::path& path);
std::unique_ptr<Model> read_model(const ModelFile& file);

// A parameter's value as a whole number of at least `least`. Throws an input error that names the
// option and the value.
std::size_t count_parameter(const Codec& codec, const Parameters& parameters, std::string_view name,
                            std::size_t least);

}  // namespace weft
