// View-dependent occlusion texture functions (K-CTA, section 6.2): the mask of a material with
// holes as a tensor [V, 1, Y, X, 1] of numbers O that a codec compresses, either the binary mask
// itself, or the signed distances to the material's outline, see mask_distance.hpp, whose sharp
// edges survive compression. Decoded numbers become visibilities and opacities,
//
//   visible iff O > 0 (distances), O >= 1/2 (mask)
//   alpha = 1 where O >= T,  W O where T > O > 0,  0 elsewhere                            eq. (26)
//
// with alpha at most 1, whatever W is.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "weft/btf/btf.hpp"

namespace weft {

class Model;

// What a model of a mask was fitted to.
enum class OcclusionKind : std::uint8_t { mask, distance };

// "mask" "distance"; the inverse throws an input error that names `where` and the value.
std::string_view name_of(OcclusionKind kind);
OcclusionKind occlusion_kind_from_name(std::string_view name, std::string_view where);

bool is_visible(OcclusionKind kind, double value);

// T and W of eq. (26).
struct VisibilityMapping {
  double threshold = 0;
  double weight = 0;

  double alpha(double value) const;
  bool operator==(const VisibilityMapping&) const = default;
};

// As in figure 7: T = 0.5 and W = 1 of binary masks, 0.05 and 12 of distances.
VisibilityMapping default_mapping(OcclusionKind kind);
// Throws an input error that names `where` unless both are finite, T at least 0 and W above 0.
void validate(const VisibilityMapping& mapping, std::string_view where);

// Texels whose decoded visibility is not that of the mask (Table I).
struct ErrorTexels {
  std::size_t texels = 0;  // of all views
  std::size_t wrong = 0;

  double share() const;
  bool operator==(const ErrorTexels&) const = default;
};

struct Occlusion {
  OcclusionKind kind = OcclusionKind::distance;
  VisibilityMapping mapping;
  ErrorTexels errors;                  // as measured of the model as it is stored
  std::shared_ptr<const Model> model;  // of one light and one channel
};

// Of a mask and what was decoded for it, both [V][Y][X].
ErrorTexels count_error_texels(std::span<const std::uint8_t> mask, std::span<const float> decoded,
                               OcclusionKind kind);

// What a model of the mask of `info` decodes to: its views, texels and directions, one light, one
// channel, F32.
BtfInfo occlusion_info(const BtfInfo& info);

}  // namespace weft
