// A BTF in other directions (weft/btf/resampling.hpp), computed on the device or by the reference,
// block of texels by block of texels: one product with the lights' matrices, one with the views'.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "weft/btf/resampling.hpp"
#include "weft/btf/tile.hpp"
#include "weft/codecs/tensor_tiles.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"

namespace weft {

// Blocks of texels in all their new directions, in device buffers.
class TexelResampler {
 public:
  // `device`, `source`, `resampling` and `job` must outlive it.
  TexelResampler(Device& device, TileSource& source, const Resampling& resampling, Job& job);

  // Throws an input error that names the first NaN or infinite value of the source, unless
  // job.nan_zero: in one pass over it. Nothing for 8-bit data.
  void check_values();

  // Calls work(values, first, count) for all texels in blocks, in order:
  //
  //   values    [view_count][L'][count][C] of the new views from `first_view` on
  //
  // in a buffer of at least view_count L' block_texels() C floats. One pass over the source.
  using Work = std::function<void(const Buffer& values, std::size_t first, std::size_t count)>;
  void for_each(std::size_t first_view, std::size_t view_count, const Work& work);

  // Most texels of a block: a function of the shapes alone.
  std::size_t block_texels() const { return block_; }
  Device& device() { return device_; }
  // Bytes of device and host memory in a pass over so many new views.
  std::size_t bytes(std::size_t view_count) const;
  // Of all texels, for a pass.
  double flops(std::size_t view_count) const;

 private:
  void resample(const Buffer& tile, std::size_t tile_texels, std::size_t first, std::size_t count,
                std::size_t first_view, std::size_t view_count);

  Device& device_;
  TileSource& source_;
  const Resampling& resampling_;
  Job& job_;
  std::size_t block_;
  TensorTiles tiles_;
  Buffer light_matrices_, view_matrix_, zenith_weights_;
  Buffer zenith_, frames_, values_;
};

// values [V'][L'][count][C] as [count][V' L'][C]: of onion slices, texels of
// [phi][theta][alpha][beta][C]. Does not wait.
void order_by_texel(Device& device, const Resampling& resampling, std::size_t channels,
                    std::size_t count, const Buffer& values, Buffer& texels);

// Images of T', for whoever reads image by image: as many new views at a time as job.memory has
// room for, each time in one pass over the source. Read it in ascending order; not for readers that
// use the same device from another thread meanwhile.
class ResampledSource final : public TileSource {
 public:
  // By the reference where `device` is null. `source` and `job` must outlive it. Plans the memory
  // of a pass, and throws an input error if one new view has no room.
  ResampledSource(Device* device, TileSource& source, Resampling resampling, Job& job);
  ResampledSource(const ResampledSource&) = delete;
  ResampledSource& operator=(const ResampledSource&) = delete;

  const BtfInfo& info() const override { return resampling_.info; }
  // Gives the images the masks of the nearest views.
  void take_masks() { weft::take_masks(source_.info(), resampling_, resampling_.info); }
  const Resampling& resampling() const { return resampling_; }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override;

  // New views of a pass, and passes.
  std::size_t views_of_pass() const { return views_of_pass_; }
  std::size_t passes() const {
    return (resampling_.new_views + views_of_pass_ - 1) / views_of_pass_;
  }

 private:
  void plan();
  void check_values();
  void hold(std::size_t first_view);
  void hold_by_device(std::size_t first_view, std::size_t view_count);
  void hold_by_reference(std::size_t first_view, std::size_t view_count);
  // Values of texels [first, first + count), [held views][L'][count][C], to where they are held.
  void place(std::span<const float> values, std::size_t first, std::size_t count);

  TileSource& source_;
  Resampling resampling_;
  Job& job_;
  std::unique_ptr<TexelResampler> resampler_;
  std::size_t views_of_pass_ = 1;
  std::size_t held_view_ = 0, held_views_ = 0;
  std::vector<float> held_;  // [held views][L'][P][C]
};

}  // namespace weft
