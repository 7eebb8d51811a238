// File names that carry the directions of an image, as the goniometers of Bonn and Prague write
// them:
//
//   tv030_pv030/00008 tl000 pl000 tv030 pv030.jpg        tl000_pl000_tv000_pv000.png
//
// t = theta from the zenith, p = phi, l = light, v = view; integer or decimal degrees.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "weft/btf/directions.hpp"

namespace weft {

struct AnglePair {
  double theta = 0;
  double phi = 0;
};

struct NamedDirections {
  AnglePair view;
  AnglePair light;
};

// The directions in the last component of a file's name, in any order, separated by spaces or
// underscores; nothing if one of the four is absent or comes twice.
std::optional<NamedDirections> directions_in_name(std::string_view file);

// The shortest decimal angles whose direction is the given one within float rounding, as
// "t030 p022.5" pieces: { "030", "022.5" }.
struct AngleText {
  std::string theta;
  std::string phi;
};
AngleText angle_text(const Direction& direction);

// "tv030_pv030/00008 tl000 pl000 tv030 pv030.exr"; the ending comes with its dot.
std::string ubo_file_name(std::size_t index, const Direction& view, const Direction& light,
                          std::string_view ending);

}  // namespace weft
