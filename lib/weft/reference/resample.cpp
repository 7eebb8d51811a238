#include "weft/reference/resample.hpp"

#include <algorithm>

#include "weft/reference/gemm.hpp"

namespace weft::reference {

std::vector<double> resample(const Resampling& resampling, std::size_t n,
                             std::span<const double> values, std::size_t first_view,
                             std::size_t view_count) {
  const std::size_t V = resampling.measured_views, L = resampling.measured_lights;
  const std::size_t lights = resampling.new_lights, F = resampling.frames.size();
  // The zenith view, where one is made.
  std::vector<double> zenith;
  if (!resampling.zenith.empty()) {
    zenith.resize(L * n);
    gemm(1, L * n, V, 1, resampling.zenith, values, 0, zenith);
  }
  // Lights.
  std::vector<double> frames(F * lights * n);
  for (std::size_t f = 0; f < F; ++f) {
    const auto [view, matrix] = resampling.frames[f];
    gemm(lights, n, L, 1, std::span(resampling.lights).subspan(matrix * lights * L, lights * L),
         view == V ? std::span<const double>(zenith) : values.subspan(view * L * n, L * n), 0,
         std::span(frames).subspan(f * lights * n, lights * n));
  }
  // Views.
  std::vector<double> result(view_count * lights * n);
  gemm(view_count, lights * n, F, 1,
       std::span(resampling.views).subspan(first_view * F, view_count * F), frames, 0, result);
  for (double& value : result) {
    value = std::max(value, 0.0);
    if (resampling.largest > 0) value = std::min(value, resampling.largest);
  }
  return result;
}

}  // namespace weft::reference
