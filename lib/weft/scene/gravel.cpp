#include "weft/scene/gravel.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "weft/error.hpp"
#include "weft/scene/pile.hpp"
#include "weft/scene/tile_noise.hpp"

namespace weft {
namespace {

// Purposes of random numbers.
enum Key : std::uint64_t { drop = 1, sand, sand_grain, lumps, grains };

constexpr std::size_t heap_cells = 256;
constexpr std::size_t tries = 10;  // places a stone may come to rest at

// Stones settle until they touch; what is drawn settles by this share further, from the highest
// contact towards the mean gap, into space that is out of sight: a heap as dense as shaken ones.
constexpr double settling = 0.75;
constexpr std::size_t planes = 5;
constexpr double most_stones = 20000;

struct Stone {
  double x = 0, y = 0, z = 0;  // of the middle
  double a = 1, b = 1, c = 1;  // half axes
  double cosine = 1, sine = 0;
  double exponent = 2;
  std::array<std::array<double, 3>, planes> cuts{};   // slopes and height of the faces on top
  std::array<std::array<double, 3>, planes> sides{};  // normal and distance of the outline's faces
  std::size_t kind = 0;
  std::uint64_t id = 0;

  double radius() const { return 1.001 * std::max(a, b); }
};

// What of a stone lies over an offset (dx, dy) from its middle: height of the top above the
// middle over c, negative outside; (u, v) are the place in its own frame.
struct Place {
  double top = -1, bottom = 0;
  double u = 0, v = 0;
};

Place place_on(const Stone& stone, double dx, double dy) {
  Place place;
  place.u = (stone.cosine * dx + stone.sine * dy) / stone.a;
  place.v = (stone.cosine * dy - stone.sine * dx) / stone.b;
  double q = std::hypot(place.u, place.v);
  for (const auto& side : stone.sides) {
    q = std::max(q, (side[0] * place.u + side[1] * place.v) / side[2]);
  }
  if (q >= 1) return place;
  const double round = std::pow(1 - std::pow(q, stone.exponent), 1 / stone.exponent);
  place.top = round;
  place.bottom = -round;
  for (const auto& cut : stone.cuts) {
    place.top = std::min(place.top, cut[2] - cut[0] * place.u - cut[1] * place.v);
  }
  place.top = std::max(place.top, 0.0);
  return place;
}

Stone make_stone(const Gravel& gravel, std::uint64_t id, double progress) {
  const auto u = [id](std::uint64_t k) { return hash_unit(id + k); };
  Stone stone;
  stone.id = id;
  double total = 0;
  for (const StoneKind& kind : gravel.stones) total += kind.share;
  double left = u(1) * total;
  while (stone.kind + 1 < gravel.stones.size() && left >= gravel.stones[stone.kind].share) {
    left -= gravel.stones[stone.kind++].share;
  }
  const StoneKind& kind = gravel.stones[stone.kind];
  // Large stones come first, so that small ones fill the gaps, with exceptions.
  const double rank = std::clamp(progress + 0.5 * (u(2) - 0.5), 0.0, 1.0);
  const double size = gravel.least_size * std::pow(gravel.most_size / gravel.least_size,
                                                   std::pow(1 - rank, gravel.fineness));
  stone.a = 0.5 * size * (1 + 0.25 * u(3));
  stone.b = 0.5 * size * (1 - 0.25 * u(4));
  stone.c = 0.5 * size * kind.flatness * (0.8 + 0.4 * u(5));
  const double turn = 2 * std::numbers::pi * u(6);
  stone.cosine = std::cos(turn);
  stone.sine = std::sin(turn);
  stone.exponent = 2 + 1.2 * u(7);
  for (std::size_t k = 0; k < planes; ++k) {
    const double angle = 2 * std::numbers::pi * (static_cast<double>(k) + 0.8 * u(8 + k)) / planes;
    const double steep = kind.angularity * (0.15 + 0.75 * u(20 + k));
    const double height = 1.25 - kind.angularity * (0.25 + 0.45 * u(30 + k));
    stone.cuts[k] = {steep * std::cos(angle), steep * std::sin(angle), height};
    const double inside = 1.1 - kind.angularity * (0.12 + 0.28 * u(40 + k));
    stone.sides[k] = {std::cos(angle + 0.5), std::sin(angle + 0.5), inside};
  }
  return stone;
}

// How low the middle of a stone at (x, y) comes.
double rest_height(Pile& pile, const Stone& stone, double x, double y) {
  double contact = 0, sum = 0, cells = 0;
  pile.near(x, y, stone.radius(), [&](double& height, double dx, double dy) {
    const Place place = place_on(stone, dx, dy);
    if (place.top < 0) return;
    contact = std::max(contact, height - stone.c * place.bottom);
    sum += height - stone.c * place.bottom;
    cells += 1;
  });
  if (cells == 0) return 0;
  // On bare sand it sinks in by a part of its height.
  const double sunk = sum / cells - 0.45 * stone.c;
  return contact + settling * (sunk - contact);
}

std::vector<Stone> drop_stones(const Gravel& gravel, std::uint64_t key) {
  Pile pile(gravel.tile, heap_cells);
  const double area = gravel.tile[0] * gravel.tile[1];
  std::vector<Stone> stones;
  double covered = 0;
  while (covered < gravel.cover * area) {
    check_interrupt();
    Stone stone = make_stone(gravel, hash(key + stones.size()), covered / (gravel.cover * area));
    double best = std::numeric_limits<double>::infinity();
    for (std::uint64_t k = 0; k < tries; ++k) {
      const double x = hash_unit(stone.id + 50 + 2 * k) * gravel.tile[0];
      const double y = hash_unit(stone.id + 51 + 2 * k) * gravel.tile[1];
      const double rest = rest_height(pile, stone, x, y);
      if (rest < best) {
        best = rest;
        stone.x = x;
        stone.y = y;
        stone.z = rest;
      }
    }
    pile.near(stone.x, stone.y, stone.radius(), [&](double& height, double dx, double dy) {
      const Place place = place_on(stone, dx, dy);
      if (place.top >= 0) height = std::max(height, stone.z + stone.c * place.top);
    });
    covered += std::numbers::pi * stone.a * stone.b;
    stones.push_back(stone);
  }
  return stones;
}

// The colour of a stone at a place of its own, in millimetres.
std::array<float, 3> stone_color(const Stone& stone, const StoneKind& kind, const Place& place) {
  // Far from multiples of the periods, where the noise would repeat within a stone.
  constexpr std::int64_t period = 4096;
  const double x = place.u * stone.a + 97, y = place.v * stone.b + 89;
  const double cells = 1 / kind.grain_size;
  const double grain = gradient_noise(x * cells, y * cells, period, period, stone.id + grains);
  const double fine =
      gradient_noise(2.7 * x * cells, 2.7 * y * cells, period, period, stone.id + grains + 1);
  const double threshold = 0.8 * (0.5 - kind.grain_share);
  double weight = smooth_step(threshold - 0.12, threshold + 0.12, grain + 0.6 * fine);
  if (hash_unit(stone.id + 70) < kind.veins) {
    const double band = place.u * (hash_unit(stone.id + 71) - 0.5) + place.v + 0.15 * grain +
                        0.5 * (hash_unit(stone.id + 72) - 0.5);
    weight = std::max(weight, 1 - smooth_step(0.03, 0.11, std::abs(band)));
  }
  const double shade =
      1 + kind.color_spread * (2 * hash_unit(stone.id + 73) - 1) + 0.35 * kind.color_spread * fine;
  std::array<float, 3> color = mixed(kind.color, kind.grain_color, weight);
  // A little warmer or colder from stone to stone.
  const double warmth = 0.4 * kind.color_spread * (2 * hash_unit(stone.id + 74) - 1);
  color[0] *= static_cast<float>(1 + warmth);
  color[2] *= static_cast<float>(1 - warmth);
  return shaded(color, shade);
}

}  // namespace

void describe(Fields& fields, StoneKind& kind) {
  fields.number("share", kind.share, 0, 1e6, "of all stones, relative to the other kinds");
  fields.color("color", kind.color, "diffuse albedo");
  fields.color("grain_color", kind.grain_color, "diffuse albedo of the grains in it");
  fields.number("grain_size", kind.grain_size, 0.05, 100, "size of the grains");
  fields.number("grain_share", kind.grain_share, 0, 1, "share of the grains");
  fields.number("veins", kind.veins, 0, 1, "share of stones with a vein in the grains' colour");
  fields.number("color_spread", kind.color_spread, 0, 1, "relative, from stone to stone");
  describe_gloss(fields, kind.gloss);
  fields.number("angularity", kind.angularity, 0, 1, "0 a pebble, 1 crushed rock");
  fields.number("flatness", kind.flatness, 0.05, 2, "height over width");
  fields.number("roughness", kind.roughness, 0, 0.5, "height of lumps over width");
}

void describe(Fields& fields, Gravel& gravel) {
  fields.tile(gravel.tile, 1, 10000, "width and depth in mm");
  fields.seed(gravel.seed);
  fields.number("least_size", gravel.least_size, 0.1, 1000, "width of the smallest stones");
  fields.number("most_size", gravel.most_size, 0.1, 1000, "width of the largest stones");
  fields.number("fineness", gravel.fineness, 0.1, 10, "exponent: larger has fewer large stones");
  fields.number("cover", gravel.cover, 0, 10, "area of all stones together, in tiles");
  fields.color("sand_color", gravel.sand_color, "diffuse albedo of the sand beneath");
  describe_list(fields, "stones", gravel.stones, 1, 16, "kinds of stone");
}

void stretch(Gravel& gravel, double along_x, double along_y) {
  gravel.tile = {gravel.tile[0] * along_x, gravel.tile[1] * along_y};
}

Surface make_surface(const Gravel& gravel, std::size_t columns, std::size_t rows) {
  check_fields("gravel", gravel);
  const auto& tile = gravel.tile;
  if (gravel.most_size < gravel.least_size ||
      gravel.most_size * 1.25 > std::min(tile[0], tile[1])) {
    fail_input(
        "gravel: most_size is {}, not from least_size {} to 0.8 of the tile's shorter side {}",
        gravel.most_size, gravel.least_size, std::min(tile[0], tile[1]));
  }
  const double count = gravel.cover * tile[0] * tile[1] / (gravel.least_size * gravel.least_size);
  if (count > most_stones) {
    fail_input("gravel: cover {} and least_size {} ask for about {:.0f} stones, more than {}",
               gravel.cover, gravel.least_size, count, most_stones);
  }
  const TileNoise noise(tile[0], tile[1], gravel.seed);
  std::vector<GlossyLobe> lobes;
  for (const StoneKind& kind : gravel.stones) lobes.push_back(kind.gloss);
  lobes.push_back({{0.02f, 0.02f, 0.02f}, 1, 0.9f, 0.9f});
  const std::size_t sand_lobe = lobes.size() - 1;

  // The sand, and then stone by stone whatever is higher.
  Surface surface =
      make_solid(columns, rows, tile, std::move(lobes), [&](double x, double y, std::size_t) {
        SurfacePoint point;
        const double grain = noise.fractal(x, y, 0.9, 2, sand_grain);
        point.elevation = 0.03 * gravel.least_size * noise.fractal(x, y, 6, 2, sand) + 0.1 * grain;
        point.albedo = shaded(gravel.sand_color, 1 + 0.5 * grain);
        point.lobe = sand_lobe;
        return point;
      });
  SurfaceLayer& layer = surface.layers.front();
  for (const Stone& stone : drop_stones(gravel, noise.key(drop))) {
    const StoneKind& kind = gravel.stones[stone.kind];
    draw_around(
        surface, stone.x, stone.y, stone.radius(), [&](std::size_t index, double dx, double dy) {
          const Place place = place_on(stone, dx, dy);
          if (place.top < 0) return;
          // Lumps of two sizes, on the top alone.
          const double size = stone.a + stone.b;
          const double x = place.u * stone.a * 3.5 / size + 53,
                       y = place.v * stone.b * 3.5 / size + 61;
          const double lump = fractal_noise(x, y, 4096, 4096, 4, stone.id + lumps);
          const double rim = smooth_step(0, 0.35, place.top);
          const double z = stone.z + stone.c * place.top + kind.roughness * size * lump * rim;
          if (z <= layer.elevation[index]) return;
          layer.elevation[index] = static_cast<float>(z);
          layer.colors[index] = {stone_color(stone, kind, place), static_cast<float>(stone.kind)};
        });
  }
  finish_surface(surface);
  return surface;
}

}  // namespace weft
