#include "weft/scene/render_picture.hpp"

#include <algorithm>
#include <array>
#include <span>
#include <vector>

#include "weft/error.hpp"

namespace weft {

Picture render_picture(const RayCaster& caster, Shader& shader, Job& job) {
  const std::size_t pixels = caster.pixels();
  const std::size_t per_point = std::max<std::size_t>(caster.lights_per_point(), 1);
  const std::size_t per_pixel = per_point * caster.scene().samples;
  const std::size_t pixel_bytes =
      caster.bytes_per_pixel() + caster.scene().samples * sizeof(PointRadiance);
  MemoryPlan plan;
  plan.add("material and its batches", shader.bytes());
  plan.add("picture", pixels * sizeof(std::array<float, 4>));
  std::size_t held = plan.total();
  for (const MemoryItem& item : job.held) held += item.bytes;
  const std::size_t room = job.memory > held ? job.memory - held : 0;
  const std::size_t wanted = std::max<std::size_t>(shader.batch_samples() / per_pixel, 1);
  const std::size_t batch =
      std::clamp<std::size_t>(room / pixel_bytes, 1, std::min(wanted, pixels));
  plan.add("camera rays and lights", batch * pixel_bytes);
  job.plan(plan);

  Picture picture{caster.scene().camera.width, caster.scene().camera.height, {}};
  picture.pixels.resize(pixels);
  PixelBatch rays;
  std::vector<PointRadiance> radiance;
  for (std::size_t first = 0; first < pixels; first += batch) {
    check_interrupt();
    const std::size_t count = std::min(batch, pixels - first);
    {
      const StageTimer timer(job, "rays");
      caster.cast(first, count, rays);
    }
    radiance.assign(rays.points.size(), PointRadiance{});
    shader.shade(rays.points, rays.lights, radiance, job);
    const auto target = std::span(picture.pixels).subspan(first, count);
    for (std::size_t i = 0; i < count; ++i) {
      const std::array<float, 4>& behind = rays.background[i];
      target[i] = {behind[0], behind[1], behind[2], 0};
    }
    add_points(rays.points, radiance, first, target);
    job.advance("render", first + count, pixels);
  }
  return picture;
}

}  // namespace weft
