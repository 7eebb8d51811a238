// The slices of a material made once, for drawing lights at every point of a scene: the nodes of
// light_nodes.hpp for each measured view and each texel of a mip level that is coarse enough for
// all of them to be held. A point's density is that of the nodes of its nearest texel, interpolated
// between views. It is stated exactly, so that what it leaves out of the texture costs noise alone.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/hemisphere.hpp"
#include "weft/scene/light_nodes.hpp"

namespace weft {

class LightTables {
 public:
  // Looks up `records` of LookupShape{1, 1, 1} in a level, as [records][C] in the stored encoding.
  using LookUp = std::function<void(std::span<const std::uint32_t> records, std::span<double> out)>;

  // Of the mip level `level` of the material that `info` describes.
  LightTables(const BtfInfo& info, std::size_t level, const LookUp& look_up);

  // What is drawn from at a point with these texture coordinates, seen from `view`.
  BilinearDensity density(const std::array<float, 2>& uv, const std::array<float, 3>& view) const;

  std::size_t bytes() const { return nodes_.size() * sizeof(float); }

  // The level of tables of a material that has `levels`: the finest of at most 256 texels, and of
  // at most `memory` bytes unless it is the last one.
  static std::size_t choose_level(const BtfInfo& info, std::size_t levels, std::size_t memory);
  static std::size_t bytes(const BtfInfo& info, std::size_t level);

 private:
  std::size_t height_, width_;
  Hemisphere views_;
  LightNodes light_nodes_;
  std::vector<float> nodes_;  // [texels][V][nodes]
};

}  // namespace weft
