// A TileSource streamed through a device, run of images by run of images.
#pragma once

#include <cstddef>
#include <functional>

#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"

namespace weft {

// Streams all images of a source in runs of `granule` images (the last may be shorter), as raw
// values in device buffers. Mapped sources are given to the device where they lie, and consumed
// pages are released; others are read by a thread of their own, one run ahead of the device.
class TileStream {
 public:
  TileStream(Device& device, TileSource& source, std::size_t granule);

  std::size_t granule() const { return granule_; }

  // Bytes of device and host memory that streaming takes beside the source's mapping.
  std::size_t buffer_bytes() const;

  // Calls work(first, count, raw) for every run, in order; `work` enqueues kernels that read `raw`
  // and need not wait for them. Throws what the source throws, and `interrupted` if a stop was
  // asked for.
  using Work = std::function<void(std::size_t first, std::size_t count, const Buffer& raw)>;
  void for_each(const Work& work);

 private:
  void for_each_mapped(const Work& work);
  void for_each_read(const Work& work);

  Device& device_;
  TileSource& source_;
  std::size_t granule_;
  bool mapped_;
};

// The fixed run of images that encoders and decoders of [P][C] images work in: as many as give
// products enough rows, but no more floats than `working_set` bytes hold, so that a run stays in a
// large cache. A function of the shape alone.
std::size_t image_granule(const BtfShape& shape);

}  // namespace weft
