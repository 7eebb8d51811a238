// NumPy's .npy format, versions 1.0 to 3.0: little-endian uint8, float16, float32, float64, C
// order. A BTF is none of float64.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/tensor/dtype.hpp"

namespace weft {

struct NpyHeader {
  DType dtype = DType::f32;
  std::vector<std::size_t> shape;
  std::size_t data_offset = 0;
};

// Reads and checks the header: magic, version, dtype, order, shape against the file's size. Throws
// an input error that names file, field and value.
NpyHeader read_npy_header(const std::filesystem::path& path);

// A version 1.0 header, padded so that the data begins at a multiple of 64 bytes.
std::string make_npy_header(DType dtype, const std::vector<std::size_t>& shape);

// [V,L,Y,X,C] with a `.json` of directions beside it (same name, other ending): see open_npy_btf.
// The JSON holds the mask, as runs, but no mask distance.
std::unique_ptr<TileSink> create_npy_btf(const std::filesystem::path& path, const BtfInfo& info);

// Reads such a pair. JSON: `views` and `lights`, lists of {"dir":[x,y,z]} or {"theta":..,"phi":..}
// in degrees, or of plain [x,y,z] or [theta,phi]; optionally `encoding`, `quantity`, `layout`,
// `source`, `channel_names`. Without an encoding: `linear` for float data, `srgb` for 8-bit data.
std::shared_ptr<TileSource> open_npy_btf(const std::filesystem::path& path);

}  // namespace weft
