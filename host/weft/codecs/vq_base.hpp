// Several materials compressed into one data base of shared code-books, or into one that is there:
// see lib/weft/model/vq_base.hpp. Code-books are made of all materials, one after the other, with
// thresholds that are parts of each material's own luminance; then all texels take their entries.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "weft/codecs/compress.hpp"
#include "weft/model/vq_base.hpp"

namespace weft {

struct MaterialSource {
  std::string name;
  std::shared_ptr<TileSource> source;
  std::string selection = "{}";  // what of the raw BTF the source is, as the model records it
  ColourRequest colour;
};

struct VqBaseResult {
  VqBase base;                          // as it is stored; the new materials are the last
  std::vector<MeasuredModel> measured;  // of each new one
  double encode_seconds = 0;            // with a goal, of all the search
  std::optional<GoalOutcome> goal;
};

// What the parameters and the colour transform are where an option does not say it: those of the
// data base that materials go into.
Parameters with_grid_of(const VqBase& base, Parameters parameters);

// Compresses the materials on the device, or by the reference if it is null, beside those of
// `existing`, which decode to the same bits then. A goal by errors is to be met by each of them,
// one by size by the whole file; its ratio counts what all materials were raw. Throws input errors
// for names that are there already, for materials that do not have in common what they must, and
// what compress() throws.
VqBaseResult compress_vq_base(Device* device, std::span<const MaterialSource> materials,
                              const CompressRequest& request, const VqBase* existing, Job& job);

}  // namespace weft
