#include "weft/scene/weave.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "weft/error.hpp"
#include "weft/scene/noise.hpp"
#include "weft/scene/tile_noise.hpp"

namespace weft {
namespace {

constexpr std::size_t most_yarns = 4096;
constexpr std::size_t most_crossings_of_a_period = 64;

// Fibres across one ply.
constexpr std::int64_t fibres_per_ply = 5;
// Cells of the fibre noise along a yarn, per spacing: fibres are long.
constexpr double fibre_cells_per_spacing = 1.5;

// Beyond the widest place of its section, where the underside would begin, a yarn falls as a steep
// skirt: a height field has no underside, and a drop within one cell would be seen as teeth.
constexpr double skirt_width = 0.09;
constexpr double skirt_slope = 6;

// What a yarn shows at a place: the elevation decides who is seen.
struct YarnPoint {
  bool hit = false;
  double elevation = 0;
  double slope = 0;  // sideways change of position along the fibres, per length
  double shade = 1;  // factor of the yarn's colour
};

// One yarn: its crossings and its own irregularities. Coordinates are s along it and u sideways,
// from -1 to 1 over its width.
class YarnPath {
 public:
  // `on_top(k)` at crossing k, of `crossings` in one tile.
  template <typename OnTop>
  YarnPath(const Yarn& yarn, const WeaveCloth& cloth, std::size_t crossings, std::uint64_t key,
           const OnTop& on_top)
      : yarn_(yarn),
        key_(hash(key)),
        length_(static_cast<double>(crossings)),
        wander_(cloth.wander),
        spread_(cloth.color_spread) {
    for (std::size_t k = 0; k < crossings; ++k) tops_.push_back(on_top(k));
    // A whole number of plies passes over the tile, so that the twist meets itself.
    passes_ = static_cast<std::int64_t>(std::llround(yarn.twists * length_));
    phase_ = hash_unit(key_ + 1);
    shade_ = 1 + spread_ * (2 * hash_unit(key_ + 2) - 1);
    size_ = 1 + 0.06 * (2 * hash_unit(key_ + 3) - 1);
  }

  // Sideways position of the centre line, relative to the middle of the yarn's place.
  double sideways(double s) const { return wander_ * noise_along(s, 0.5, key_ + 4); }

  YarnPoint at(double s, double offset) const {
    YarnPoint point;
    const double rise = float_rise(s);
    const double width = yarn_.width * size_ * (1 - yarn_.pinch * (1 - rise));
    const double half = 0.5 * width;
    const double aside = offset - sideways(s);
    const double beyond = std::max(0.0, std::abs(aside) - half);
    if (beyond >= skirt_width) return point;
    const double u = std::clamp(aside / half, -1.0, 1.0);
    point.hit = true;

    // Strands: the angle round the section and the twist along it number the plies.
    const double angle = std::asin(u);
    const auto plies = static_cast<double>(yarn_.plies);
    const double turns = static_cast<double>(passes_) / length_;
    const double ply = plies * (angle / std::numbers::pi + 0.5) + turns * s + phase_;
    const double across = 2 * (ply - std::floor(ply)) - 1;  // -1..1 within a ply
    const double round = std::sqrt(std::max(0.0, 1 - across * across));
    const std::int64_t fibre_period = fibres_per_ply * std::max<std::int64_t>(1, std::abs(passes_));
    const double cells = cells_along(fibre_cells_per_spacing);
    const double fibre = value_noise(static_cast<double>(fibres_per_ply) * ply, s * cells / length_,
                                     fibre_period, static_cast<std::int64_t>(cells), key_ + 5);

    const double section = std::sqrt(1 - u * u);
    // Relief fades towards the edge of the section, where it would stand sideways.
    point.elevation = centre(s) + yarn_.float_arch * rise - skirt_slope * beyond +
                      0.5 * yarn_.thickness * section +
                      section * (yarn_.ply_relief * (round - 1) + yarn_.fibre_relief * fibre);
    // Along a fibre `ply` is constant: plies d(angle)/pi + turns ds = 0.
    point.slope = -section * half * std::numbers::pi * turns / plies;
    const double along = noise_along(s, 0.75, key_ + 6);
    point.shade =
        shade_ * (1 + 0.5 * spread_ * along + 1.5 * spread_ * fibre) * (0.75 + 0.25 * round);
    return point;
  }

 private:
  // Smooth noise along the yarn, of about so many cells per spacing; it meets itself.
  double noise_along(double s, double density, std::uint64_t key) const {
    const double cells = cells_along(density);
    return value_noise(s * cells / length_, static_cast<std::int64_t>(cells), key);
  }
  double cells_along(double density) const { return std::max(1.0, std::round(density * length_)); }

