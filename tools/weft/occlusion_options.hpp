// The options that say how a model keeps the mask of its material, and what reports say of it.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "report.hpp"
#include "weft/btf/btf.hpp"
#include "weft/codecs/occlusion.hpp"

namespace CLI {
class App;
}

namespace weft {

// T and W of eq. (26), where they are given.
struct MappingOptions {
  std::optional<double> threshold;
  std::optional<double> weight;

  bool any() const { return threshold || weight; }
};
void add_mapping_options(CLI::App& command, MappingOptions& options);
// `known` with what is given in its place. Throws input errors that name the option.
VisibilityMapping make_mapping(const MappingOptions& options, VisibilityMapping known);

// --occlusion and what belongs to it, as given.
struct OcclusionOptions {
  std::string model = "exact";
  std::string of;      // distance where nothing is given
  std::string errors;  // "100" or "0.1%"
  double band = 1;
  MappingOptions mapping;
};
void add_occlusion_options(CLI::App& command, OcclusionOptions& options);
// Null where the mask is to be kept as it is. Throws input errors that name the option.
std::optional<OcclusionRequest> make_occlusion_request(const OcclusionOptions& options,
                                                       const BtfInfo& info);

// Section `occlusion` of a model that has one.
void add_occlusion_section(Report& report, const ModelInfo& info);
// Fields `texels`, `error_texels`, `error_texel_share`.
void add_error_texel_fields(Report& report, const ErrorTexels& errors);

}  // namespace weft
