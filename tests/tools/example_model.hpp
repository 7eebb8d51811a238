// A small model file that no encoder made.
#pragma once

#include <filesystem>

#include "weft/btf/btf.hpp"

namespace weft::test {

// A `pca` model of rank 2 with random tensors, F32 storage and made-up errors (rmse 0.125, psnr
// 18.0625). Returns the path.
std::filesystem::path write_pca_model(const std::filesystem::path& path, const BtfShape& shape);

// A `tt` model of two texels, of which the first is infinity times 0 in float, and 0 in double.
std::filesystem::path write_overflowing_model(const std::filesystem::path& path);

}  // namespace weft::test
