// A picture of a BTF for people: a row of its images as PNG; beside a reconstruction, a row of the
// reconstruction's and a row of their difference, enlarged.
//
//   [ original i0 ][ original i1 ] ...
//   [ decoded  i0 ][ decoded  i1 ] ...
//   [ |difference| x N           ] ...
//
// Pixels are display values s: linear light times an exposure, sRGB encoded and clipped to [0, 1].
// The difference is N |s - s'| of the display values, so that it shows what an eye would see.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "weft/btf/tile.hpp"

namespace weft {

struct ContactSheetOptions {
  std::vector<std::size_t>
      images;                    // indices i = v L + l, in the order of the columns; at least one
  std::size_t per_row = 0;       // of the images; what is more begins new rows; 0 for all in one
  double difference_scale = 10;  // N
  // Factor on linear light; 0 chooses it: 1 for 8-bit data; for float data the factor that puts the
  // 99th percentile of the chosen images' values at 1 (1 where that is not positive).
  double exposure = 0;
  std::size_t spacing = 4;  // white pixels around every image
};

struct ContactSheet {
  std::size_t width = 0;
  std::size_t height = 0;
  double exposure = 1;
};

// `count` images (or all, if there are fewer) spread over views and lights.
std::vector<std::size_t> spread_images(const BtfShape& shape, std::size_t count);

// Writes the sheet; `decoded` may be null. Three or more channels show the first three as RGB,
// otherwise the first as grey. Throws an input error if the shapes of the two differ, if an image
// is out of range, or if a number of the options is not finite and positive (zero: exposure only).
ContactSheet write_contact_sheet(const std::filesystem::path& path, TileSource& original,
                                 TileSource* decoded, const ContactSheetOptions& options);

}  // namespace weft
