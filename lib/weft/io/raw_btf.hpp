// Raw BTFs: `btf` [V,L,Y,X,C] with its directions in one safetensors file, and the NPY form.
#pragma once

#include <filesystem>
#include <memory>

#include "weft/btf/btf.hpp"
#include "weft/btf/tile.hpp"

namespace weft {

// Opens a raw BTF for reading: a `.safetensors` file, or a `.npy` with a `.json` of directions
// beside it. Memory-mapped: read() copies, mapped() does not. Throws an input error for anything
// that is not a valid raw BTF (see `validate` and SafetensorsFile). Values are not looked at here.
std::shared_ptr<TileSource> open_raw_btf(const std::filesystem::path& path);

// Creates a raw BTF file; the values come through the sink.
std::unique_ptr<TileSink> create_raw_btf(const std::filesystem::path& path, const BtfInfo& info);

}  // namespace weft
