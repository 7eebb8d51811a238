// Filtered look-ups: weighted sums of single texels of a BTF, wherever they lie.
//
//   out[i, c] = sum_{t < texels} sum_{a < views} sum_{b < lights} u_t v_a w_b T[v_a, l_b, p_t, c]
//
// All look-ups of one call have one shape, and each is a record of 32-bit words:
//
//   [ p, texels of them | v, views of them | l, lights of them | weights u | weights v | weights w
//   ]
//
// Indices are unsigned, p = y X + x; weights are floats, and a group of one tap has none: its
// weight is 1. A plain look-up (texel, view, light) is three words; one that is bilinear in its
// texels and barycentric in both directions has 10 indices and 10 weights. A tap of weight zero is
// not looked at, though its index must be valid.
//
// A model that is a function of all directions (Model::takes_directions) is looked up at one view
// and one light that need not be measured ones: vectors of any length in the place of indices,
//
//   [ p, texels of them | v, its x, y, z | l, its x, y, z | weights u ]
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "weft/btf/btf.hpp"

namespace weft {

struct LookupShape {
  std::size_t texels = 1;   // 1 or 4
  std::size_t views = 1;    // 1 or 3
  std::size_t lights = 1;   // 1 or 3
  bool directions = false;  // of one view and one light as vectors

  // Words of what is looked at, before the weights.
  constexpr std::size_t taps() const { return texels + (directions ? 6 : views + lights); }
  constexpr std::size_t weights() const {
    return (texels > 1 ? texels : 0) + (views > 1 ? views : 0) + (lights > 1 ? lights : 0);
  }
  // Words of a record.
  constexpr std::size_t words() const { return taps() + weights(); }
  bool operator==(const LookupShape&) const = default;
};

// The parts of one record.
struct Lookup {
  std::span<const std::uint32_t> texels;
  std::span<const std::uint32_t> views;  // of directions: the view's coordinates
  std::span<const std::uint32_t> lights;

  // A record's taps; `words` are shape.words().
  Lookup(const LookupShape& shape, std::span<const std::uint32_t> words);
  double texel_weight(std::size_t tap) const { return weight(texel_weights_, tap); }
  double view_weight(std::size_t tap) const { return weight(view_weights_, tap); }
  double light_weight(std::size_t tap) const { return weight(light_weights_, tap); }
  // Of directions.
  std::array<float, 3> view() const { return vector(views); }
  std::array<float, 3> light() const { return vector(lights); }

 private:
  static double weight(std::span<const std::uint32_t> words, std::size_t tap);
  static std::array<float, 3> vector(std::span<const std::uint32_t> words);

  std::span<const std::uint32_t> texel_weights_;  // empty: one tap of weight 1
  std::span<const std::uint32_t> view_weights_;
  std::span<const std::uint32_t> light_weights_;
};

// Throws an input error unless the shape is one of those above and a BTF of `shape` can be looked
// up in: its indices have to fit 32 bits, and directions have to be what it takes.
void validate(const LookupShape& lookup, const BtfShape& shape, bool takes_directions = false);

// Throws an input error that names the first look-up with an index out of range, with its value and
// the limit, with a weight that is not finite or a vector that is no direction; or one for words
// that are not whole records. A device trusts its look-ups: whatever comes from outside has to pass
// here first.
void validate_lookups(const LookupShape& lookup, const BtfShape& shape,
                      std::span<const std::uint32_t> records);

// Look-ups in double, by the reference.
class ReferenceSampler {
 public:
  virtual ~ReferenceSampler() = default;
  // out: [count][C], count the records in `lookups`, which are valid.
  virtual void look_up(const LookupShape& lookup, std::span<const std::uint32_t> lookups,
                       std::span<double> out) = 0;
};

}  // namespace weft