  bool top(std::int64_t k) const {
    const auto n = static_cast<std::int64_t>(tops_.size());
    return tops_[static_cast<std::size_t>((k % n + n) % n)];
  }

  // Elevation of the centre line, without the bulge of floats.
  double centre(double s) const {
    // Crossing k lies at s = k + 1/2; a smooth step leads from one to the next.
    const double place = s - 0.5;
    const auto k = static_cast<std::int64_t>(std::floor(place));
    const double f = place - std::floor(place);
    const double from = top(k) ? 1 : -1, to = top(k + 1) ? 1 : -1;
    return yarn_.crimp * (from + (to - from) * 0.5 * (1 - std::cos(std::numbers::pi * f)));
  }

  // 1 in the middle of a float, falling to 0 at its ends as a parabola; 0 where the yarn passes
  // under.
  double float_rise(double s) const {
    const auto here = static_cast<std::int64_t>(std::floor(s));
    if (!top(here)) return 0;
    const auto limit = static_cast<std::int64_t>(tops_.size());
    std::int64_t first = here, last = here;
    while (here - first < limit && top(first - 1)) --first;
    while (last - here < limit && top(last + 1)) ++last;
    const double middle = 0.5 * static_cast<double>(first + last + 1);
    const double half = 0.5 * static_cast<double>(last - first + 1);
    const double t = (s - middle) / half;
    return std::max(0.0, 1 - t * t);
  }

