// Trials of operations on raw tiles. Values are floats, which the device takes as they are.
#include <cmath>
#include <memory>
#include <string_view>

#include "tune/trial.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/tile.hpp"
#include "weft/reference/random.hpp"
#include "weft/reference/tile.hpp"

namespace weft {
namespace {

// A tile across the edges of vectors, panels and work-items of all legal sizes.
struct SmallTile {
  explicit SmallTile(Device& device)
      : host(shape.values()), values(shape.values()), raw(device, bytes(), "raw") {
    reference::fill_random(1, host);
    values.assign(host.begin(), host.end());
    device.write(raw, std::span<const float>(host));
  }
  std::size_t bytes() const { return shape.values() * sizeof(float); }

  ops::TileShape shape{3, 3001, 3, DType::f32, false};
  std::vector<float> host;
  std::vector<double> values;
  Buffer raw;
};

std::string check_scan(Device& device, const SmallTile& tile) {
  const ops::TileShape& shape = tile.shape;
  const reference::TileScan expected =
      reference::scan_tile(shape.images, shape.texels, shape.channels, tile.values);
  std::vector<double> sizes = tile.values;
  for (double& value : sizes) value = std::abs(value);
  const std::vector<double> magnitudes =
      reference::scan_tile(shape.images, shape.texels, shape.channels, sizes).sums;
  const ops::TileScan actual = ops::scan_tile(device, shape, tile.raw);
  // sums are compensated
  const std::string wrong = difference(actual.sums, expected.sums, [&](std::size_t i) {
    return error_bound(8, float_unit) * magnitudes[i];
  });
  if (!wrong.empty()) return "sums: " + wrong;
  if (actual.first_bad) return "a finite value counts as none";
  return difference(std::vector<float>{actual.largest}, {expected.largest},
                    [](std::size_t) { return 0.0; });
}

std::string check_convert(Device& device, const SmallTile& tile) {
  const ops::TileShape& shape = tile.shape;
  std::vector<float> means(shape.rows());
  reference::fill_random(2, means);
  const std::vector<double> rows =
      reference::convert_tile(shape.images, shape.texels, shape.channels, tile.values,
                              std::vector<double>(means.begin(), means.end()), 0.5);
  Buffer mean(device, means.size() * sizeof(float), "mean");
  device.write(mean, std::span<const float>(means));
  Buffer panels(device, ops::panel_elements(device, shape) * sizeof(float), "panels");
  double squares = 0;
  ops::convert_tile(device, shape, tile.raw, mean, 0, 0.5f, panels, &squares);
  std::vector<float> packed(ops::panel_elements(device, shape));
  device.read(panels, std::span<float>(packed));
  // panels(row, p); what lies past the last texel is zero
  const std::size_t width = ops::panel_width(device);
  std::vector<double> expected(packed.size(), 0.0);
  double sum = 0;
  for (std::size_t row = 0; row < shape.rows(); ++row) {
    for (std::size_t p = 0; p < shape.texels; ++p) {
      const double value = rows[row * shape.texels + p];
      expected[(p / width * shape.rows() + row) * width + p % width] = value;
      sum += value * value;
    }
  }
  const std::string wrong = difference(
      packed, expected, [&](std::size_t i) { return float_unit * std::abs(expected[i]); });
  if (!wrong.empty()) return "panels: " + wrong;
  const auto terms = static_cast<double>(shape.texels * shape.channels);
  const std::string wrong_sum = difference(std::vector<double>{squares}, {sum}, [&](std::size_t) {
    return error_bound(terms + 8, float_unit) * sum;
  });
  return wrong_sum.empty() ? wrong_sum : "sum of squares: " + wrong_sum;
}

std::string check_errors(Device& device, const SmallTile& tile) {
  std::vector<float> other(tile.host.size());
  reference::fill_random(3, other);
  const ErrorSums expected =
      reference::error_sums(tile.values, std::vector<double>(other.begin(), other.end()));
  Buffer decoded(device, tile.bytes(), "decoded");
  device.write(decoded, std::span<const float>(other));
  const ErrorSums actual = ops::error_sums(device, tile.shape, tile.raw, decoded, 1.0f);
  const double terms = static_cast<double>(tile.host.size());
  const std::vector<double> sums{expected.square_difference, expected.square_reference,
                                 expected.max_difference, expected.max_reference};
  return difference(std::vector<double>{actual.square_difference, actual.square_reference,
                                        actual.max_difference, actual.max_reference},
                    sums,
                    [&](std::size_t i) { return error_bound(terms + 8, float_unit) * sums[i]; });
}

std::string check_transcode(Device& device, const SmallTile& tile) {
  Buffer out(device, tile.bytes(), "out");
  device.fill_zero(out, 0, out.size());
  ops::transcode_tile(device, tile.host.size(), tile.raw, Encoding::linear, Encoding::linear,
                      DType::f32, out);
  std::vector<float> actual(tile.host.size());
  device.read(out, std::span<float>(actual));
  return difference(actual, tile.values, [](std::size_t) { return 0.0; });
}

Trial trial(const TunableKernel& kernel, std::string (*check)(Device&, const SmallTile&)) {
  Trial made{&kernel, {}, [check](Device& device) -> Check {
               const auto tile = std::make_shared<SmallTile>(device);
               return [=, &device] { return check(device, *tile); };
             }};
  // halves are what captures and renders are stored in
  for (Benchmark& benchmark : tile_benchmarks()) {
    if (benchmark.operation == kernel.name && benchmark.shape.ends_with(name_of(DType::f16))) {
      made.timed = std::move(benchmark);
    }
  }
  return made;
}

}  // namespace

std::vector<Trial> tile_trials() {
  return {trial(tunables::scan_tile, check_scan), trial(tunables::convert_tile, check_convert),
          trial(tunables::error_sums, check_errors),
          trial(tunables::transcode_tile, check_transcode)};
}

}  // namespace weft
