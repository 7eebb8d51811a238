// Follows the rays of a camera to what they meet, and from there to the lights.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "weft/scene/scene.hpp"
#include "weft/scene/shading_point.hpp"

namespace weft {

// What a run of pixels sees. Reused from batch to batch, it keeps its memory.
struct PixelBatch {
  std::vector<ShadingPoint> points;  // in the order of their pixels
  std::vector<LightSample> lights;   // [points][lights_per_point]: the directional lights first
  // Per pixel of the batch: the radiance of the rays that meet nothing, weighted, and the share of
  // those that meet the shape.
  std::vector<std::array<float, 4>> background;
};

class RayCaster {
 public:
  // The scene is validated. `threads` 0: one per core. The result does not depend on it.
  explicit RayCaster(Scene scene, std::size_t threads = 0);

  const Scene& scene() const { return scene_; }
  std::size_t pixels() const { return scene_.camera.width * scene_.camera.height; }
  std::size_t lights_per_point() const { return scene_.lights_per_point(); }
  // The most bytes that a batch takes per pixel.
  std::size_t bytes_per_pixel() const;

  // Pixels [first, first + count), row by row.
  void cast(std::size_t first, std::size_t count, PixelBatch& batch) const;

 private:
  struct Section;
  void cast_pixel(std::size_t pixel, Section& section) const;

  Scene scene_;
  CameraRays rays_;
  std::size_t threads_;
};

}  // namespace weft
