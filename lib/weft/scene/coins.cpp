#include "weft/scene/coins.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "weft/error.hpp"
#include "weft/scene/pile.hpp"
#include "weft/scene/tile_noise.hpp"

namespace weft {
namespace {

constexpr double turn = 2 * std::numbers::pi;

// Purposes of random numbers.
enum Key : std::uint64_t { toss = 1, felt, fibres, stains, scratches, polish };

constexpr std::size_t heap_cells = 96;
constexpr std::size_t tries = 5;                 // places a coin may come to rest at
constexpr std::size_t sheets = coin_layers - 1;  // layers of topmost coins
constexpr double most_coins = 2000;
constexpr double steepest = 0.7;  // slope of a coin
// How far a sheet's tables go on past the edge, in radii, and at least in cells: the outline lies
// between samples of the same coin.
constexpr double least_apron = 0.03;
constexpr double least_apron_cells = 1.5;
constexpr double letters = 26;  // round a coin

struct Coin {
  double x = 0, y = 0;
  double rest = 0, slope_x = 0, slope_y = 0;  // the plane of its lower face
  double cosine = 1, sine = 0;
  double radius = 1, thickness = 1;
  std::size_t kind = 0;
  bool head = false;
  std::uint64_t id = 0;

  double plane(double dx, double dy) const { return rest + slope_x * dx + slope_y * dy; }
};

// Signs that look like letters from afar: strokes on a grid of 3 x 5.
double legend(double angle, double r, std::uint64_t id) {
  const double place = (angle / turn + 1) * letters;
  const auto letter = static_cast<std::uint64_t>(std::fmod(std::floor(place), letters));
  const double across = (place - std::floor(place)) * 4 - 0.5;
  const double up = (r - 0.66) / 0.14 * 5;
  if (across < 0 || across >= 3 || up < 0 || up >= 5) return 0;
  const std::uint64_t bits = hash(id + letter);
  if (bits % 8 == 0) return 0;  // a space between words
  const auto column = static_cast<std::uint64_t>(across), row = static_cast<std::uint64_t>(up);
  // Uprights at the sides, and bars at the bottom, the middle and the top.
  const bool side = column != 1 && ((bits >> (8 + column)) & 3u) != 0;
  const bool bar = row % 2 == 0 && ((bits >> (16 + row)) & 3u) != 0;
  if (!side && !bar) return 0;
  const double edge_x = std::abs(across - std::floor(across) - 0.5);
  const double edge_y = std::abs(up - std::floor(up) - 0.5);
  return 0.7 + 0.3 * (1 - 2 * std::max(edge_x, bar ? 0.0 : edge_y) * 0.5);
}

double ellipse(double u, double v, double x, double y, double a, double b) {
  return 1 - std::hypot((u - x) / a, (v - y) / b);
}

// A head in profile: skull, nose, chin, neck and hair.
double portrait(double u, double v) {
  const double skull = ellipse(u, v, -0.03, 0.14, 0.27, 0.29);
  const double face = ellipse(u, v, 0.07, 0.0, 0.19, 0.27);
  const double nose = ellipse(u, v, 0.26, 0.0, 0.06, 0.07);
  const double neck = ellipse(u, v, -0.05, -0.33, 0.16, 0.26);
  const double bust = ellipse(u, v, -0.03, -0.52, 0.3, 0.13);
  const double shape = std::max({skull, face, nose, neck, bust});
  if (shape <= 0) return 0;
  double height = smooth_step(0, 0.12, shape) * (0.55 + 0.45 * std::sqrt(std::min(1.0, shape)));
  if (skull > 0 && u + 0.5 * v < 0.17) {
    height += 0.13 * std::sin(34 * (v + 0.6 * u * u) + 6 * std::sin(9 * u));  // locks of hair
  }
  height -= 0.2 * std::max(0.0, ellipse(u, v, 0.14, 0.09, 0.05, 0.03));  // the eye
  return height;
}

// A wreathed star, its points counted by the kind.
double emblem(double u, double v, std::size_t kind) {
  const double r = std::hypot(u, v), angle = std::atan2(v, u);
  const double points = 5 + static_cast<double>(kind % 4);
  const double arm = std::abs(std::remainder(angle * points / turn, 1.0)) * 2;  // 0 ridge, 1 notch
  const double reach = 0.42 * (1 - 0.55 * arm);
  double height = r < reach ? (1 - r / reach) * 0.5 + 0.5 * (1 - arm) : 0;
  height *= smooth_step(0, 0.03, reach - r);
  const double leaf = std::cos(22 * angle + 40 * std::abs(r - 0.53));
  if (std::abs(r - 0.53) < 0.05 && leaf > 0) {
    height += 0.7 * std::sqrt(leaf) * (1 - std::abs(r - 0.53) / 0.05);
  }
  return height;
}

// Height of the design, 0 to about 1, at a place relative to the radius.
double design(const Coin& coin, double u, double v) {
  const double r = std::hypot(u, v), angle = std::atan2(v, u);
  double height = smooth_step(0.915, 0.94, r) * (1 - smooth_step(0.975, 1, r));
  if (std::abs(r - 0.875) < 0.025) {
    const double bead = std::cos(64 * angle);
    height += 0.6 * std::max(0.0, bead) * (1 - std::abs(r - 0.875) / 0.025);
  }
  height += 0.75 * legend(angle, r, hash(coin.kind * 2 + (coin.head ? 1 : 0)));
  if (r < 0.64) height += coin.head ? portrait(u, v) : emblem(u, v, coin.kind);
  return height;
}

Coin make_coin(const Coins& coins, std::uint64_t id) {
  const auto u = [id](std::uint64_t k) { return hash_unit(id + k); };
  Coin coin;
  coin.id = id;
  double total = 0;
  for (const CoinKind& kind : coins.coins) total += kind.share;
  double left = u(1) * total;
  while (coin.kind + 1 < coins.coins.size() && left >= coins.coins[coin.kind].share) {
    left -= coins.coins[coin.kind++].share;
  }
  const CoinKind& kind = coins.coins[coin.kind];
  coin.radius = 0.5 * kind.diameter;
  coin.thickness = kind.thickness;
  coin.head = u(2) < 0.5;
  coin.cosine = std::cos(turn * u(3));
  coin.sine = std::sin(turn * u(3));
  return coin;
}

// Where a convex function of one number in [-steepest, steepest] is least, by golden sections.
template <typename Function>
double lowest_at(const Function& function) {
  constexpr double golden = 1 / std::numbers::phi;
  double low = -steepest, high = steepest;
  double a = high - golden * (high - low), b = low + golden * (high - low);
  double at_a = function(a), at_b = function(b);
  for (int i = 0; i < 14; ++i) {
    if (at_a <= at_b) {
      high = b;
      b = a;
      at_b = at_a;
      a = high - golden * (high - low);
      at_a = function(a);
    } else {
      low = a;
      a = b;
      at_a = at_b;
      b = low + golden * (high - low);
      at_b = function(b);
    }
  }
  return 0.5 * (low + high);
}

// Lays a coin on the heap at its place: the plane above all it covers that is lowest in its middle.
void rest(Coin& coin, Pile& pile) {
  std::vector<std::array<double, 3>> below;
  pile.near(coin.x, coin.y, coin.radius, [&](double& height, double dx, double dy) {
    below.push_back({height, dx, dy});
  });
  const auto middle = [&below](double slope_x, double slope_y) {
    double highest = 0;
    for (const auto& [height, dx, dy] : below) {
      highest = std::max(highest, height - slope_x * dx - slope_y * dy);
    }
    return highest;
  };
  const auto best_y = [&](double slope_x) {
    return lowest_at([&](double slope_y) { return middle(slope_x, slope_y); });
  };
  coin.slope_x = lowest_at([&](double slope_x) { return middle(slope_x, best_y(slope_x)); });
  coin.slope_y = best_y(coin.slope_x);
  coin.rest = middle(coin.slope_x, coin.slope_y);
}

std::vector<Coin> toss_coins(const Coins& coins, std::uint64_t key) {
  Pile pile(coins.tile, heap_cells);
  const double area = coins.tile[0] * coins.tile[1];
  std::vector<Coin> heap;
  for (double covered = 0; covered < coins.cover * area;) {
    check_interrupt();
    const Coin coin = make_coin(coins, hash(key + heap.size()));
    Coin best = coin;
    best.rest = std::numeric_limits<double>::infinity();
    for (std::uint64_t k = 0; k < tries; ++k) {
      Coin candidate = coin;
      candidate.x = hash_unit(coin.id + 20 + 2 * k) * coins.tile[0];
      candidate.y = hash_unit(coin.id + 21 + 2 * k) * coins.tile[1];
      rest(candidate, pile);
      if (candidate.rest < best.rest) best = candidate;
    }
    pile.near(best.x, best.y, best.radius, [&](double& height, double dx, double dy) {
      height = std::max(height, best.plane(dx, dy) + best.thickness);
    });
    covered += std::numbers::pi * best.radius * best.radius;
    heap.push_back(best);
  }
  return heap;
}

// Whether two coins share a place, seen from above, aprons included.
bool overlap(const Coin& a, const Coin& b, const std::array<double, 2>& tile, double apron) {
  const double dx = periodic_offset(a.x, b.x, tile[0]), dy = periodic_offset(a.y, b.y, tile[1]);
  const double reach = a.radius + b.radius + 2 * apron;
  return dx * dx + dy * dy < reach * reach;
}

// The layer of each coin: from the top of the heap down, the first sheet with room; else layer 0,
// the solid one.
std::vector<std::size_t> sort_into_layers(const std::vector<Coin>& heap,
                                          const std::array<double, 2>& tile, double apron) {
  std::vector<std::size_t> layers(heap.size(), 0);
  for (std::size_t i = heap.size(); i-- > 0;) {
    for (std::size_t sheet = 1; sheet <= sheets && layers[i] == 0; ++sheet) {
      bool room = true;
      for (std::size_t k = i + 1; k < heap.size() && room; ++k) {
        room = layers[k] != sheet || !overlap(heap[i], heap[k], tile, apron);
      }
      if (room) layers[i] = sheet;
    }
  }
  return layers;
}

}  // namespace

void describe(Fields& fields, CoinKind& kind) {
  fields.number("share", kind.share, 0, 1e6, "of all coins, relative to the other kinds");
  fields.number("diameter", kind.diameter, 1, 1000, "of the coin");
  fields.number("thickness", kind.thickness, 0.05, 100, "of the coin");
  fields.number("relief", kind.relief, 0, 10, "height of rim and design");
  fields.color("color", kind.color, "diffuse albedo of the metal");
  fields.color("dirt_color", kind.dirt_color, "diffuse albedo of what sticks in corners");
  describe_gloss(fields, kind.gloss);
  fields.number("wear", kind.wear, 0, 1, "0 freshly struck, 1 worn smooth and dirty");
}

void describe(Fields& fields, Coins& coins) {
  fields.tile(coins.tile, 1, 10000, "width and depth in mm");
  fields.seed(coins.seed);
  fields.number("cover", coins.cover, 0, 10, "area of all coins together, in tiles");
  fields.color("felt_color", coins.felt_color, "diffuse albedo of the felt beneath");
  describe_list(fields, "coins", coins.coins, 1, 16, "kinds of coin");
}

void stretch(Coins& coins, double along_x, double along_y) {
  coins.tile = {coins.tile[0] * along_x, coins.tile[1] * along_y};
}

Surface make_surface(const Coins& coins, std::size_t columns, std::size_t rows) {
  check_fields("coins", coins);
  const std::array<double, 2>& tile = coins.tile;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < coins.coins.size(); ++i) {
    const double diameter = coins.coins[i].diameter;
    least = std::min(least, diameter);
    if (diameter > 0.9 * std::min(tile[0], tile[1])) {
      fail_input("coins: coins[{}].diameter is {}, more than 0.9 of the tile's shorter side {}", i,
                 diameter, std::min(tile[0], tile[1]));
    }
  }
  if (coins.cover * tile[0] * tile[1] / (least * least) > most_coins) {
    fail_input("coins: cover {} asks for more than {} coins of diameter {}", coins.cover,
               most_coins, least);
  }

