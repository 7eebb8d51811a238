// What every codec stores has in common. A model is named tensors plus metadata; a codec's own
// struct derives from Model and knows its tensors and how to decode one value plainly.
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/colour_transform.hpp"
#include "weft/error.hpp"
#include "weft/metrics/error_sums.hpp"
#include "weft/tensor/dtype.hpp"

namespace weft {

struct Occlusion;
struct Weights;

// How the real-valued tensors of a model are stored if they are not quantised.
enum class Storage : std::uint8_t { f16, f32 };

// A real-valued tensor as whole numbers, value = step code with |code| < 2^(bits - 1): the step of
// each component, 0 for one that is all zeros.
struct Quantisation {
  unsigned bits = 0;
  std::vector<float> steps;

  bool operator==(const Quantisation&) const = default;
};

struct ModelInfo {
  std::string codec;              // a name of the table of codecs
  std::string parameters = "{}";  // JSON object: what the encoder was asked and what it chose
  std::string selection = "{}";   // JSON object, see to_json(Selection)
  // Between what the codec was fitted to, which its tensors stand for, and what decoding gives.
  ColourTransform colour_transform;
  // JSON object that says by which weights the model was fitted, see weights_file.hpp; empty: none.
  // Factors of a model that has some are not orthonormal.
  std::string weights;
  Storage storage = Storage::f16;
  // Of the tensors, by name, that are quantised instead; see storage.hpp.
  std::map<std::string, Quantisation, std::less<>> quantised;
  // What decoding gives: shape, directions, encoding ...; dtype is that of the raw tensor.
  BtfInfo btf;
  // What stands for the mask where a model of it does, see occlusion.hpp; btf.mask is then empty.
  std::shared_ptr<const Occlusion> occlusion;
  std::optional<ErrorReport> errors;  // as measured by the encoder against its input
  std::string program_version;
};

// One tensor of a model as it is in memory: real-valued tensors as float (already rounded to what
// the storage can hold), indices as U8, U16 or U32.
struct ModelTensor {
  std::string name;
  std::vector<std::size_t> shape;
  DType dtype = DType::f32;           // F32 for real-valued tensors, whatever the storage
  std::span<const std::byte> values;  // owned by the model
  // Of a real-valued tensor: the axis whose indices are components with a scale of their own in F16
  // storage, and a step of their own if quantised; `no_component_axis` for one for the whole
  // tensor.
  std::size_t component_axis = no_component_axis;
  // Of a real-valued tensor that is not stored as info.storage says.
  std::optional<Storage> storage = std::nullopt;

  static constexpr std::size_t no_component_axis = static_cast<std::size_t>(-1);
};

class Model {
 public:
  virtual ~Model() = default;

  ModelInfo info;

  // In a fixed order.
  virtual std::vector<ModelTensor> tensors() const = 0;
  // The values of the real-valued ones among them, in the same order, to be rounded.
  virtual std::vector<std::span<float>> real_values() = 0;

  // Divides the tensors so that they decode to T / (s_v s_l s_p) where they decoded to T: what
  // undoes the weights that a model was fitted with. Factors are not orthonormal then. Where rows
  // and columns are modes of their own, s_p is the product of factors of both.
  virtual void divide(const Weights& factors) = 0;
  // Adds a mean ABRDF [V, L, C] to what is decoded, where the codec has one.
  virtual void add_mean(std::span<const float> mean) { (void)mean; }

  // The side N of a grid of N x N views beside the measured ones, see weft/btf/view_grid.hpp, or 0:
  // look-ups may ask for view V + e, the value at its entry e.
  virtual std::size_t view_grid() const { return 0; }

  // Whether it is a function of all directions of the hemisphere: look-ups may then be of any view
  // and light (LookupShape::directions), with nothing interpolated between measured ones.
  virtual bool takes_directions() const { return false; }

  // The C values of one texel for one view and light, in double. In the stored encoding, scaled as
  // the raw data (8-bit data: [0, 1]), not clamped. Indices are within info.btf.shape.
  void decode_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                    std::span<double> out) const {
    fitted_texel(view, light, y, x, out);
    info.colour_transform.invert(out);
  }

  // The same by the codec's formula alone: the values that it was fitted to, on which
  // info.colour_transform is still to be inverted.
  virtual void fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                            std::span<double> out) const = 0;
  // The same for any view and light, vectors of any length; of a model that takes directions.
  virtual void fitted_texel_at(const Direction& view, const Direction& light, std::size_t y,
                               std::size_t x, std::span<double> out) const {
    (void)view, (void)light, (void)y, (void)x, (void)out;
    fail_runtime("values of directions that were not measured, of a model without them");
  }
};

}  // namespace weft
