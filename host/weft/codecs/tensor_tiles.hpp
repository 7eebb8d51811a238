// A BTF streamed through a device as row-major tensors of floats, in either of two ways:
//
//   texels   all images of a block of texels: modes of directions are whole in every tile
//   images   all texels of a run of images: modes of texels are whole in every tile
//
// Tiles are functions of the shape alone. Values are those of the data times a power of two.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "weft/btf/mode_groups.hpp"
#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"

namespace weft {

// What a tile is as a tensor: one size per mode that is whole in it, in the order of the groups,
// and what else there is before or behind them.
//
//   texels   [groups of directions ...][rest]      rest = channels if alone, and the block's texels
//   images   [rest][groups of texels ...]          rest = the run's images, and channels of lights
struct TileModes {
  std::vector<std::size_t> modes;  // numbers of the groups
  bool rest_behind = true;

  // Sizes of a tile with `rest`, of modes that are `sizes` long (of all groups).
  std::vector<std::size_t> tile_sizes(const std::vector<std::size_t>& sizes,
                                      std::size_t rest) const;
  // Where in those sizes a group is.
  std::size_t position(std::size_t group) const;
};

class TensorTiles {
 public:
  enum class By { texels, images };

  TensorTiles(Device& device, TileSource& source, const ModeGroups& groups, By by, float scale,
              const Job& job);

  const TileModes& modes() const { return modes_; }
  // `rest` of the whole tensor, and of the largest tile.
  std::size_t rest() const { return rest_; }
  std::size_t largest_rest() const { return largest_rest_; }
  // Values of the largest tile.
  std::size_t largest_values() const { return largest_values_; }

  // Calls work(tile, first, count) for all tiles in order; they hold [first, first + count) of
  // each of the segments() that `rest` has.
  using Work = std::function<void(const Buffer& tile, std::size_t first, std::size_t count)>;
  void for_each(const Work& work);

  // Device and host memory that streaming holds.
  std::size_t bytes() const;

  // Channels that stand alone before a block of texels: `rest` is then [segments][P].
  std::size_t segments() const { return segments_; }

 private:
  void for_each_block(const Work& work);
  void for_each_run(const Work& work);
  std::size_t slot_texels() const;

  Device& device_;
  TileSource& source_;
  By by_;
  float scale_;
  bool nan_zero_;
  bool channels_first_;
  TileModes modes_;
  std::size_t granule_ = 0;  // texels or images
  std::size_t unit_ = 1;     // of `rest` per texel (without segments) or image
  std::size_t segments_ = 1;
  std::size_t rest_ = 1;
  std::size_t largest_rest_ = 1;
  std::size_t largest_values_ = 1;
};

}  // namespace weft