  const TileNoise noise(tile[0], tile[1], coins.seed);
  // Per kind a polished and a worn lobe; then the felt's.
  std::vector<GlossyLobe> lobes;
  for (const CoinKind& kind : coins.coins) {
    GlossyLobe worn = kind.gloss;
    worn.alpha_along = std::min(1.0f, 1.9f * worn.alpha_along);
    worn.alpha_across = std::min(1.0f, 1.9f * worn.alpha_across);
    for (float& f0 : worn.f0) f0 *= 0.7f;
    lobes.insert(lobes.end(), {kind.gloss, worn});
  }
  lobes.push_back({{0.02f, 0.02f, 0.02f}, 0.5f, 1, 1});
  const std::size_t felt_lobe = lobes.size() - 1;

  // Layer 0 begins as the felt, the sheets as nothing.
  Surface surface =
      make_solid(columns, rows, tile, std::move(lobes), [&](double x, double y, std::size_t) {
        SurfacePoint point;
        const double fibre = noise.fractal(x, y, 1.2, 3, fibres);
        point.elevation = 0.15 * fibre - 0.2;
        point.albedo = shaded(coins.felt_color, 1 + 0.5 * fibre);
        point.lobe = felt_lobe;
        return point;
      });
  const std::vector<Coin> heap = toss_coins(coins, noise.key(toss));
  const double cell =
      std::max(tile[0] / static_cast<double>(columns), tile[1] / static_cast<double>(rows));
  const double apron = std::max(least_apron_cells * cell, 0.5 * least * least_apron);
  const std::vector<std::size_t> layers = sort_into_layers(heap, tile, apron);
  const std::size_t used = 1 + *std::max_element(layers.begin(), layers.end());
  surface.layers.resize(used, surface.layers.front());
  for (std::size_t i = 1; i < used; ++i) {
    SurfaceLayer& layer = surface.layers[i];
    std::fill(layer.elevation.begin(), layer.elevation.end(), 0.0f);
    layer.underside.assign(layer.elevation.size(), 1.0f);
  }

