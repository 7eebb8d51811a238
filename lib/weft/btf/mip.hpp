// Mip levels of one image: each level averages 2 x 2 texels of the one before in linear light. An
// odd last row or column averages what there is, so a side of n becomes ceil(n / 2).
#pragma once

#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include "weft/btf/encoding.hpp"

namespace weft {

// ceil(side / 2^level), at least 1.
std::size_t mip_side(std::size_t side, std::size_t level);

// The number of halvings that bring both sides to 1.
std::size_t last_mip_level(std::size_t height, std::size_t width);

// Averages `values`, [height][width][channels] in linear light, in place, `level` times; returns
// how many values are left.
std::size_t average_mip(std::vector<float>& values, std::size_t height, std::size_t width,
                        std::size_t channels, std::size_t level);

// An image reduced to `level`, in its own representation. 8-bit values round to nearest.
void reduce_to_mip(Representation representation, std::size_t height, std::size_t width,
                   std::size_t channels, std::size_t level, std::span<const std::byte> image,
                   std::span<std::byte> out, std::string_view where);

}  // namespace weft
