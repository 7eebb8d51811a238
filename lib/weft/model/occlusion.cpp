#include "weft/model/occlusion.hpp"

#include <algorithm>
#include <cmath>

#include "weft/error.hpp"

namespace weft {

std::string_view name_of(OcclusionKind kind) {
  return kind == OcclusionKind::mask ? "mask" : "distance";
}

OcclusionKind occlusion_kind_from_name(std::string_view name, std::string_view where) {
  for (const OcclusionKind kind : {OcclusionKind::mask, OcclusionKind::distance}) {
    if (name == name_of(kind)) return kind;
  }
  fail_input("{}: \"{}\" is none of mask, distance", where, name);
}

bool is_visible(OcclusionKind kind, double value) {
  return kind == OcclusionKind::mask ? value >= 0.5 : value > 0;
}

double VisibilityMapping::alpha(double value) const {
  if (value >= threshold) return 1;
  return value > 0 ? std::min(weight * value, 1.0) : 0;
}

VisibilityMapping default_mapping(OcclusionKind kind) {
  if (kind == OcclusionKind::mask) return {0.5, 1};
  return {0.05, 12};
}

void validate(const VisibilityMapping& mapping, std::string_view where) {
  if (!(std::isfinite(mapping.threshold) && mapping.threshold >= 0)) {
    fail_input("{}: threshold {}: a finite number of at least 0 is needed", where,
               mapping.threshold);
  }
  if (!(std::isfinite(mapping.weight) && mapping.weight > 0)) {
    fail_input("{}: weight {}: a finite number above 0 is needed", where, mapping.weight);
  }
}

double ErrorTexels::share() const {
  return texels == 0 ? 0 : static_cast<double>(wrong) / static_cast<double>(texels);
}

ErrorTexels count_error_texels(std::span<const std::uint8_t> mask, std::span<const float> decoded,
                               OcclusionKind kind) {
  if (mask.size() != decoded.size()) {
    fail_input("error texels: {} decoded values for a mask of {}", decoded.size(), mask.size());
  }
  ErrorTexels errors;
  errors.texels = mask.size();
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if ((mask[i] != 0) != is_visible(kind, decoded[i])) ++errors.wrong;
  }
  return errors;
}

BtfInfo occlusion_info(const BtfInfo& info) {
  BtfInfo result;
  result.shape = {info.shape.views, 1, info.shape.height, info.shape.width, 1};
  result.dtype = DType::f32;
  result.view_directions = info.view_directions;
  result.light_directions = {{0, 0, 1}};
  return result;
}

}  // namespace weft
