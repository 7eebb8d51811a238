#include "weft/scene/corduroy.hpp"

#include <cmath>
#include <numbers>

#include "weft/scene/tile_noise.hpp"

namespace weft {
namespace {

// Purposes of random numbers.
enum Key : std::uint64_t { sideways = 1, swelling, tufts, ends, strands, cloud, crush };

}  // namespace

void describe(Fields& fields, Corduroy& corduroy) {
  fields.count("wales", corduroy.wales, 1, 1024, "ribs of one tile");
  fields.number("length", corduroy.length, 0.5, 10000, "length of the tile along the wales, in mm");
  fields.seed(corduroy.seed);
  fields.color("color", corduroy.color, "diffuse albedo of the pile's tips");
  fields.color("root_color", corduroy.root_color, "diffuse albedo deep in the pile");
  fields.color("ground_color", corduroy.ground_color, "diffuse albedo of the ground");
  describe_gloss(fields, corduroy.gloss);
  fields.number("color_spread", corduroy.color_spread, 0, 1, "relative variation of the albedo");
  fields.number("wale_pitch", corduroy.wale_pitch, 0.1, 100, "distance of wales");
  fields.number("wale_width", corduroy.wale_width, 0.05, 100,
                "width of the pile; at most the pitch");
  fields.number("pile_height", corduroy.pile_height, 0, 50, "height of the pile");
  fields.number("shape", corduroy.shape, 1, 16, "exponent of the section: 2 a parabola");
  fields.number("wander", corduroy.wander, 0, 10, "sideways wander of the wales");
  fields.number("tuft_length", corduroy.tuft_length, 0.02, 100, "distance of tufts along a wale");
  fields.number("tuft_depth", corduroy.tuft_depth, 0, 10, "depth of the gaps between tufts");
  fields.number("nap", corduroy.nap, 0, 10, "roughness of the cut ends");
  fields.number("lean", corduroy.lean, 0, 4, "lean of the fibres along the wale");
}

void stretch(Corduroy& corduroy, double along_x, double along_y) {
  const double wales = std::round(static_cast<double>(corduroy.wales) * along_x);
  corduroy.wales = static_cast<std::size_t>(std::max(1.0, wales));
  corduroy.length *= along_y;
}

Surface make_surface(const Corduroy& corduroy, std::size_t columns, std::size_t rows) {
  check_fields("corduroy", corduroy);
  const auto wales = static_cast<double>(corduroy.wales);
  const std::array<double, 2> tile = {wales * corduroy.wale_pitch, corduroy.length};
  const TileNoise noise(tile[0], tile[1], corduroy.seed);
  const double half = 0.5 * std::min(corduroy.wale_width, corduroy.wale_pitch);
  // The ground is a plain weave of fine yarns.
  const double ground_x = std::round(wales * 6), ground_y = std::round(tile[1] / 0.4);
  return make_solid(columns, rows, tile, {corduroy.gloss}, [&](double x, double y, std::size_t) {
    // The wale here: its middle wanders.
    const auto wale =
        static_cast<std::uint64_t>(std::fmod(std::floor(x / corduroy.wale_pitch) + wales, wales));
    const double drift =
        corduroy.wander * noise.fractal(x, y, 3 * corduroy.wale_pitch, 2, sideways, 1.5);
    const double along = y / tile[1];
    const double middle = (static_cast<double>(wale) + 0.5) * corduroy.wale_pitch;
    const double offset = periodic_offset(x + drift, middle, tile[0]);
    const double width =
        half * (1 + 0.08 * noise.fractal(x, y, 1.2 * corduroy.tuft_length, 2, swelling));
    const double u = std::min(1.0, std::abs(offset) / width);
    const double section = 1 - std::pow(u, corduroy.shape);

    // Tufts of cut pile: rounded cells, longer across than along.
    const double stagger = hash_unit(noise.key(tufts) + wale) * corduroy.tuft_length;
    const Cell tuft = noise.cell(x, y + stagger, corduroy.tuft_length, 0.8, tufts);
    const double gap = std::min(1.0, tuft.nearest * tuft.nearest * 1.5);
    const double nap = noise.fractal(x, y, 0.28, 3, ends);
    const double strand = noise.fractal(x, y, 0.13, 2, strands);
    const double crushed = 1 + 0.10 * noise.fractal(x, y, 5, 2, crush);
    const double pile = corduroy.pile_height * section * crushed -
                        corduroy.tuft_depth * gap * section +
                        corduroy.nap * (nap + 0.5 * strand) * (0.25 + 0.75 * section);

    constexpr double turn = 2 * std::numbers::pi;
    const double weave =
        0.04 * std::cos(turn * ground_x * x / tile[0]) * std::cos(turn * ground_y * along);
    SurfacePoint point;
    const double bare = 1 - smooth_step(0.02, 0.18, section);
    point.elevation = std::max(pile, 0.0) + bare * weave;
    const double depth =
        std::clamp(0.30 * gap - 0.30 * nap - 0.18 * strand + 0.7 * (1 - section), 0.0, 1.0);
    const double tint = 1 + corduroy.color_spread * (noise.fractal(x, y, 4, 3, cloud) +
                                                     0.8 * (hash_unit(tuft.id + 7) - 0.5));
    point.albedo = shaded(
        mixed(mixed(corduroy.color, corduroy.root_color, depth), corduroy.ground_color, bare),
        tint);
    // Fibres fan out from the middle of the wale and lean along it.
    point.fibre_x = offset / half + 0.5 * nap;
    point.fibre_y = corduroy.lean + 0.3 * strand + 1e-3;
    if (std::hypot(point.fibre_x, point.fibre_y) < 1e-3) point.fibre_y = 1;
    return point;
  });
}

}  // namespace weft
