// Operations on raw tiles.
#include <fmt/core.h>

#include <algorithm>
#include <functional>
#include <memory>

#include "bench/benchmark.hpp"
#include "weft/ops/invert_colour.hpp"
#include "weft/ops/log_error_sums.hpp"
#include "weft/ops/tile.hpp"

namespace weft {
namespace {

// Everything that an operation on a tile reads or writes.
struct TileData {
  TileData(Device& device, const ops::TileShape& tile)
      : raw(zero_buffer(device, tile.values() * size_of(tile.dtype), "raw")),
        mean(zero_buffer(device, tile.rows() * sizeof(float), "mean")),
        panels(zero_buffer(device,
                           std::max(ops::panel_elements(device, tile),
                                    ops::transposed_panel_elements(device, tile)) *
                               sizeof(float),
                           "panels")),
        decoded(zero_buffer(device, tile.values() * sizeof(float), "decoded")) {}
  Buffer raw, mean, panels, decoded;
};

using TileOperation = std::function<void(Device&, const ops::TileShape&, TileData&)>;

Benchmark on_tile(const char* name, const ops::TileShape& tile, double flops_per_value,
                  double bytes_per_value, const TileOperation& operation) {
  const auto values = static_cast<double>(tile.values());
  Benchmark benchmark{
      name,
      fmt::format("{} x {} x {} {}", tile.images, tile.texels, tile.channels, name_of(tile.dtype)),
      flops_per_value * values, bytes_per_value * values};
  benchmark.prepare = [=](Device& device) -> Run {
    const auto data = std::make_shared<TileData>(device, tile);
    return [=, &device] { operation(device, tile, *data); };
  };
  return benchmark;
}

void transcode(Device& device, const ops::TileShape& tile, TileData& data, Encoding to) {
  ops::transcode_tile(device, tile.values(), data.decoded, Encoding::linear, to, tile.dtype,
                      data.raw);
}

// In place on decoded texels of three channels.
Benchmark inverse_colour(ColourTransform::Kind kind) {
  ColourTransform transform;
  transform.kind = kind;
  if (!transform.is_linear()) transform.largest = 1;
  const ops::TileShape tile{64, 16384, 3, DType::f32, false};
  const auto values = static_cast<double>(tile.values());
  Benchmark benchmark{fmt::format("invert_colour {}", name_of(kind)),
                      fmt::format("{} x {} x {}", tile.images, tile.texels, tile.channels), 0,
                      2 * sizeof(float) * values};
  benchmark.prepare = [=](Device& device) -> Run {
    const auto data = std::make_shared<TileData>(device, tile);
    const auto inverse = std::make_shared<ops::InverseColour>(device, transform, tile.channels);
    return [=, &device] { inverse->invert(device, tile.images * tile.texels, data->decoded); };
  };
  return benchmark;
}

}  // namespace

std::vector<Benchmark> tile_benchmarks() {
  using Tile = ops::TileShape;
  std::vector<Benchmark> benchmarks;
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    const Tile tile{64, 16384, 3, dtype, false};
    const auto size = static_cast<double>(size_of(dtype));
    benchmarks.push_back(
        on_tile("scan_tile", tile, 6, size, [](Device& device, const Tile& shape, TileData& data) {
          ops::scan_tile(device, shape, data.raw);
        }));
    benchmarks.push_back(on_tile(
        "convert_tile", tile, 2, size + 4, [](Device& device, const Tile& shape, TileData& data) {
          ops::convert_tile(device, shape, data.raw, data.mean, 0, 1.0f, data.panels);
        }));
    benchmarks.push_back(on_tile("convert_tile_transposed", tile, 2, size + 4,
                                 [](Device& device, const Tile& shape, TileData& data) {
                                   ops::convert_tile_transposed(device, shape, data.raw, data.mean,
                                                                0, 1.0f, data.panels);
                                 }));
    benchmarks.push_back(on_tile("error_sums", tile, 7, size + 4,
                                 [](Device& device, const Tile& shape, TileData& data) {
                                   ops::error_sums(device, shape, data.raw, data.decoded, 1.0f);
                                 }));
    benchmarks.push_back(on_tile("transcode_tile", tile, 1, size + 4,
                                 [](Device& device, const Tile& shape, TileData& data) {
                                   transcode(device, shape, data, Encoding::linear);
                                 }));
    benchmarks.push_back(on_tile("transcode_tile to sRGB", tile, 1, size + 4,
                                 [](Device& device, const Tile& shape, TileData& data) {
                                   transcode(device, shape, data, Encoding::srgb);
                                 }));
  }
  for (const auto kind :
       {ColourTransform::Kind::ycrcb, ColourTransform::Kind::log, ColourTransform::Kind::logluv}) {
    benchmarks.push_back(inverse_colour(kind));
  }
  const Tile floats{64, 16384, 3, DType::f32, false};
  benchmarks.push_back(on_tile("log_error_sums", floats, 0, 8,
                               [](Device& device, const Tile& shape, TileData& data) {
                                 ops::log_error_sums(device, shape, data.raw, data.decoded, 1.0);
                               }));
  return benchmarks;
}

}  // namespace weft
