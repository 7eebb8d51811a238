#include "weft/ops/tile.hpp"

#include <fmt/core.h>

#include <limits>

#include "weft/ops/launch.hpp"

namespace weft {

// Sums of float are no longer than by default, so that bounds of their errors hold.
namespace {
constexpr Tunable scan_tile_macros[] = {
    {"CHUNK", 1024, {128, 256, 512, 1024}, "texels of a work-item"}};
constexpr Tunable convert_tile_macros[] = {
    {"PANELS", 16, {1, 2, 4, 8, 16}, "panels of a work-item"}};
constexpr Tunable error_sums_macros[] = {
    {"CHUNK", 2048, {256, 512, 1024, 2048}, "values of a work-item"}};
constexpr Tunable transcode_tile_macros[] = {
    {"CHUNK", 2048, {256, 512, 1024, 2048, 4096, 8192}, "values of a work-item"}};
}  // namespace
constinit const TunableKernel tunables::scan_tile{"scan_tile", scan_tile_macros};
constinit const TunableKernel tunables::convert_tile{"convert_tile", convert_tile_macros};
constinit const TunableKernel tunables::error_sums{"error_sums", error_sums_macros};
constinit const TunableKernel tunables::transcode_tile{"transcode_tile", transcode_tile_macros};

}  // namespace weft

namespace weft::ops {
namespace {
constexpr std::size_t transposed_texels = 512;

std::string tile_options(const TileShape& tile) {
  return fmt::format("{} -DCHANNELS={}", value_options(tile.dtype, tile.nan_zero), tile.channels);
}
}  // namespace

TileScan scan_tile(Device& device, const TileShape& tile, const Buffer& raw) {
  const std::size_t chunks = ceil_div(tile.texels, device.parameter(tunables::scan_tile, "CHUNK"));
  const std::size_t slots = tile.images * chunks;
  Buffer sums(device, slots * tile.channels * 2 * sizeof(float), "tile sums");
  Buffer largest(device, slots * sizeof(float), "tile maxima");
  Buffer first_bad(device, slots * sizeof(std::uint64_t), "tile checks");
  const cl_kernel kernel = device.kernel(
      kernel_sources::scan_tile,
      fmt::format("{} {}", tile_options(tile), device.tuned_options(tunables::scan_tile)),
      "scan_tile");
  set_arguments(kernel, raw, ulong(tile.texels), sums, largest, first_bad);
  launch_items(device, kernel, chunks, tile.images);

  std::vector<float> host_sums(slots * tile.channels * 2);
  std::vector<float> host_largest(slots);
  std::vector<std::uint64_t> host_bad(slots);
  device.read(sums, std::span<float>(host_sums));
  device.read(largest, std::span<float>(host_largest));
  device.read(first_bad, std::span<std::uint64_t>(host_bad));
  TileScan scan;
  scan.sums.assign(tile.rows(), 0.0);
  for (std::size_t slot = 0; slot < slots; ++slot) {
    const std::size_t image = slot / chunks;
    for (std::size_t c = 0; c < tile.channels; ++c) {
      const std::size_t at = (slot * tile.channels + c) * 2;
      scan.sums[image * tile.channels + c] +=
          static_cast<double>(host_sums[at]) + static_cast<double>(host_sums[at + 1]);
    }
    scan.largest = std::max(scan.largest, host_largest[slot]);
    if (!scan.first_bad && host_bad[slot] != std::numeric_limits<std::uint64_t>::max()) {
      scan.first_bad = image * tile.texels * tile.channels + host_bad[slot];
    }
  }
  return scan;
}

std::size_t panel_elements(const Device& device, const TileShape& tile, Arithmetic arithmetic) {
  return round_up(tile.texels, panel_width(device, arithmetic)) * tile.rows();
}

void convert_tile(Device& device, const TileShape& tile, const Buffer& raw, const Buffer& mean,
                  std::size_t first_row, float scale, Buffer& panels, double* squares,
                  Arithmetic arithmetic) {
  require_arithmetic(device, arithmetic);
  const std::size_t blocks = ceil_div(ceil_div(tile.texels, panel_width(device, arithmetic)),
                                      device.parameter(tunables::convert_tile, "PANELS"));
  Buffer partial(device, squares ? tile.images * blocks * size_of(arithmetic) : sizeof(double),
                 "sums of squares");
  const cl_kernel kernel = device.kernel(
      kernel_sources::convert_tile,
      fmt::format("{} {} {} -DSQUARES={}", tile_options(tile), vector_option(device, arithmetic),
                  device.tuned_options(tunables::convert_tile), squares ? 1 : 0),
      "convert_tile");
  with_real(arithmetic, [&](auto zero) {
    using Real = decltype(zero);
    set_arguments(kernel, raw, ulong(tile.texels), ulong(tile.images), mean, ulong(first_row),
                  static_cast<Real>(scale), panels, partial);
    launch_items(device, kernel, blocks, tile.images);
    if (!squares) return;
    std::vector<Real> host(tile.images * blocks);
    device.read(partial, std::span<Real>(host));
    for (const Real value : host) *squares += value;
  });
}

std::size_t transposed_panel_elements(const Device& device, const TileShape& tile,
                                      Arithmetic arithmetic) {
  return round_up(tile.rows(), panel_width(device, arithmetic)) * tile.texels;
}

void convert_tile_transposed(Device& device, const TileShape& tile, const Buffer& raw,
                             const Buffer& mean, std::size_t first_row, float scale, Buffer& panels,
                             Arithmetic arithmetic) {
  require_arithmetic(device, arithmetic);
  const cl_kernel kernel =
      device.kernel(kernel_sources::convert_tile,
                    fmt::format("{} {} -DTEXELS={}", tile_options(tile),
                                vector_option(device, arithmetic), transposed_texels),
                    "convert_tile_transposed");
  with_real(arithmetic, [&](auto zero) {
    set_arguments(kernel, raw, ulong(tile.texels), ulong(tile.images), mean, ulong(first_row),
                  static_cast<decltype(zero)>(scale), panels);
  });
  launch_items(device, kernel, ceil_div(tile.texels, transposed_texels),
               ceil_div(tile.rows(), panel_width(device, arithmetic)));
}

ErrorSums error_sums(Device& device, const TileShape& tile, const Buffer& raw,
                     const Buffer& decoded, float scale) {
  const std::size_t value_chunk = device.parameter(tunables::error_sums, "CHUNK");
  const std::size_t chunks = ceil_div(tile.values(), value_chunk);
  Buffer partial(device, chunks * 4 * sizeof(float), "partial errors");
  const cl_kernel kernel =
      device.kernel(kernel_sources::error_sums,
                    fmt::format("{} {}", value_options(tile.dtype, tile.nan_zero),
                                device.tuned_options(tunables::error_sums)),
                    "error_sums");
  set_arguments(kernel, raw, decoded, ulong(tile.values()), scale, partial);
  launch_items(device, kernel, chunks);
  std::vector<float> host(chunks * 4);
  device.read(partial, std::span<float>(host));
  ErrorSums sums;
  const double unscale = 1.0 / (static_cast<double>(scale) * static_cast<double>(scale));
  for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
    const float* values = host.data() + chunk * 4;
    sums.merge({std::min(value_chunk, tile.values() - chunk * value_chunk),
                unscale * static_cast<double>(values[1]), unscale * static_cast<double>(values[0]),
                static_cast<double>(values[2]), static_cast<double>(values[3])});
  }
  return sums;
}

