// How image data enters and leaves every job: a source that is read, and a sink that is written, in
// runs of whole images. Image i = v L + l; an image is Y X C values, channel fastest.
//
//   source.read(first, count, out)        out: [count][Y][X][C] in the source's dtype
//   sink.write(first, count, values)      values: [count][Y][X][C] in the sink's dtype
//
// The image is the granule: a tile is a run of images, however many memory allows, and no result
// may depend on how many that is.
#pragma once

#include <cstddef>
#include <span>

#include "weft/btf/btf.hpp"

namespace weft {

// Where values come from. Not thread-safe: one thread reads.
class TileSource {
 public:
  virtual ~TileSource() = default;

  virtual const BtfInfo& info() const = 0;

  // Copies images [first, first + count) to `out`, which is exactly as large. Throws an input error
  // that names the file for data that can't be read or is not what was announced.
  virtual void read(std::size_t first, std::size_t count, std::span<std::byte> out) = 0;

  // Of a source whose texels have weights w_p: s_p = sqrt(w_p), with which their values were
  // multiplied after their weighted mean ABRDF was taken from them. Codecs then take none. Empty
  // where values are as they are.
  virtual std::span<const float> texel_scale() const { return {}; }

  // The images [first, first + count) where they lie in memory as they are (a mapped file), valid
  // while the source lives; empty if they do not.
  virtual std::span<const std::byte> mapped(std::size_t first, std::size_t count) {
    (void)first;
    (void)count;
    return {};
  }

  // Copies texels [first, first + count) of one image to `out`, [count][C], where a source that is
  // not mapped can do that without all of the image; false where it can't. Values are not checked.
  virtual bool read_part(std::size_t image, std::size_t first, std::size_t count,
                         std::span<std::byte> out) {
    (void)image;
    (void)first;
    (void)count;
    (void)out;
    return false;
  }

  // Says that images [first, first + count) will be asked for soon; a mapped source has the system
  // read their pages meanwhile.
  virtual void prefetch(std::size_t first, std::size_t count) {
    (void)first;
    (void)count;
  }

  // Says that images [first, first + count) were consumed for now; a mapped source gives their
  // pages back, so that a file larger than memory does not stay resident.
  virtual void release(std::size_t first, std::size_t count) {
    (void)first;
    (void)count;
  }
};

// Where values go. Not thread-safe: one thread writes, in ascending order of images, every image
// once.
class TileSink {
 public:
  virtual ~TileSink() = default;

  // What it expects: shape, dtype (U8, F16 or F32) and encoding of the values given to `write`.
  virtual const BtfInfo& info() const = 0;

  virtual void write(std::size_t first, std::size_t count, std::span<const std::byte> values) = 0;

  // Completes the output (flush, rename into place). Without it, destruction removes what was
  // written.
  virtual void finish() = 0;
};

}  // namespace weft
