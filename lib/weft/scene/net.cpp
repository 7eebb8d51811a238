#include "weft/scene/net.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "weft/error.hpp"
#include "weft/scene/tile_noise.hpp"
#include "weft/scene/yarn_sweep.hpp"

namespace weft {
namespace {

// Purposes of random numbers.
enum Key : std::uint64_t { cords = 1, knots, sag_x, sag_y, sag_z, turns };

constexpr std::size_t points_per_leg = 16;
constexpr std::size_t points_per_arc = 14;
constexpr std::size_t arcs = 6;  // of a knot: pieces short enough not to cross themselves

// Where the knots are.
class KnotGrid {
 public:
  KnotGrid(const Net& net, const TileNoise& noise) : net_(net), key_(noise.key(knots)) {}

  // Knot k of row j; both may be beyond the tile.
  std::array<double, 2> at(std::int64_t j, std::int64_t k) const {
    const auto rows = static_cast<std::int64_t>(net_.rows);
    const auto meshes = static_cast<std::int64_t>(net_.meshes);
    const std::int64_t row = (j % rows + rows) % rows, column = (k % meshes + meshes) % meshes;
    const std::uint64_t id = hash(key_ + static_cast<std::uint64_t>(row * meshes + column));
    const double shift = row % 2 == 0 ? 0.25 : 0.75;
    return {(static_cast<double>(k) + shift) * net_.mesh +
                net_.irregularity * (2 * hash_unit(id + 1) - 1),
            (static_cast<double>(j) + 0.5) * net_.row_height +
                net_.irregularity * (2 * hash_unit(id + 2) - 1)};
  }

