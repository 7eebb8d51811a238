#include "weft/scene/ray_caster.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <exception>
#include <numbers>
#include <thread>

#include "weft/error.hpp"
#include "weft/scene/light_nodes.hpp"
#include "weft/scene/light_tables.hpp"
#include "weft/scene/noise.hpp"
#include "weft/scene/tangent_frame.hpp"
#include "weft/scene/vector.hpp"

namespace weft {
namespace {

// Pixels that one thread takes at a time.
constexpr std::size_t section_pixels = 256;
// The widest footprint, in tiles: at a silhouette a pixel sees the whole surface.
constexpr double widest_footprint = 1e3;

// The longer and the shorter axis of the ellipse that a 2 x 2 matrix makes of the unit circle: its
// singular values, sqrt((s +- d) / 2) with s the sum of squares and d^2 = s^2 - 4 det^2.
std::array<float, 2> axes(double a, double b, double c, double d) {
  const double s = a * a + b * b + c * c + d * d;
  const double determinant = a * d - b * c;
  const double root = std::sqrt(std::max(0.0, s * s - 4 * determinant * determinant));
  const double longer = std::min(std::sqrt((s + root) / 2), widest_footprint);
  const double shorter = longer > 0 ? std::min(std::abs(determinant) / longer, longer) : 0;
  return {static_cast<float>(longer), static_cast<float>(shorter)};
}

// Texture coordinates of a step in the plane of dp/du and dp/dv; none where they span no plane.
std::array<double, 2> texture_step(const SurfaceHit& hit, const Vector3& step) {
  const double uu = dot(hit.along_u, hit.along_u), vv = dot(hit.along_v, hit.along_v);
  const double uv = dot(hit.along_u, hit.along_v);
  const double determinant = uu * vv - uv * uv;
  if (!(determinant > 1e-12 * uu * vv)) return {0, 0};
  const double su = dot(step, hit.along_u), sv = dot(step, hit.along_v);
  return {(vv * su - uv * sv) / determinant, (uu * sv - uv * su) / determinant};
}

// What a pixel `width` pixels wide covers of the texture, where the rays beside this one meet the
// tangent plane.
std::array<float, 2> footprint(const SurfaceHit& hit, const CameraRays& rays, double x, double y,
                               double width) {
  const auto step = [&](double dx, double dy) {
    const Ray beside = rays.at(x + dx, y + dy);
    const double cosine = dot(beside.direction, hit.geometric_normal);
    // A ray that misses the plane goes on for as long as one that grazes it.
    const double height = dot(difference(hit.position, beside.origin), hit.geometric_normal);
    const double distance = height / std::min(cosine, -1e-4);
    const Vector3 met = sum(beside.origin, scaled(beside.direction, distance));
    return texture_step(hit, difference(met, hit.position));
  };
  const std::array<double, 2> across = step(width, 0), down = step(0, width);
  return axes(across[0], down[0], across[1], down[1]);
}

float wrapped(double coordinate) {
  const auto fraction = static_cast<float>(coordinate - std::floor(coordinate));
  return fraction < 1 ? fraction : 0;
}

// Counter-clockwise as seen from above, as environment maps are turned.
class Rotation {
 public:
  explicit Rotation(double degrees)
      : cosine_(std::cos(degrees * std::numbers::pi / 180)),
        sine_(std::sin(degrees * std::numbers::pi / 180)) {}
  Vector3 forward(const Vector3& d) const {
    return {cosine_ * d[0] - sine_ * d[1], sine_ * d[0] + cosine_ * d[1], d[2]};
  }
  Vector3 back(const Vector3& d) const {
    return {cosine_ * d[0] + sine_ * d[1], cosine_ * d[1] - sine_ * d[0], d[2]};
  }

 private:
  double cosine_, sine_;
};

double fraction(double x) {
  const double f = x - std::floor(x);
  return f < 1 ? f : 0;
}

// Collects the light that arrives at one point.
class PointLights {
 public:
  PointLights(const Scene& scene, const SurfaceHit& hit, const TangentFrame& frame)
      : scene_(scene), hit_(hit), frame_(frame) {}

  void add_directional(std::vector<LightSample>& lights) const {
    for (const DirectionalLight& light : scene_.lights) {
      lights.push_back(sample(frame_.to_local(light.direction), light.direction, light.irradiance));
    }
  }

