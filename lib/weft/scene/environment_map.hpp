// Light from all round: a picture of the radiance of every direction, sampled by importance.
//
// Rows run from the zenith (+z) to the nadir, columns from phi = 180 degrees at the left edge over
// 90, 0 in the middle and -90 to -180: what is seen by someone who looks along +x from the origin.
//
//   theta = pi (row + 1/2) / rows        phi = pi - 2 pi (column + 1/2) / columns
//
// A texel is drawn with a probability in proportion to its luminance times its solid angle, and a
// direction evenly from its solid angle, so that the density is luminance / (sum of luminance x
// solid angle), exactly, and 0 where the map is black.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <span>
#include <string_view>
#include <vector>

#include "weft/scene/reflectance.hpp"

namespace weft {

struct EnvironmentSample {
  Vector3 direction{0, 0, 1};  // towards the light, in the world
  std::array<float, 3> radiance{};
  double density = 0;  // per unit of solid angle; 0 where the map is black
};

class EnvironmentMap {
 public:
  // `radiance` [rows][columns][3], linear light, at most 1e20. Negative values, which resampling
  // filters leave, count as 0. Throws an input error that names `where`, the texel and the value.
  EnvironmentMap(std::size_t rows, std::size_t columns, std::vector<float> radiance,
                 std::string_view where);

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }
  std::size_t bytes() const {
    return radiance_.size() * sizeof(float) +
           (row_sums_.size() + column_sums_.size()) * sizeof(double);
  }

  // The texel of a direction of unit length, as lights see it.
  std::array<float, 3> radiance(const Vector3& direction) const;
  // Between texels, as a background shows it.
  std::array<float, 3> smooth_radiance(const Vector3& direction) const;
  // Of drawing a direction.
  double density(const Vector3& direction) const;
  // The direction that belongs to a point of the unit square [0, 1)^2.
  EnvironmentSample sample(const std::array<double, 2>& point) const;

 private:
  struct Texel {
    std::size_t row, column;
  };
  Texel texel_of(const Vector3& direction) const;
  std::array<float, 3> at(std::size_t row, std::size_t column) const;

  std::size_t rows_, columns_;
  std::vector<float> radiance_;
  std::vector<double> row_sums_;     // [rows + 1]: power of the rows above
  std::vector<double> column_sums_;  // [rows][columns + 1]: luminance of the texels to the left
};

// An EXR or a Radiance .hdr file with three channels.
EnvironmentMap read_environment_map(const std::filesystem::path& path);

}  // namespace weft