 private:
  const Net& net_;
  std::uint64_t key_;
};

// The trefoil's curve, whose crossings look like those of a pulled knot.
std::array<double, 3> knot_point(double t, double radius, double height) {
  return {radius * (std::sin(t) + 2 * std::sin(2 * t)) / 3,
          radius * (std::cos(t) - 2 * std::cos(2 * t)) / 3, -height * std::sin(3 * t)};
}

}  // namespace

void describe(Fields& fields, Net& net) {
  fields.count("meshes", net.meshes, 1, 512, "meshes side by side of one tile");
  fields.count("rows", net.rows, 2, 512, "rows of knots of one tile, an even number");
  fields.seed(net.seed);
  fields.color("color", net.color, "diffuse albedo");
  describe_gloss(fields, net.gloss);
  fields.number("color_spread", net.color_spread, 0, 1, "relative variation of the albedo");
  fields.number("mesh", net.mesh, 0.5, 1000, "width of a mesh, in mm");
  fields.number("row_height", net.row_height, 0.25, 1000, "distance of the rows of knots");
  fields.number("width", net.width, 0.02, 500, "width of the cord");
  fields.number("thickness", net.thickness, 0.02, 500, "thickness of the cord");
  fields.count("plies", net.plies, 1, 16, "strands that are twisted");
  fields.number("twists", net.twists, -16, 16, "plies that pass per mm");
  fields.number("ply_relief", net.ply_relief, 0, 50, "depth of the grooves between plies");
  fields.number("fibre_relief", net.fibre_relief, 0, 50, "height of single fibres");
  fields.number("knot_size", net.knot_size, 0.5, 4, "width of a knot, in widths of the cord");
  fields.number("irregularity", net.irregularity, 0, 100, "displacement of the knots");
  fields.number("sag", net.sag, 0, 100, "of the cords, up, down and sideways");
}

void stretch(Net& net, double along_x, double along_y) {
  const auto times = [](std::size_t count, double factor) {
    return std::max(1.0, std::round(static_cast<double>(count) * factor));
  };
  net.meshes = static_cast<std::size_t>(times(net.meshes, along_x));
  net.rows = 2 * static_cast<std::size_t>(times(net.rows / 2, along_y));
}

Surface make_surface(const Net& net, std::size_t columns, std::size_t rows) {
  check_fields("net", net);
  if (net.rows % 2 != 0) fail_input("net: rows is {}, not an even number", net.rows);
  const double width = static_cast<double>(net.meshes) * net.mesh;
  const double depth = static_cast<double>(net.rows) * net.row_height;
  const TileNoise noise(width, depth, net.seed);
  const KnotGrid grid(net, noise);
  Surface surface = make_flat_surface(columns, rows, width, depth);
  surface.lobes = {net.gloss};
  clear_layers(surface);

  SweptYarn cord{.color = net.color,
                 .width = net.width,
                 .thickness = net.thickness,
                 .plies = net.plies,
                 .twists = net.twists,
                 .ply_relief = net.ply_relief,
                 .fibre_relief = net.fibre_relief,
                 .color_spread = net.color_spread};
  for (std::size_t j = 0; j < net.rows; ++j) {
    // From knot to knot, up and down.
    YarnCurve curve;
    curve.closing = {width, 0};
    const auto row = static_cast<std::int64_t>(j);
    const bool even = j % 2 == 0;
    for (std::size_t leg = 0; leg < 2 * net.meshes; ++leg) {
      const auto k = static_cast<std::int64_t>(leg / 2);
      const bool up = leg % 2 == 0;
      // The row above is half a mesh to the right of an even row, and to the left of an odd one.
      const std::int64_t above = even ? k : k + 1;
      const std::array<double, 2> from = up ? grid.at(row, k) : grid.at(row + 1, above);
      const std::array<double, 2> to = up ? grid.at(row + 1, above) : grid.at(row, k + 1);
      for (std::size_t i = 0; i < points_per_leg; ++i) {
        const double t = static_cast<double>(i) / points_per_leg;
        const double x = from[0] + t * (to[0] - from[0]), y = from[1] + t * (to[1] - from[1]);
        const double free = net.sag * std::sin(std::numbers::pi * t);
        curve.points.push_back({x + 0.7 * free * noise.fractal(x, y, net.mesh, 2, sag_x),
                                y + 0.7 * free * noise.fractal(x, y, net.mesh, 2, sag_y),
                                free * noise.fractal(x, y, net.mesh, 2, sag_z)});
      }
    }
    cord.key = noise.key(cords) + j;
    sweep_yarn(surface, 0, cord, curve);
  }

  SweptYarn wrap = cord;
  wrap.width = 0.72 * net.width;
  wrap.thickness = 0.72 * net.thickness;
  const double radius = 0.5 * net.width * net.knot_size;
  for (std::size_t j = 0; j < net.rows; ++j) {
    for (std::size_t k = 0; k < net.meshes; ++k) {
      const auto place = grid.at(static_cast<std::int64_t>(j), static_cast<std::int64_t>(k));
      const std::uint64_t id = hash(noise.key(turns) + j * net.meshes + k);
      const double turn = 0.8 * (hash_unit(id) - 0.5) + (hash_unit(id + 1) < 0.5 ? 0 : 2);
      const double size = radius * (0.9 + 0.2 * hash_unit(id + 2));
      for (std::size_t arc = 0; arc < arcs; ++arc) {
        YarnCurve curve;
        curve.closed = false;
        for (std::size_t i = 0; i <= points_per_arc; ++i) {
          const double t = 2 * std::numbers::pi / arcs *
                           (static_cast<double>(arc) + static_cast<double>(i) / points_per_arc);
          const auto p = knot_point(t, size, 0.4 * net.thickness);
          curve.points.push_back({place[0] + std::cos(turn) * p[0] - std::sin(turn) * p[1],
                                  place[1] + std::sin(turn) * p[0] + std::cos(turn) * p[1],
                                  0.25 * net.thickness + p[2]});
        }
        wrap.key = id;
        sweep_yarn(surface, 0, wrap, curve);
      }
    }
  }
  bound_holes(surface);
  finish_surface(surface);
  return surface;
}

}  // namespace weft