  // Directions drawn by the light, by what the material reflects at the point, or by both. A
  // direction w drawn in either way counts by 1 / (n_l p_l(w) + n_m p_m(w)), n the samples of a way
  // and p its density: the balance heuristic (E. Veach, L. Guibas, Optimally Combining Sampling
  // Techniques for Monte Carlo Rendering, SIGGRAPH 1995).
  void add_environment(const ShadingPoint& point, std::size_t index,
                       std::vector<LightSample>& lights) const {
    const EnvironmentLight& light = scene_.environment;
    const Rotation rotation(light.rotation);
    const std::size_t by_material = light.sampling == LightSampling::light      ? 0
                                    : light.sampling == LightSampling::material ? light.samples
                                                                                : light.samples / 2;
    const std::size_t by_light = light.samples - by_material;
    const auto n_l = static_cast<double>(by_light), n_m = static_cast<double>(by_material);
    std::optional<BilinearDensity> reflected;
    if (by_material > 0) reflected = light.material->density(point.uv, point.view);
    const auto add = [&](const Vector3& local, const Vector3& world,
                         const std::array<float, 3>& radiance, double p_l, double p_m) {
      std::array<double, 3> irradiance{};
      const double weight = n_l * p_l + n_m * p_m;
      if (weight > 0) {
        for (std::size_t c = 0; c < 3; ++c) {
          irradiance[c] = double{radiance[c]} * light.scale / weight;
        }
      }
      lights.push_back(sample(local, world, irradiance));
    };
    const std::uint64_t key = hash(hash(scene_.seed) ^ point.pixel);
    for (const std::array<double, 2>& numbers : spread(key, index, by_light)) {
      const EnvironmentSample drawn = light.map->sample(numbers);
      const Vector3 world = rotation.forward(drawn.direction);
      const Vector3 local = frame_.to_local(world);
      add(local, world, drawn.radiance, drawn.density,
          reflected && local[2] > 0 ? light_density(*reflected, local) : 0);
    }
    for (const std::array<double, 2>& numbers : spread(hash(key + 1), index, by_material)) {
      const LightOfSlice drawn = draw_light(*reflected, numbers);
      const Vector3 world = frame_.to_world(drawn.direction);
      const Vector3 in_map = rotation.back(world);
      add(drawn.direction, world, light.map->radiance(in_map),
          by_light > 0 ? light.map->density(in_map) : 0, drawn.density);
    }
  }

 private:
  // The Hammersley points of the unit square, moved by a random offset round its edges for every
  // pixel: each sample is evenly distributed, and all together are well spread. The points of a
  // pixel share the gaps between them, so that their mean is better than any of them.
  std::vector<std::array<double, 2>> spread(std::uint64_t key, std::size_t point,
                                            std::size_t samples) const {
    const double first =
        fraction(hash_unit(key) + static_cast<double>(point) / static_cast<double>(scene_.samples));
    const double second =
        hash_unit(hash(key)) + radical_inverse(point) / static_cast<double>(std::bit_ceil(samples));
    std::vector<std::array<double, 2>> numbers(samples);
    for (std::size_t i = 0; i < samples; ++i) {
      numbers[i] = {fraction((static_cast<double>(i) + first) / static_cast<double>(samples)),
                    fraction(radical_inverse(i) + second)};
    }
    return numbers;
  }

  // Of a direction in the point's frame and in the world.
  LightSample sample(const Vector3& local, const Vector3& direction,
                     const std::array<double, 3>& irradiance) const {
    LightSample result;
    result.direction = to_float(local);
    const bool dark = irradiance[0] <= 0 && irradiance[1] <= 0 && irradiance[2] <= 0;
    if (dark || local[2] <= 0 ||
        scene_.shape->occludes(hit_.shadow_origin, hit_.geometric_normal, direction)) {
      return result;
    }
    result.irradiance = to_float(irradiance);
    return result;
  }

