// Which part of a BTF a job reads. Only what a scene requires is read, fitted, stored and decoded.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/tile.hpp"

namespace weft {

// A texel rectangle of the full-size image; row 0 is the top.
struct Region {
  std::size_t x = 0;
  std::size_t y = 0;
  std::size_t width = 0;
  std::size_t height = 0;
  bool operator==(const Region&) const = default;
};

// A list that is absent selects everything. Lists keep the order in which they were given, which
// becomes the order of the result.
struct Selection {
  std::optional<std::vector<std::size_t>> views;
  std::optional<std::vector<std::size_t>> lights;
  std::optional<Region> region;
  std::optional<std::vector<std::size_t>> channels;
  // Mip level: 0 the texels as they are; each further level averages 2 x 2 texels in linear light
  // (odd last rows and columns average what there is). The region is in texels of level 0.
  std::size_t level = 0;

  bool selects_all() const { return !views && !lights && !region && !channels && level == 0; }
};

// As text for a report or a model's metadata: a JSON object with the parts that are set.
std::string to_json(const Selection& selection);

// What `info` becomes under the selection. Throws an input error that names the part of the
// selection that does not fit. A `paired` BTF takes no light selection.
BtfInfo select(const BtfInfo& info, const Selection& selection);

// The selected part of `source` as a source of its own, reading image by image, in the dtype of the
// source. The result keeps `source` alive; without a selection it is `source` itself.
std::shared_ptr<TileSource> select(std::shared_ptr<TileSource> source, const Selection& selection);

}  // namespace weft
