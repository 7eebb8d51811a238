#include "weft/codecs/tensor_tiles.hpp"

#include <algorithm>

#include "weft/btf/texel_block.hpp"
#include "weft/device/read_ahead.hpp"
#include "weft/device/tile_stream.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/unfold_tile.hpp"

namespace weft {

std::vector<std::size_t> TileModes::tile_sizes(const std::vector<std::size_t>& sizes,
                                               std::size_t rest) const {
  std::vector<std::size_t> tile;
  if (!rest_behind) tile.push_back(rest);
  for (const std::size_t mode : modes) tile.push_back(sizes[mode]);
  if (rest_behind) tile.push_back(rest);
  return tile;
}

std::size_t TileModes::position(std::size_t group) const {
  const auto found = std::find(modes.begin(), modes.end(), group);
  return static_cast<std::size_t>(found - modes.begin()) + (rest_behind ? 0 : 1);
}

TensorTiles::TensorTiles(Device& device, TileSource& source, const ModeGroups& groups, By by,
                         float scale, const Job& job)
    : device_(device),
      source_(source),
      by_(by),
      scale_(scale),
      nan_zero_(job.nan_zero),
      channels_first_(groups.channels_first()) {
  const BtfShape& shape = source.info().shape;
  for (std::size_t g = 0; g < groups.count(); ++g) {
    if (groups.groups()[g].of_directions() == (by == By::texels)) modes_.modes.push_back(g);
  }
  modes_.rest_behind = by == By::texels;
  const bool channels_of_lights = groups.groups()[groups.group_of(Mode::channel)].of_directions();
  if (by == By::texels) {
    granule_ = texel_granule(shape);
    segments_ = channels_first_ && !channels_of_lights ? shape.channels : 1;
    unit_ = channels_first_ ? 1 : shape.channels;
    rest_ = shape.texels() * unit_ * segments_;
    largest_rest_ = std::min(granule_, shape.texels()) * unit_ * segments_;
    largest_values_ = std::min(granule_, shape.texels()) * shape.images() * shape.channels;
  } else {
    granule_ = image_granule(shape);
    unit_ = channels_of_lights ? shape.channels : 1;
    rest_ = shape.images() * unit_;
    largest_rest_ = granule_ * unit_;
    largest_values_ = granule_ * shape.image_values();
  }
}

// A slot holds many blocks: images that are not mapped are read whole for every slot, and of mapped
// ones the pages are found anew for every slot.
std::size_t TensorTiles::slot_texels() const {
  const BtfInfo& info = source_.info();
  const std::size_t most = std::size_t{source_.mapped(0, 1).empty() ? 256u : 96u} << 20;
  const std::size_t block =
      granule_ * info.shape.images() * info.shape.channels * size_of(info.dtype);
  const std::size_t blocks = std::max<std::size_t>(1, most / block);
  return std::min(blocks * granule_, ops::round_up(info.shape.texels(), granule_));
}

std::size_t TensorTiles::bytes() const {
  const BtfInfo& info = source_.info();
  const std::size_t tile = largest_values_ * sizeof(float);
  if (by_ == By::images) {
    return tile + TileStream(device_, source_, granule_).buffer_bytes();
  }
  const std::size_t slot = std::min(slot_texels(), info.shape.texels()) * info.shape.images() *
                           info.shape.channels * size_of(info.dtype);
  return tile + info.image_bytes() + read_ahead_bytes(device_, slot);
}

void TensorTiles::for_each(const Work& work) {
  if (by_ == By::texels) {
    for_each_block(work);
  } else {
    for_each_run(work);
  }
  device_.finish();
}

void TensorTiles::for_each_run(const Work& work) {
  const BtfInfo& info = source_.info();
  Buffer tile(device_, largest_values_ * sizeof(float), "tile");
  TileStream(device_, source_, granule_)
      .for_each([&](std::size_t first, std::size_t count, const Buffer& raw) {
        ops::unfold_tile(device_,
                         {count, info.shape.texels(), 0, info.shape.texels(), info.shape.channels,
                          info.dtype, nan_zero_, channels_first_},
                         raw, scale_, tile);
        work(tile, first * unit_, count * unit_);
      });
}

void TensorTiles::for_each_block(const Work& work) {
  const BtfInfo& info = source_.info();
  const BtfShape& shape = info.shape;
  const std::size_t slot = slot_texels();
  const std::size_t texel_bytes = shape.images() * shape.channels * size_of(info.dtype);
  const auto count_of = [&](std::size_t run) {
    return std::min(slot, shape.texels() - run * slot);
  };
  Buffer tile(device_, largest_values_ * sizeof(float), "tile");
  weft::for_each_run(
      device_, ops::ceil_div(shape.texels(), slot), std::min(slot, shape.texels()) * texel_bytes,
      [&](std::size_t run, std::span<std::byte> out) {
        const std::size_t bytes = count_of(run) * texel_bytes;
        read_texels(source_, run * slot, count_of(run), out.first(bytes));
        return bytes;
      },
      [&](std::size_t run, const Buffer& raw) {
        for (std::size_t first = 0; first < count_of(run); first += granule_) {
          const std::size_t count = std::min(granule_, count_of(run) - first);
          ops::unfold_tile(device_,
                           {shape.images(), count_of(run), first, count, shape.channels, info.dtype,
                            nan_zero_, channels_first_},
                           raw, scale_, tile);
          work(tile, (run * slot + first) * unit_, count * unit_);
        }
      });
}

}  // namespace weft
