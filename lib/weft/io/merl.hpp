// Isotropic BRDFs in the `.binary` format of the MERL data base (Matusik et al. 2003, "A
// Data-Driven Reflectance Model").
//
//   int32 [3]            90, 90, 180
//   float64 [3][90][90][180]   red, green, blue, little-endian
//
// Cell (h, d, p), at p + 180 (d + 90 h), is of the half vector's theta_h, the difference vector's
// theta_d and its azimuth phi_d (Rusinkiewicz 1998):
//
//   h = floor(90 sqrt(theta_h / 90)),  d = floor(theta_d),  p = floor(phi_d modulo 180)   (degrees)
//
// that is, cells of equal size in sqrt(theta_h); the value is taken for that of the cell's centre.
// Values times 1/1500, 1.15/1500, 1.66/1500 are the BRDF; negative ones (and such as are not
// finite) are invalid: their light or view is below the horizon, or they were not measured.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/io/mapped_file.hpp"

namespace weft {

inline constexpr std::size_t merl_theta_h = 90, merl_theta_d = 90, merl_phi_d = 180;
inline constexpr std::size_t merl_cells = merl_theta_h * merl_theta_d * merl_phi_d;

// A pair of directions in cells: a whole number is the centre of the cell of that number.
struct MerlPosition {
  double theta_h = 0, theta_d = 0, phi_d = 0;
};

// Of unit vectors in the upper hemisphere.
MerlPosition merl_position(const std::array<double, 3>& view, const std::array<double, 3>& light);

// The pair at a cell's centre, with the half vector's azimuth 0; nothing if one of the two is below
// the horizon.
struct DirectionPair {
  std::array<double, 3> view{}, light{};
};
std::optional<DirectionPair> merl_directions(std::size_t theta_h, std::size_t theta_d,
                                             std::size_t phi_d);

class MerlFile {
 public:
  // Throws an input error that names the file and what is wrong: its size, or its dimensions.
  explicit MerlFile(const std::filesystem::path& path);

  // R, G, B, by linear interpolation between the centres of the valid cells among the eight next to
  // the position; nothing if none of them is valid.
  std::optional<std::array<double, 3>> at(const MerlPosition& position) const;

  const std::filesystem::path& path() const { return file_.path(); }

 private:
  double cell(std::size_t channel, std::size_t index) const;

  MappedFile file_;
};

// Files as the texels of a row: image (v, l) is [1][files][3], F32, of a linear `brdf`. Where a
// file has no valid value it is 0.
std::shared_ptr<TileSource> open_merl(const std::vector<std::filesystem::path>& paths,
                                      std::vector<Direction> views, std::vector<Direction> lights);

// Writes value(pair) of every cell whose pair is above the horizon; the others are invalid, and so
// are those of negative values. The file appears whole or not at all.
using BrdfValue = std::function<std::array<double, 3>(const DirectionPair& pair)>;
void write_merl(const std::filesystem::path& path, const BrdfValue& value);

}  // namespace weft