  for (std::size_t i = 0; i < heap.size(); ++i) {
    const Coin& coin = heap[i];
    const CoinKind& kind = coins.coins[coin.kind];
    const bool sheet = layers[i] > 0;
    SurfaceLayer& layer = surface.layers[layers[i]];
    const auto draw = [&](std::size_t index, double dx, double dy) {
      const double u = (coin.cosine * dx + coin.sine * dy) / coin.radius;
      const double v = (coin.cosine * dy - coin.sine * dx) / coin.radius;
      const double r = std::hypot(u, v), beyond = std::max(0.0, r - 1);
      if (!sheet && beyond > 0) return;
      const double height = r < 1 ? design(coin, u, v) : 0;
      const double worn = kind.relief * (1 - 0.6 * kind.wear);
      const double lower = coin.plane(dx, dy);
      // Bevelled at the rim.
      const double bevel = 0.25 * coin.thickness * smooth_step(0.975, 1, r);
      const double top = lower + coin.thickness - kind.relief + worn * height - bevel;
      if (!sheet && top <= layer.elevation[index]) return;
      // Past the edge the faces cross half-way down.
      const double crossing = beyond * coin.radius / apron * coin.thickness;
      layer.elevation[index] = static_cast<float>(top - crossing);
      if (sheet) layer.underside[index] = static_cast<float>(lower + bevel + crossing);

      // Corners of the design keep dirt, its heights are polished.
      const double x = u * coin.radius + 71, y = v * coin.radius + 67;
      constexpr std::int64_t period = 4096;
      const double stain = fractal_noise(0.35 * x, 0.35 * y, period, period, 3, coin.id + stains);
      const double grain = gradient_noise(4 * x, 4 * y, period, period, coin.id + scratches);
      double slope = 0;
      if (r < 0.97) {
        constexpr double step = 0.012;
        slope = (std::abs(design(coin, u + step, v) - height) +
                 std::abs(design(coin, u, v + step) - height));
      }
      const double dirt =
          std::clamp(kind.wear * (0.25 + 0.5 * stain + 0.2 * grain) +
                         0.8 * kind.wear * std::min(1.0, slope) - 0.35 * kind.wear * height,
                     0.0, 1.0);
      layer.colors[index].albedo = mixed(kind.color, kind.dirt_color, 1.3 * dirt);
      const bool dull = hash_unit(noise.key(polish) + index) < 0.25 * kind.wear + 1.2 * dirt;
      layer.colors[index].lobe = static_cast<float>(2 * coin.kind + (dull ? 1 : 0));
    };
    draw_around(surface, coin.x, coin.y, coin.radius + (sheet ? apron : 0), draw);
  }
  bound_holes(surface);
  finish_surface(surface);
  return surface;
}

}  // namespace weft
