#include "weft/scene/leather.hpp"

#include <algorithm>
#include <cmath>

#include "weft/scene/tile_noise.hpp"

namespace weft {
namespace {

// Purposes of random numbers.
enum Key : std::uint64_t {
  bend_x = 1,
  bend_y,
  grain,
  sub_grain,
  fine,
  creases,
  crease_strength,
  pores,
  cloud,
  polish,
  relief
};

// 1 on the zero line of a noise, falling to 0 at `width`: lines that wind and end.
double line(double noise, double width) {
  const double t = std::min(1.0, std::abs(noise) / width);
  return (1 - t * t) * (1 - t * t);
}

}  // namespace

void describe(Fields& fields, Leather& leather) {
  fields.tile(leather.tile, 1, 1000, "width and depth in mm");
  fields.seed(leather.seed);
  fields.color("color", leather.color, "diffuse albedo of the grain");
  fields.color("groove_color", leather.groove_color, "diffuse albedo in the grooves");
  describe_gloss(fields, leather.gloss);
  fields.number("groove_roughness", leather.groove_roughness, 0.02, 1,
                "roughness in the grooves, where no polish reaches");
  fields.number("color_spread", leather.color_spread, 0, 1, "relative variation of the albedo");
  fields.number("cell_size", leather.cell_size, 0.05, 100, "mean width of a cell");
  fields.number("cell_jitter", leather.cell_jitter, 0, 1, "irregularity of the cells");
  fields.number("groove_width", leather.groove_width, 0.005, 10, "width of a groove");
  fields.number("grain_depth", leather.grain_depth, 0, 10, "depth of the grooves");
  fields.number("dome", leather.dome, 0, 10, "how far a cell bulges");
  fields.number("wrinkle_size", leather.wrinkle_size, 0.02, 100, "size of the fine wrinkles");
  fields.number("wrinkle_depth", leather.wrinkle_depth, 0, 10, "depth of the fine wrinkles");
  fields.number("crease_size", leather.crease_size, 0.05, 1000, "distance of long creases");
  fields.number("crease_depth", leather.crease_depth, 0, 10, "depth of long creases");
  fields.number("pore_spacing", leather.pore_spacing, 0.05, 100, "distance of pores");
  fields.number("pore_width", leather.pore_width, 0.005, 10, "width of a pore");
  fields.number("pore_depth", leather.pore_depth, 0, 10, "depth of a pore");
}

void stretch(Leather& leather, double along_x, double along_y) {
  leather.tile = {leather.tile[0] * along_x, leather.tile[1] * along_y};
}

Surface make_surface(const Leather& leather, std::size_t columns, std::size_t rows) {
  check_fields("leather", leather);
  const TileNoise noise(leather.tile[0], leather.tile[1], leather.seed);
  GlossyLobe matt = leather.gloss;
  matt.alpha_along = matt.alpha_across = static_cast<float>(leather.groove_roughness);
  const double size = leather.cell_size;
  return make_solid(
      columns, rows, leather.tile, {leather.gloss, matt},
      [&](double x, double y, std::size_t index) {
        // Cells with bent edges; larger ones are cut once more, more faintly.
        const double bx = x + 0.28 * size * noise.fractal(x, y, 0.9 * size, 2, bend_x);
        const double by = y + 0.28 * size * noise.fractal(x, y, 0.9 * size, 2, bend_y);
        const Cell cell = noise.cell(bx, by, size, leather.cell_jitter, grain);
        const Cell part = noise.cell(bx, by, 0.55 * size, leather.cell_jitter, sub_grain);
        const double breadth = leather.groove_width * (0.6 + 0.8 * hash_unit(cell.id + 3));
        const auto groove_of = [&](double border) {
          const double t = border / breadth;
          return std::exp(-t * t);
        };
        const double groove = groove_of(cell.border * size);
        const double cut = 0.35 * groove_of(1.6 * part.border * 0.55 * size);
        const double body = 1 - std::min(1.0, cell.nearest * cell.nearest);

        const double fine_noise = noise.fractal(bx, by, leather.wrinkle_size, 2, fine);
        const double wrinkle = line(fine_noise, 0.35) + 0.4 * noise.fractal(x, y, 0.2, 2, relief);
        const double strength =
            smooth_step(-0.25, 0.5, noise.fractal(x, y, leather.crease_size, 2, crease_strength));
        const double crease =
            strength * line(noise.fractal(bx, by, leather.crease_size, 2, creases, 1.6), 0.14);

        const Cell hole = noise.cell(x, y, leather.pore_spacing, 1, pores);
        const double r = hole.nearest * leather.pore_spacing / (0.5 * leather.pore_width);
        const double pore = hash_unit(hole.id + 3) < 0.7 ? std::exp(-r * r) : 0;

        SurfacePoint point;
        const double tilt = (hash_unit(cell.id + 4) - 0.5) * 0.5;
        point.elevation = leather.dome * body * (1 + tilt) -
                          leather.grain_depth * std::max(groove, cut) -
                          leather.crease_depth * crease - leather.wrinkle_depth * wrinkle -
                          leather.pore_depth * pore;
        const double dark = std::clamp(std::max({groove, 0.8 * cut, 0.8 * crease, pore}), 0.0, 1.0);
        const double tint = 1 + leather.color_spread * (noise.fractal(x, y, 6, 3, cloud) +
                                                        0.7 * (hash_unit(cell.id + 5) - 0.5));
        point.albedo = shaded(mixed(leather.color, leather.groove_color, dark), tint);
        // Polish ends gradually: the share of polished samples falls towards the grooves.
        point.lobe = hash_unit(noise.key(polish) + index) < 1 - 1.3 * dark ? 0 : 1;
        return point;
      });
}

}  // namespace weft