std::vector<WeightedSquares> weighted_squares(Device& device, const TileShape& tile,
                                              const Buffer& raw, const Buffer& decoded,
                                              const Buffer& weights, float scale) {
  const std::size_t image = tile.texels * tile.channels;
  const std::size_t chunks = ceil_div(image, device.parameter(tunables::error_sums, "CHUNK"));
  Buffer partial(device, tile.images * chunks * 2 * sizeof(float), "partial errors");
  const cl_kernel kernel =
      device.kernel(kernel_sources::weighted_squares,
                    fmt::format("{} {}", value_options(tile.dtype, tile.nan_zero),
                                device.tuned_options(tunables::error_sums)),
                    "weighted_squares");
  set_arguments(kernel, raw, decoded, weights, ulong(image), scale, partial);
  launch_items(device, kernel, chunks, tile.images);
  std::vector<float> host(tile.images * chunks * 2);
  device.read(partial, std::span<float>(host));
  std::vector<WeightedSquares> squares(tile.images);
  const double unscale = 1.0 / (static_cast<double>(scale) * static_cast<double>(scale));
  for (std::size_t i = 0; i < tile.images * chunks; ++i) {
    WeightedSquares& sums = squares[i / chunks];
    sums.difference += unscale * static_cast<double>(host[2 * i]);
    sums.reference += unscale * static_cast<double>(host[2 * i + 1]);
  }
  return squares;
}

void transcode_tile(Device& device, std::size_t count, const Buffer& in, Encoding from, Encoding to,
                    DType dtype, Buffer& out) {
  const int type = dtype == DType::u8 ? 0 : dtype == DType::f16 ? 1 : 2;
  const cl_kernel kernel = device.kernel(
      kernel_sources::transcode_tile,
      fmt::format("-DFROM={} -DTO={} -DOUT={} {}", static_cast<int>(from), static_cast<int>(to),
                  type, device.tuned_options(tunables::transcode_tile)),
      "transcode_tile");
  set_arguments(kernel, in, ulong(count), out);
  launch_items(device, kernel,
               ceil_div(count, device.parameter(tunables::transcode_tile, "CHUNK")));
}

}  // namespace weft::ops
