// Look-ups in raw images and their mip levels.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/device/device.hpp"
#include "weft/device/tile_stream.hpp"

namespace weft {

// All images of a BTF, run by run in device memory.
class ImageStream {
 public:
  virtual ~ImageStream() = default;
  virtual const BtfInfo& info() const = 0;
  // Calls work(first, count, images) for every run of image_granule() images, in order.
  virtual void for_each(const TileStream::Work& work) = 0;
  // Bytes of device and host memory that this takes.
  virtual std::size_t bytes() const = 0;
};

// Those of a source; those of a model, decoded on the device when they are asked for, as floats.
std::shared_ptr<ImageStream> source_images(Device& device, std::shared_ptr<TileSource> source);
std::shared_ptr<ImageStream> decoded_images(Device& device, std::shared_ptr<const Model> model);

// Bytes of device memory that levels take: where each of them lies, and what streaming holds.
struct RawLevelsPlan {
  std::size_t first_resident = 0;  // levels from this one on are resident; the finer are streamed
  std::size_t resident_bytes = 0;
  std::size_t streaming_bytes = 0;  // a run of images, and of its levels, in the making
};

// The plan for levels [first, levels) of images: the coarser ones are resident, as many as
// `memory` and the device hold.
RawLevelsPlan plan_raw_levels(const Device& device, const ImageStream& images, std::size_t first,
                              std::size_t levels, std::size_t memory);

// Samplers of levels [first, levels), as planned. Goes through the images once where one is
// resident. A look-up in a streamed level goes through all images.
std::vector<std::unique_ptr<DeviceSampler>> raw_samplers(Device& device,
                                                         const std::shared_ptr<ImageStream>& images,
                                                         std::size_t first, std::size_t levels,
                                                         const RawLevelsPlan& plan);

}  // namespace weft
