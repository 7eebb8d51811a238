#include "weft/scene/hammered_metal.hpp"

#include <cmath>
#include <numbers>

#include "weft/scene/tile_noise.hpp"

namespace weft {
namespace {

// Purposes of random numbers.
enum Key : std::uint64_t { strikes = 1, waves, pits, stains, stain_detail, cover };

struct Strike {
  double x, y;
  double depth;
  double radius;
};

// Strikes on a jittered grid of spots, sorted by spot, and which of them can matter at a place.
class Strikes {
 public:
  Strikes(const HammeredMetal& metal, std::uint64_t key) {
    for (std::size_t i = 0; i < 2; ++i) {
      const double spots = std::round(metal.tile[i] / metal.dent_size);
      count_[i] = static_cast<std::int64_t>(std::max(1.0, spots));
      spacing_[i] = metal.tile[i] / static_cast<double>(count_[i]);
    }
    for (std::int64_t j = 0; j < count_[1]; ++j) {
      for (std::int64_t i = 0; i < count_[0]; ++i) {
        const std::uint64_t id = hash(key + static_cast<std::uint64_t>(j * count_[0] + i));
        const auto u = [id](std::uint64_t k) { return hash_unit(id + k); };
        strikes_.push_back({(static_cast<double>(i) + 0.5 + 0.9 * (u(1) - 0.5)) * spacing_[0],
                            (static_cast<double>(j) + 0.5 + 0.9 * (u(2) - 0.5)) * spacing_[1],
                            metal.depth_spread * 2 * (u(3) - 0.5),
                            metal.hammer_radius * (0.75 + 0.6 * u(4))});
      }
    }
  }

  // Calls visit(strike, dx, dy) for all strikes within two spots of a place.
  template <typename Visit>
  void near(double x, double y, const Visit& visit) const {
    const auto column = static_cast<std::int64_t>(std::floor(x / spacing_[0]));
    const auto row = static_cast<std::int64_t>(std::floor(y / spacing_[1]));
    for (std::int64_t j = row - 2; j <= row + 2; ++j) {
      const std::int64_t wrapped_j = (j % count_[1] + count_[1]) % count_[1];
      for (std::int64_t i = column - 2; i <= column + 2; ++i) {
        const std::int64_t wrapped_i = (i % count_[0] + count_[0]) % count_[0];
        const Strike& strike =
            strikes_[static_cast<std::size_t>(wrapped_j * count_[0] + wrapped_i)];
        const double shift_x = static_cast<double>(i - wrapped_i) * spacing_[0];
        const double shift_y = static_cast<double>(j - wrapped_j) * spacing_[1];
        visit(strike, x - strike.x - shift_x, y - strike.y - shift_y);
      }
    }
  }

 private:
  std::array<std::int64_t, 2> count_{};
  std::array<double, 2> spacing_{};
  std::vector<Strike> strikes_;
};

}  // namespace

void describe(Fields& fields, HammeredMetal& metal) {
  fields.tile(metal.tile, 1, 10000, "width and depth in mm");
  fields.seed(metal.seed);
  fields.color("color", metal.color, "diffuse albedo of bare metal");
  describe_gloss(fields, metal.gloss);
  fields.color("tarnish_color", metal.tarnish_color, "diffuse albedo of tarnish");
  fields.number("tarnish_roughness", metal.tarnish_roughness, 0.02, 1, "roughness of tarnish");
  fields.number("tarnish", metal.tarnish, 0, 1, "share of the surface that is tarnished");
  fields.number("dent_size", metal.dent_size, 0.1, 1000, "distance between strikes");
  fields.number("hammer_radius", metal.hammer_radius, 0.1, 10000,
                "radius of curvature of the hammer's face");
  fields.number("depth_spread", metal.depth_spread, 0, 100, "variation of a strike's depth");
  fields.number("ridge_width", metal.ridge_width, 0.001, 100,
                "width over which ridges are rounded");
  fields.number("waviness", metal.waviness, 0, 100, "height of the sheet's own waves");
  fields.number("pitting", metal.pitting, 0, 10, "depth of the dents' own roughness");
}

void stretch(HammeredMetal& metal, double along_x, double along_y) {
  metal.tile = {metal.tile[0] * along_x, metal.tile[1] * along_y};
}

Surface make_surface(const HammeredMetal& metal, std::size_t columns, std::size_t rows) {
  check_fields("hammered_metal", metal);
  const TileNoise noise(metal.tile[0], metal.tile[1], metal.seed);
  const Strikes dents(metal, noise.key(strikes));
  GlossyLobe dull = metal.gloss;
  dull.alpha_along = dull.alpha_across = static_cast<float>(metal.tarnish_roughness);
  for (float& f0 : dull.f0) f0 *= 0.6f;
  // Slopes of two bowls that meet differ by about dent_size / hammer_radius: over that, a ridge of
  // this width is so high.
  const double softness = 0.25 * metal.ridge_width * metal.dent_size / metal.hammer_radius;
  return make_solid(
      columns, rows, metal.tile, {metal.gloss, dull}, [&](double x, double y, std::size_t index) {
        double lowest = 1e300;
        dents.near(x, y, [&](const Strike& strike, double dx, double dy) {
          lowest = std::min(lowest, (dx * dx + dy * dy) / (2 * strike.radius) - strike.depth);
        });
        double sum = 0;
        dents.near(x, y, [&](const Strike& strike, double dx, double dy) {
          const double bowl = (dx * dx + dy * dy) / (2 * strike.radius) - strike.depth;
          sum += std::exp(-(bowl - lowest) / softness);
        });
        const double ridge = 1 - 1 / sum;  // 0 inside a dent, 1/2 and more on a ridge
        SurfacePoint point;
        point.elevation = lowest - softness * std::log(sum) +
                          metal.waviness * noise.fractal(x, y, 0.5 * metal.tile[0], 2, waves) +
                          metal.pitting * noise.fractal(x, y, 0.16 * metal.dent_size, 3, pits);
        const double stain = 0.5 + 0.5 * noise.fractal(x, y, 1.6 * metal.dent_size, 3, stains) +
                             0.25 * noise.fractal(x, y, 0.25 * metal.dent_size, 2, stain_detail);
        const double level = metal.tarnish * 1.4 - 0.2;
        const double tarnished = smooth_step(-0.25, 0.25, level - stain - 0.5 * ridge);
        point.albedo = mixed(metal.color, metal.tarnish_color, tarnished);
        point.lobe = hash_unit(noise.key(cover) + index) < tarnished ? 1 : 0;
        return point;
      });
}

}  // namespace weft
