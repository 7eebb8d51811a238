#include "weft/scene/knit.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "weft/error.hpp"
#include "weft/scene/tile_noise.hpp"
#include "weft/scene/yarn_sweep.hpp"

namespace weft {
namespace {

// Purposes of random numbers.
enum Key : std::uint64_t { yarns = 1, shift_x, shift_y, shift_z, swelling, stray };

constexpr std::size_t points_per_loop = 96;
constexpr std::size_t points_per_hair = 12;

// A place of course j at the loop parameter t (2 pi per loop).
std::array<double, 3> course_point(const Knit& knit, const TileNoise& noise, std::size_t course,
                                   double t) {
  const double x = t / (2 * std::numbers::pi) + knit.lean * std::sin(2 * t);
  const double y = (static_cast<double>(course) + 0.5 + 0.5 * knit.loop_height * std::cos(t)) *
                   knit.course_height;
  const double z = -knit.depth * std::cos(2 * t);
  // Irregularities are those of the place, so that loops that hold each other move together.
  const double amount = knit.irregularity;
  return {x + amount * noise.fractal(x, y, 1.7, 2, shift_x),
          y + amount * noise.fractal(x, y, 1.4, 2, shift_y),
          z + 0.8 * amount * noise.fractal(x, y, 1.9, 2, shift_z)};
}

}  // namespace

void describe(Fields& fields, Knit& knit) {
  fields.count("wales", knit.wales, 1, 512, "loops side by side of one tile");
  fields.count("courses", knit.courses, 2, 512, "rows of loops of one tile, an even number");
  fields.seed(knit.seed);
  fields.color("color", knit.color, "diffuse albedo");
  describe_gloss(fields, knit.gloss);
  fields.number("color_spread", knit.color_spread, 0, 1, "relative variation of the albedo");
  fields.number("course_height", knit.course_height, 0.3, 3, "distance of courses");
  fields.number("loop_height", knit.loop_height, 0.5, 2.2, "height of a loop, in courses");
  fields.number("lean", knit.lean, 0, 0.3, "of the legs: how far heads are wider than necks");
  fields.number("depth", knit.depth, 0, 1, "how far legs lie in front and heads behind");
  fields.number("width", knit.width, 0.05, 1, "width of the yarn");
  fields.number("thickness", knit.thickness, 0.02, 1, "thickness of the yarn");
  fields.count("plies", knit.plies, 1, 16, "strands that are twisted");
  fields.number("twists", knit.twists, -16, 16, "plies that pass per length");
  fields.number("ply_relief", knit.ply_relief, 0, 0.5, "depth of the grooves between plies");
  fields.number("fibre_relief", knit.fibre_relief, 0, 0.5, "height of single fibres");
  fields.number("irregularity", knit.irregularity, 0, 0.3, "of size and place, loop to loop");
  fields.number("hairs", knit.hairs, 0, 64, "stray fibres per loop; 0 leaves their layer out");
  fields.number("hair_length", knit.hair_length, 0.05, 4, "length of a stray fibre");
  fields.number("hair_width", knit.hair_width, 0.005, 0.2, "width of a stray fibre");
}

void stretch(Knit& knit, double along_x, double along_y) {
  const auto times = [](std::size_t count, double factor) {
    return std::max(1.0, std::round(static_cast<double>(count) * factor));
  };
  knit.wales = static_cast<std::size_t>(times(knit.wales, along_x));
  knit.courses = 2 * static_cast<std::size_t>(times(knit.courses / 2, along_y));
}

std::size_t knit_layers(const Knit& knit) {
  return knit.hairs > 0 ? 3 : 2;
}

Surface make_surface(const Knit& knit, std::size_t columns, std::size_t rows) {
  check_fields("knit", knit);
  if (knit.courses % 2 != 0) fail_input("knit: courses is {}, not an even number", knit.courses);
  const double width = static_cast<double>(knit.wales);
  const double depth = static_cast<double>(knit.courses) * knit.course_height;
  const TileNoise noise(width, depth, knit.seed);
  const std::size_t layers = knit_layers(knit);
  Surface surface = make_flat_surface(columns, rows, width, depth, layers);
  surface.lobes = {knit.gloss};
  clear_layers(surface);

  SweptYarn yarn{.color = knit.color,
                 .width = knit.width,
                 .thickness = knit.thickness,
                 .plies = knit.plies,
                 .twists = knit.twists,
                 .ply_relief = knit.ply_relief,
                 .fibre_relief = knit.fibre_relief,
                 .color_spread = knit.color_spread};
  constexpr double step = 2 * std::numbers::pi / points_per_loop;
  for (std::size_t j = 0; j < knit.courses; ++j) {
    YarnCurve curve;
    curve.closing = {width, 0};
    for (std::size_t i = 0; i < knit.wales * points_per_loop; ++i) {
      const auto point = course_point(knit, noise, j, static_cast<double>(i) * step);
      curve.points.push_back(point);
      curve.girth.push_back(1 + knit.irregularity *
                                    noise.fractal(point[0], point[1], 0.8, 2, swelling));
    }
    yarn.key = noise.key(yarns) + j;
    sweep_yarn(surface, j % 2, yarn, curve);
  }

  // Stray fibres leave the yarn somewhere and wander off over it.
  const auto hairs = static_cast<std::size_t>(
      std::round(knit.hairs * static_cast<double>(knit.wales * knit.courses)));
  SweptYarn hair{.color = shaded(knit.color, 1.15),
                 .width = knit.hair_width,
                 .thickness = knit.hair_width,
                 .plies = 1,
                 .twists = 0,
                 .ply_relief = 0,
                 .fibre_relief = 0,
                 .color_spread = 2 * knit.color_spread};
  for (std::size_t k = 0; k < hairs; ++k) {
    const std::uint64_t id = hash(noise.key(stray) + k);
    const auto u = [id](std::uint64_t purpose) { return hash_unit(id + purpose); };
    const auto course = static_cast<std::size_t>(u(1) * static_cast<double>(knit.courses));
    const double t = u(2) * width * 2 * std::numbers::pi;
    std::array<double, 3> place = course_point(knit, noise, course, t);
    double angle = 2 * std::numbers::pi * u(3);
    double climb = 0.5 * u(4);
    const double length = knit.hair_length * (0.4 + 1.2 * u(5)) / points_per_hair;
    const double bend = 2.5 * (u(6) - 0.5);
    place[2] += 0.45 * knit.thickness;
    YarnCurve curve;
    curve.closed = false;
    for (std::size_t i = 0; i < points_per_hair; ++i) {
      curve.points.push_back(place);
      place[0] += length * std::cos(angle);
      place[1] += length * std::sin(angle);
      place[2] += length * climb;
      const double jerk = hash_unit(id + 16 + i) - 0.5;
      angle += bend * 4 / points_per_hair + 0.7 * jerk;
      climb -= 1.1 / points_per_hair;
    }
    hair.key = id;
    sweep_yarn(surface, 2, hair, curve);
  }
  bound_holes(surface);
  finish_surface(surface);
  return surface;
}

}  // namespace weft