  const Yarn& yarn_;
  std::uint64_t key_;
  double length_;
  double wander_, spread_;
  std::vector<bool> tops_;
  std::int64_t passes_ = 0;
  double phase_ = 0, shade_ = 1, size_ = 1;
};

// Yarns whose place is within half a spacing of a coordinate: the one there and its nearer
// neighbour.
std::array<std::size_t, 2> nearest_yarns(double x, std::size_t count) {
  const auto here = std::min(static_cast<std::size_t>(x), count - 1);
  const bool upper = x - static_cast<double>(here) > 0.5;
  return {here, upper ? (here + 1) % count : (here + count - 1) % count};
}

// Offset of x from the middle of yarn `index`, the short way round the tile.
double offset_from(double x, std::size_t index, std::size_t count) {
  const auto length = static_cast<double>(count);
  const double offset = x - (static_cast<double>(index) + 0.5);
  return offset - length * std::round(offset / length);
}

void describe(Fields& fields, Yarn& yarn) {
  fields.color("color", yarn.color, "diffuse albedo");
  describe_gloss(fields, yarn.gloss);
  fields.number("width", yarn.width, 0.05, 1.9, "width of the section, in spacings");
  fields.number("thickness", yarn.thickness, 0, 4, "thickness of the section");
  fields.number("crimp", yarn.crimp, 0, 4, "rise and fall of the centre line");
  fields.number("float_arch", yarn.float_arch, 0, 4, "bulge of a float, besides the crimp");
  fields.number("pinch", yarn.pinch, 0, 0.9, "relative loss of width under crossing yarns");
  fields.count("plies", yarn.plies, 1, 64, "strands that are twisted");
  fields.number("twists", yarn.twists, -64, 64, "plies that pass per spacing of length");
  fields.number("ply_relief", yarn.ply_relief, 0, 1, "depth of the grooves between plies");
  fields.number("fibre_relief", yarn.fibre_relief, 0, 1, "height of single fibres");
}

void check_count(std::size_t count, const WeavePattern& pattern, const char* field) {
  if (count < 1 || count > most_yarns || count % pattern.period() != 0) {
    fail_input("weave: {} is {}, not a multiple of the pattern's period {} up to {}", field, count,
               pattern.period(), most_yarns);
  }
}

// The multiple of `period`, at least one, that is nearest to `count`.
std::size_t nearest_multiple(double count, std::size_t period) {
  const double multiples = std::round(count / static_cast<double>(period));
  return period * static_cast<std::size_t>(std::clamp(multiples, 1.0, 64.0));
}

}  // namespace

void describe(Fields& fields, WeaveCloth& cloth) {
  fields.seed(cloth.seed);
  fields.count("warp_count", cloth.warp_count, 1, most_yarns,
               "warp yarns of the tile, a multiple of the pattern's period");
  fields.count("weft_count", cloth.weft_count, 1, most_yarns, "weft yarns of the tile, likewise");
  fields.open("pattern", "how the yarns interlace");
  WeavePattern& pattern = cloth.pattern;
  fields.count("over", pattern.over, 1, most_crossings_of_a_period,
               "crossings a warp yarn is on top");
  fields.count("under", pattern.under, 1, most_crossings_of_a_period, "and those it is beneath");
  fields.count("step", pattern.step, 0, 2 * most_crossings_of_a_period - 1,
               "shift from a warp yarn to the next, below over + under");
  fields.close();
  fields.open("warp", "yarns along y");
  describe(fields, cloth.warp);
  fields.close();
  fields.open("weft", "yarns along x");
  describe(fields, cloth.weft);
  fields.close();
  fields.color("backing", cloth.backing, "diffuse albedo of what shows through gaps");
  fields.number("wander", cloth.wander, 0, 0.25, "sideways wander of the yarns");
  fields.number("color_spread", cloth.color_spread, 0, 0.5, "relative, from yarn to yarn");
}

void stretch(WeaveCloth& cloth, double along_x, double along_y) {
  const std::size_t period = cloth.pattern.period();
  cloth.warp_count = nearest_multiple(static_cast<double>(cloth.warp_count) * along_x, period);
  cloth.weft_count = nearest_multiple(static_cast<double>(cloth.weft_count) * along_y, period);
}

WeaveCloth standard_cloth(std::size_t width, std::size_t height) {
  WeaveCloth cloth;
  const double aspect = static_cast<double>(width) / static_cast<double>(height);
  stretch(cloth, std::max(1.0, aspect), std::max(1.0, 1 / aspect));
  return cloth;
}

std::size_t surface_resolution(std::size_t texels) {
  return std::bit_ceil(std::clamp<std::size_t>(texels, 32, 256) * 8);
}

void validate(const WeaveCloth& cloth) {
  const WeavePattern& pattern = cloth.pattern;
  check_fields("weave", cloth);
  if (pattern.step >= pattern.period()) {
    fail_input("weave: pattern.step is {}, not below the period {}", pattern.step,
               pattern.period());
  }
  check_count(cloth.warp_count, pattern, "warp_count");
  check_count(cloth.weft_count, pattern, "weft_count");
}

Surface make_surface(const WeaveCloth& cloth, std::size_t columns, std::size_t rows) {
  validate(cloth);
  const auto width = static_cast<double>(cloth.warp_count);
  const auto depth = static_cast<double>(cloth.weft_count);
  Surface surface = make_flat_surface(columns, rows, width, depth);
  SurfaceLayer& layer = surface.layers.front();
  surface.lobes = {cloth.warp.gloss, cloth.weft.gloss, GlossyLobe{}};

  const WeavePattern& pattern = cloth.pattern;
  const std::uint64_t key = hash(cloth.seed);
  std::vector<YarnPath> warps, wefts;
  for (std::size_t i = 0; i < cloth.warp_count; ++i) {
    warps.emplace_back(cloth.warp, cloth, cloth.weft_count, key + hash(2 * i),
                       [&](std::size_t j) { return pattern.warp_on_top(i, j); });
  }
  for (std::size_t j = 0; j < cloth.weft_count; ++j) {
    wefts.emplace_back(cloth.weft, cloth, cloth.warp_count, key + hash(2 * j + 1),
                       [&](std::size_t i) { return !pattern.warp_on_top(i, j); });
  }

  // Backing lies where the lower yarns have their centre lines.
  const double backing = -std::max(cloth.warp.crimp, cloth.weft.crimp);
  for (std::size_t r = 0; r < rows; ++r) {
    const double y = (static_cast<double>(r)) * depth / static_cast<double>(rows);
    for (std::size_t c = 0; c < columns; ++c) {
      const double x = (static_cast<double>(c)) * width / static_cast<double>(columns);
      const std::size_t index = r * columns + c;
      double top = backing;
      SurfaceSample& sample = layer.samples[index];
      SurfaceColor& color = layer.colors[index];
      color = {cloth.backing, 2};
      const auto show = [&](const YarnPoint& point, const Yarn& yarn, bool warp) {
        if (!point.hit || point.elevation <= top) return;
        top = point.elevation;
        const double length = std::sqrt(1 + point.slope * point.slope);
        const auto along = static_cast<float>(1 / length);
        const auto aside = static_cast<float>(point.slope / length);
        sample.fibre_x = warp ? aside : along;
        sample.fibre_y = warp ? along : aside;
        color = {shaded(yarn.color, point.shade), warp ? 0.0f : 1.0f};
      };
      for (const std::size_t i : nearest_yarns(x, cloth.warp_count)) {
        show(warps[i].at(y, offset_from(x, i, cloth.warp_count)), cloth.warp, true);
      }
      for (const std::size_t j : nearest_yarns(y, cloth.weft_count)) {
        show(wefts[j].at(x, offset_from(y, j, cloth.weft_count)), cloth.weft, false);
      }
      layer.elevation[index] = static_cast<float>(top);
    }
  }
  finish_surface(surface);
  return surface;
}

}  // namespace weft
