#include "weft/render/render_surface.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "weft/btf/mask_distance.hpp"
#include "weft/error.hpp"
#include "weft/ops/launch.hpp"

namespace weft {
namespace {

constexpr std::size_t values_per_light = 6;

Vector3 unit(const Direction& d) {
  return normalized({d[0], d[1], d[2]});
}

float narrow(double value) {
  return static_cast<float>(value);
}

// Work-items differ in length, so a CPU device gets small groups to balance; a GPU full ones.
std::size_t group_size(const Device& device) {
  const std::size_t wanted = device.limits().is_cpu ? 16 : 64;
  return std::min(wanted, device.limits().max_work_group);
}

cl_kernel surface_kernel(Device& device, const DeviceSurface& tables, const BtfInfo& info,
                         const SurfaceRenderOptions& options, const char* name) {
  const int output = info.dtype == DType::u8 ? 0 : info.dtype == DType::f16 ? 1 : 2;
  return device.kernel(
      kernel_sources::render_surface,
      fmt::format("{} -DOUTPUT={} -DBOUNCES={}", tables.build_options(), output, options.bounces),
      name);
}

// Cells per length, columns and rows.
std::array<double, 2> cells_per_length(const Surface& surface) {
  return {static_cast<double>(surface.columns) / surface.width,
          static_cast<double>(surface.rows) / surface.depth};
}

// Bytes of what is known of a texel before it is shaded.
std::size_t record_bytes(const SurfaceRenderOptions& options) {
  return options.samples * (surface_hit_bytes + (options.bounces > 0 ? surface_bounce_bytes : 0));
}

// How a render is cut: runs of lights of one view, and bands of texels within them.
struct Cut {
  std::size_t lights = 1;  // images in a run
  std::size_t rows = 1;    // of a band
  std::size_t columns = 1;
};

Cut plan(const Device& device, const BtfInfo& info, const SurfaceRenderOptions& options) {
  const BtfShape& shape = info.shape;
  Cut cut;
  cut.lights = std::clamp<std::size_t>(options.tile_bytes / info.image_bytes(), 1, shape.lights);
  // Whole chunks of lights waste no lanes.
  const std::size_t lanes = std::max<std::size_t>(ops::vector_width(device), 1);
  if (cut.lights < shape.lights && cut.lights > lanes) cut.lights -= cut.lights % lanes;
  const std::size_t allocation = device.limits().largest_allocation;
  const std::size_t hit_bytes = record_bytes(options);
  const std::size_t out_bytes = cut.lights * 3 * size_of(info.dtype);
  if (hit_bytes > allocation || out_bytes > allocation) {
    fail_input(
        "surface: {} samples of a texel under {} lights need {} bytes at once, but device {} "
        "allocates at most {}",
        options.samples, cut.lights, std::max(hit_bytes, out_bytes), device.limits().name,
        allocation);
  }
  const std::size_t tile = std::clamp<std::size_t>(options.tile_bytes, 1, allocation);
  const std::size_t texels = std::min(tile / hit_bytes, allocation / out_bytes);
  cut.columns = std::clamp<std::size_t>(texels, 1, shape.width);
  cut.rows = std::clamp<std::size_t>(texels / shape.width, 1, shape.height);
  return cut;
}

// Copies a band's values, [image][row][column][3], into their places in the images.
void place_band(std::span<const std::byte> values, const TexelBand& band, const BtfInfo& info,
                std::span<std::byte> images) {
  const std::size_t texel_bytes = 3 * size_of(info.dtype);
  const std::size_t row_bytes = band.columns * texel_bytes;
  const std::size_t count = values.size() / (band.rows * row_bytes);
  for (std::size_t image = 0; image < count; ++image) {
    for (std::size_t row = 0; row < band.rows; ++row) {
      const std::size_t texel = (band.first_row + row) * info.shape.width + band.first_column;
      std::memcpy(&images[image * info.image_bytes() + texel * texel_bytes],
                  &values[(image * band.rows + row) * row_bytes], row_bytes);
    }
  }
}

}  // namespace

void launch_surface_hits(Device& device, const Surface& surface, const DeviceSurface& tables,
                         const BtfInfo& info, const SurfaceRenderOptions& options, std::size_t view,
                         TexelBand band, Buffer& hits) {
  const ViewMarch march = march_of_view(surface, info.view_directions[view]);
  const BtfShape& shape = info.shape;
  const auto [cells_x, cells_y] = cells_per_length(surface);
  const double columns_per_texel =
      static_cast<double>(surface.columns) / static_cast<double>(shape.width);
  const double rows_per_texel =
      static_cast<double>(surface.rows) / static_cast<double>(shape.height);
  cl_kernel kernel = surface_kernel(device, tables, info, options, "surface_hits");
  set_arguments(kernel, tables.heights(), tables.ceilings(), tables.shape(), tables.color(),
                static_cast<cl_uint>(surface.columns), static_cast<cl_uint>(surface.rows),
                surface.lowest, surface.highest, narrow(cells_x), narrow(cells_y),
                narrow(shadow_bias(surface)), ops::ulong(shape.width), ops::ulong(shape.height),
                narrow(columns_per_texel), narrow(rows_per_texel), ops::ulong(band.first_column),
                ops::ulong(band.columns), ops::ulong(band.first_row), ops::ulong(band.rows),
                static_cast<cl_uint>(options.samples), view_key(options.seed, view),
                narrow(march.start_x), narrow(march.start_y), narrow(march.start_z),
                narrow(march.step_x), narrow(march.step_y), narrow(march.step_z),
                static_cast<cl_uint>(march.steps), hits);
  const std::array<std::size_t, 3> local = {group_size(device), 1, 1};
  const std::array<std::size_t, 3> global = {ops::round_up(band.columns, local[0]), band.rows,
                                             options.samples};
  device.launch(kernel, global, local);
}

void launch_surface_bounce(Device& device, const Surface& surface, const DeviceSurface& tables,
                           const BtfInfo& info, const SurfaceRenderOptions& options,
                           std::size_t view, TexelBand band, const Buffer& hits, Buffer& bounces) {
  const auto [cells_x, cells_y] = cells_per_length(surface);
  const double range = static_cast<double>(surface.highest) - surface.lowest;
  cl_kernel kernel = surface_kernel(device, tables, info, options, "surface_bounce");
  set_arguments(kernel, tables.heights(), tables.ceilings(), tables.shape(), tables.color(),
                static_cast<cl_uint>(surface.columns), static_cast<cl_uint>(surface.rows),
                surface.lowest, surface.highest, narrow(cells_x), narrow(cells_y),
                narrow(shadow_bias(surface)), ops::ulong(info.shape.width),
                ops::ulong(band.first_column), ops::ulong(band.columns), ops::ulong(band.first_row),
                ops::ulong(band.rows), static_cast<cl_uint>(options.samples),
                view_key(options.seed, view), narrow(1 / (1 + 2 * range)),
                static_cast<cl_uint>(bounce_reach(surface)), hits, bounces);
  const std::array<std::size_t, 3> local = {group_size(device), 1, 1};
  const std::array<std::size_t, 3> global = {ops::round_up(band.columns, local[0]), band.rows,
                                             options.samples};
  device.launch(kernel, global, local);
}

std::vector<float> pack_surface_lights(const Device& device, const Surface& surface,
                                       const BtfInfo& info, std::size_t first, std::size_t count) {
  const std::size_t lanes = ops::vector_width(device);
  const std::size_t chunks = ops::ceil_div(count, lanes);
  std::vector<float> packed(chunks * values_per_light * lanes);
  for (std::size_t i = 0; i < chunks * lanes; ++i) {
    // Lanes left over repeat the last light; what they yield is not stored.
    const Vector3 light = unit(info.light_directions[first + std::min(i, count - 1)]);
    const StepMarch march = march_along(surface, light);
    const std::array<double, values_per_light> values = {light[0],     light[1],     light[2],
                                                         march.step_x, march.step_y, march.step_z};
    for (std::size_t k = 0; k < values_per_light; ++k) {
      packed[(i / lanes * values_per_light + k) * lanes + i % lanes] = narrow(values[k]);
    }
  }
  return packed;
}

void launch_surface_shade(Device& device, const Surface& surface, const DeviceSurface& tables,
                          const BtfInfo& info, const SurfaceRenderOptions& options,
                          std::size_t view, TexelBand band, const Buffer& hits,
                          const Buffer& bounces, const Buffer& lights, std::size_t light_count,
                          Buffer& out) {
  const Vector3 to_view = unit(info.view_directions[view]);
  cl_kernel kernel = surface_kernel(device, tables, info, options, "surface_shade");
  const auto set = [&](const auto&... records) {
    set_arguments(
        kernel, tables.heights(), tables.ceilings(), static_cast<cl_uint>(surface.columns),
        static_cast<cl_uint>(surface.rows), surface.lowest, surface.highest, records...,
        tables.lobes(), lights, ops::ulong(light_count), narrow(to_view[0]), narrow(to_view[1]),
        narrow(to_view[2]), ops::ulong(band.texels()), static_cast<cl_uint>(options.samples), out);
  };
  if (options.bounces > 0) {
    set(hits, bounces);
  } else {
    set(hits);
  }
  const std::array<std::size_t, 2> local = {group_size(device), 1};
  const std::array<std::size_t, 2> global = {ops::round_up(band.texels(), local[0]),
                                             ops::ceil_div(light_count, ops::vector_width(device))};
  device.launch(kernel, global, local);
}

void launch_surface_mask(Device& device, const Surface& surface, const DeviceSurface& tables,
                         const BtfInfo& info, const SurfaceRenderOptions& options, std::size_t view,
                         std::size_t width, std::size_t height, Buffer& mask) {
  const ViewMarch march = march_of_view(surface, info.view_directions[view]);
  cl_kernel kernel = surface_kernel(device, tables, info, options, "surface_mask");
  set_arguments(kernel, tables.heights(), tables.ceilings(), static_cast<cl_uint>(surface.columns),
                static_cast<cl_uint>(surface.rows), surface.lowest, surface.highest,
                ops::ulong(width), ops::ulong(height),
                narrow(static_cast<double>(surface.columns) / static_cast<double>(width)),
                narrow(static_cast<double>(surface.rows) / static_cast<double>(height)),
                view_key(options.seed, view), narrow(march.start_x), narrow(march.start_y),
                narrow(march.start_z), narrow(march.step_x), narrow(march.step_y),
                narrow(march.step_z), static_cast<cl_uint>(march.steps), mask);
  const std::array<std::size_t, 2> local = {group_size(device), 1};
  const std::array<std::size_t, 2> global = {ops::round_up(width, local[0]), height};
  device.launch(kernel, global, local);
}

void render_surface_mask(Device& device, const Surface& surface,
                         const SurfaceRenderOptions& options, BtfInfo& info) {
  validate(surface, info, options);
  info.mask.clear();
  info.mask_distance.clear();
  if (!may_have_holes(surface)) return;
  const std::size_t width = mask_parts * info.shape.width;
  const std::size_t height = mask_parts * info.shape.height;
  const DeviceSurface tables(device, surface);
  Buffer mask(device, width * height, "mask");
  std::vector<std::uint8_t> fine(width * height);
  for (std::size_t view = 0; view < info.shape.views; ++view) {
    check_interrupt();
    launch_surface_mask(device, surface, tables, info, options, view, width, height, mask);
    device.read(mask, std::span<std::uint8_t>(fine));
    add_view_mask(fine, mask_parts, info);
  }
  normalize_distances(info.mask_distance);
}

void render_surface(Device& device, const Surface& surface, const SurfaceRenderOptions& options,
                    TileSink& sink) {
  const BtfInfo& info = sink.info();
  validate(surface, info, options);
  const BtfShape& shape = info.shape;
  const Cut cut = plan(device, info, options);
  const std::size_t texel_bytes = 3 * size_of(info.dtype);

  const DeviceSurface tables(device, surface);
  Buffer hits(device, cut.rows * cut.columns * options.samples * surface_hit_bytes,
              "view rays' hits");
  // Of the least size where nothing bounces.
  Buffer bounces(device,
                 options.bounces > 0
                     ? cut.rows * cut.columns * options.samples * surface_bounce_bytes
                     : surface_bounce_bytes,
                 "bounced rays' hits");
  Buffer out(device, cut.lights * cut.rows * cut.columns * texel_bytes, "rendered texels");
  Buffer lights(
      device,
      ops::round_up(cut.lights, ops::vector_width(device)) * values_per_light * sizeof(float),
      "lights");

  std::vector<std::byte> done(cut.lights * info.image_bytes()), next(done.size());
  std::vector<std::byte> band_values(cut.lights * cut.rows * cut.columns * texel_bytes);
  std::size_t done_first = 0, done_count = 0;
  std::size_t packed_first = shape.lights;  // none yet
  std::size_t packed_count = 0;

  const auto write_done = [&] {
    if (done_count == 0) return;
    sink.write(done_first, done_count,
               std::span<const std::byte>(done).first(done_count * info.image_bytes()));
    if (options.progress) options.progress(done_first + done_count);
    done_count = 0;
  };

  // The image is cut into bands, once for all views and runs.
  std::vector<TexelBand> bands;
  for (std::size_t row = 0; row < shape.height; row += cut.rows) {
    for (std::size_t column = 0; column < shape.width; column += cut.columns) {
      bands.push_back({row, std::min(cut.rows, shape.height - row), column,
                       std::min(cut.columns, shape.width - column)});
    }
  }

  for (std::size_t view = 0; view < shape.views; ++view) {
    std::optional<TexelBand> traced;  // what `hits` holds
    for (std::size_t first = 0; first < shape.lights; first += cut.lights) {
      const std::size_t count = std::min(cut.lights, shape.lights - first);
      if (packed_first != first || packed_count != count) {
        const std::vector<float> packed = pack_surface_lights(device, surface, info, first, count);
        device.write(lights, std::span<const float>(packed));
        packed_first = first;
        packed_count = count;
      }
      for (const TexelBand& band : bands) {
        check_interrupt();
        if (traced != band) {
          launch_surface_hits(device, surface, tables, info, options, view, band, hits);
          if (options.bounces > 0) {
            launch_surface_bounce(device, surface, tables, info, options, view, band, hits,
                                  bounces);
          }
          traced = band;
        }
        launch_surface_shade(device, surface, tables, info, options, view, band, hits, bounces,
                             lights, count, out);
        device.flush();
        // While the device works, the run before is written.
        write_done();
        const std::span<std::byte> values =
            std::span(band_values).first(count * band.texels() * texel_bytes);
        device.read(out, 0, values);
        place_band(values, band, info, next);
      }
      std::swap(done, next);
      done_first = view * shape.lights + first;
      done_count = count;
    }
  }
  device.finish();
  write_done();
  sink.finish();
}

}  // namespace weft