  const Scene& scene_;
  const SurfaceHit& hit_;
  const TangentFrame& frame_;
};

}  // namespace

// Neighbouring pixels, done by one thread.
struct RayCaster::Section {
  std::vector<ShadingPoint> points;
  std::vector<LightSample> lights;
  std::vector<std::array<float, 4>> background;
};

RayCaster::RayCaster(Scene scene, std::size_t threads)
    : scene_(std::move(scene)),
      rays_(scene_.camera),
      threads_(threads > 0 ? threads
                           : std::max<std::size_t>(1, std::thread::hardware_concurrency())) {
  validate(scene_);
}

std::size_t RayCaster::bytes_per_pixel() const {
  // Twice: in the batch and in the sections that it is put together from.
  return 2 * (scene_.samples * (sizeof(ShadingPoint) + lights_per_point() * sizeof(LightSample)) +
              sizeof(std::array<float, 4>));
}

void RayCaster::cast_pixel(std::size_t pixel, Section& section) const {
  const std::size_t row = pixel / scene_.camera.width, column = pixel % scene_.camera.width;
  const double weight = 1 / static_cast<double>(scene_.samples);
  const Rotation rotation(scene_.environment.rotation);
  const auto behind = [&](const Vector3& direction) {
    if (!scene_.show_environment || !scene_.environment.map) return scene_.background;
    const auto radiance = scene_.environment.map->smooth_radiance(rotation.back(direction));
    std::array<double, 3> seen{};
    for (std::size_t c = 0; c < 3; ++c) seen[c] = double{radiance[c]} * scene_.environment.scale;
    return seen;
  };
  std::array<double, 4> background{};
  for (std::size_t s = 0; s < scene_.samples; ++s) {
    const auto [dx, dy] = pixel_sample(s, scene_.samples);
    const double x = static_cast<double>(column) + dx, y = static_cast<double>(row) + dy;
    const Ray ray = rays_.at(x, y);
    const std::array<double, 3> seen = behind(ray.direction);
    const std::optional<SurfaceHit> hit = scene_.shape->intersect(ray);
    if (!hit) {
      for (std::size_t c = 0; c < 3; ++c) background[c] += weight * seen[c];
      continue;
    }
    background[3] += weight;
    const Vector3 to_eye = scaled(ray.direction, -1);
    const TangentFrame frame = tangent_frame(*hit, to_eye);
    ShadingPoint point;
    point.pixel = static_cast<std::uint32_t>(pixel);
    point.weight = static_cast<float>(weight);
    point.uv = {wrapped(hit->uv[0]), wrapped(hit->uv[1])};
    point.footprint = footprint(*hit, rays_, x, y, std::sqrt(weight));
    point.position = to_float(hit->position);
    point.tangent = to_float(frame.tangent);
    point.bitangent = to_float(frame.bitangent);
    point.normal = to_float(frame.normal);
    point.view = to_float(frame.to_local(to_eye));
    point.behind = to_float(seen);
    section.points.push_back(point);
    const PointLights lights(scene_, *hit, frame);
    lights.add_directional(section.lights);
    if (scene_.environment.map) {
      lights.add_environment(point, s, section.lights);
    }
  }
  std::array<float, 4> rounded{};
  for (std::size_t c = 0; c < 4; ++c) rounded[c] = static_cast<float>(background[c]);
  section.background.push_back(rounded);
}

void RayCaster::cast(std::size_t first, std::size_t count, PixelBatch& batch) const {
  if (count > pixels() || first > pixels() - count) {
    fail_input("pixels {} to {} of a picture of {}", first, first + count, pixels());
  }
  const std::size_t section_count = (count + section_pixels - 1) / section_pixels;
  std::vector<Section> sections(section_count);
  std::atomic<std::size_t> next{0};
  std::atomic<bool> failed{false};
  const auto work = [&] {
    for (std::size_t i = next++; i < section_count && !failed; i = next++) {
      check_interrupt();
      const std::size_t begin = first + i * section_pixels;
      const std::size_t end = std::min(begin + section_pixels, first + count);
      for (std::size_t pixel = begin; pixel < end; ++pixel) cast_pixel(pixel, sections[i]);
    }
  };
  const std::size_t workers = std::min(threads_, section_count);
  std::vector<std::exception_ptr> errors(workers);
  const auto guarded = [&](std::size_t worker) {
    try {
      work();
    } catch (...) {
      errors[worker] = std::current_exception();
      failed = true;
    }
  };
  std::vector<std::thread> threads;
  for (std::size_t worker = 1; worker < workers; ++worker) threads.emplace_back(guarded, worker);
  if (workers > 0) guarded(0);
  for (std::thread& thread : threads) thread.join();
  for (const std::exception_ptr& error : errors) {
    if (error) std::rethrow_exception(error);
  }
  // Put the sections together in order.
  batch.points.clear();
  batch.lights.clear();
  batch.background.clear();
  for (Section& section : sections) {
    batch.points.insert(batch.points.end(), section.points.begin(), section.points.end());
    batch.lights.insert(batch.lights.end(), section.lights.begin(), section.lights.end());
    batch.background.insert(batch.background.end(), section.background.begin(),
                            section.background.end());
    section = {};
  }
}

}  // namespace weft
