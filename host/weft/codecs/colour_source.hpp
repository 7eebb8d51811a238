// A source as a codec is to fit it: its colour transform is chosen by the data, and applied to what
// is read.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "weft/btf/colour_transform.hpp"
#include "weft/btf/tile.hpp"
#include "weft/job.hpp"

namespace weft {

// What is asked for.
struct ColourRequest {
  ColourTransform::Kind kind = ColourTransform::Kind::none;
  std::vector<double> weights;  // of the transformed channels; empty: all are 1
};

// The transform with what it takes of the data, in one pass over it where it takes any:
//
//   log           s the mean magnitude, and the largest
//   logluv        s the mean magnitude, and the largest luminance
//   decorrelated  Q of the channels' covariance in double, by descending variance; each axis points
//                 to where its largest component is positive
//
// Images are added up one by one: the bits depend on nothing but the data. Throws input errors
// where the channels don't fit, for NaN or infinite values (naming the first) unless job.nan_zero,
// and for negative values under logluv (naming the first). What a TransformedSource will hold is
// added to job.held.
ColourTransform choose_colour_transform(TileSource& source, const ColourRequest& request, Job& job);

// The s of log alone: what log errors are taken with. 1 where all is 0.
double mean_magnitude(TileSource& source, Job& job);

// `source` transformed: F32, image by image as it is read. It must outlive it.
class TransformedSource final : public TileSource {
 public:
  TransformedSource(TileSource& source, ColourTransform transform, bool nan_zero);

  TileSource& original() const { return source_; }
  const ColourTransform& transform() const { return transform_; }

  const BtfInfo& info() const override { return info_; }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override;
  bool read_part(std::size_t image, std::size_t first, std::size_t count,
                 std::span<std::byte> out) override;
  void prefetch(std::size_t first, std::size_t count) override;
  void release(std::size_t first, std::size_t count) override;
  // Bytes of host memory that it holds.
  static std::size_t bytes(const BtfShape& shape) {
    return shape.image_values() * (sizeof(double) + sizeof(float));
  }

 private:
  // The first `texels` texels of image_, transformed, to `out`.
  void give(std::size_t texels, std::span<std::byte> out);

  TileSource& source_;
  ColourTransform transform_;
  bool nan_zero_;
  BtfInfo info_;
  std::vector<double> image_;
  std::vector<float> values_;
};

}  // namespace weft
