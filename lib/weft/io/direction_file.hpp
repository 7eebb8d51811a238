// Sets of directions as a user names them: usual ones, grids of angles, and files.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "weft/btf/directions.hpp"

namespace weft {

enum class DirectionRole { views, lights };

//   ubo81 ubo151 COUNT     direction_set()
//   grid:TxP[:MAX]         T angles theta from 0 to MAX (75) degrees in equal steps, each but the
//                          zenith with P azimuths from 0 on
//   NAME.json              lists `views` and `lights` as in btf_json.hpp, of which that of the role
//                          is read; or one list of directions
//   NAME.npy               [n, 3] unit vectors or [n, 2] theta and phi in degrees, float32 or
//   float64 NAME.safetensors       those of a raw BTF
//
// Throws an input error that names `option` or the file, the field and the value.
std::vector<Direction> read_direction_set(const std::string& text, DirectionRole role,
                                          std::string_view option);

}  // namespace weft
