#include "weft/ops/look_up_factors.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "weft/error.hpp"
#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

cl_kernel factor_kernel(Device& device, const LookupBatch& batch, const char* name) {
  return device.kernel(kernel_sources::look_up_factors,
                       lookup_options(device, batch.lookup, batch.shape.channels), name);
}

void launch_lookups(Device& device, cl_kernel kernel, const LookupBatch& batch) {
  launch_items(device, kernel, ceil_div(batch.count, lookup_block(device)));
}

}  // namespace

std::string lookup_options(const Device& device, const LookupShape& lookup, std::size_t channels) {
  return fmt::format(
      "-DTEXELS={} -DVIEWS={} -DLIGHTS={} -DDIRECTIONS={} -DCHANNELS={} -DLOOKUPS={}",
      lookup.texels, lookup.views, lookup.lights, lookup.directions ? 1 : 0, channels,
      lookup_block(device));
}

std::size_t lookup_block(const Device& device) {
  return device.limits().is_cpu ? 64 : 1;
}

std::size_t row_vectors(std::size_t rank) {
  return ceil_div(rank, row_lanes);
}

std::size_t row_floats(std::size_t rows, std::size_t rank, const char* what) {
  const std::size_t width = row_vectors(rank) * row_lanes;
  constexpr std::size_t most = std::numeric_limits<std::size_t>::max() / sizeof(float);
  if (width > 0 && rows > most / width) {
    fail_runtime("{}: {} rows of {} floats are more than memory can hold", what, rows, width);
  }
  return rows * width;
}

void pad_rows(std::size_t rows, std::size_t rank, const RowValue& value, std::span<float> to) {
  const std::size_t width = row_vectors(rank) * row_lanes;
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t j = 0; j < rank; ++j) to[row * width + j] = value(row, j);
  }
}

void write_rows(Device& device, std::size_t rows, std::size_t rank, const RowValue& value,
                Buffer& to) {
  if (rank == 0) return;
  const std::size_t width = row_vectors(rank) * row_lanes;
  constexpr std::size_t chunk_floats = std::size_t{1} << 18;
  const std::size_t run = std::clamp<std::size_t>(chunk_floats / width, 1, rows);
  std::vector<float> part(run * width, 0.0f);
  for (std::size_t first = 0; first < rows; first += run) {
    const std::size_t count = std::min(run, rows - first);
    pad_rows(
        count, rank, [&](std::size_t row, std::size_t j) { return value(first + row, j); }, part);
    device.write(to, std::span<const float>(part).first(count * width), first * width);
  }
}

void look_up_pca(Device& device, const LookupBatch& batch, std::size_t rank, const Buffer& A,
                 const Buffer& B, const Buffer& mean) {
  const cl_kernel kernel = factor_kernel(device, batch, "look_up_pca");
  set_arguments(kernel, ulong(batch.count), ulong(batch.shape.lights), ulong(row_vectors(rank)),
                batch.lookups, A, B, mean, batch.out);
  launch_lookups(device, kernel, batch);
}

void look_up_view_pca(Device& device, const LookupBatch& batch, const Buffer& views,
                      const Buffer& A, const Buffer& B, const Buffer& mean) {
  const cl_kernel kernel = factor_kernel(device, batch, "look_up_view_pca");
  set_arguments(kernel, ulong(batch.count), ulong(batch.shape.lights), views, batch.lookups, A, B,
                mean, batch.out);
  launch_lookups(device, kernel, batch);
}

void look_up_lpca(Device& device, const LookupBatch& batch, std::size_t rank,
                  const Buffer& clusters, const Buffer& A, const Buffer& B, const Buffer& mean) {
  const cl_kernel kernel = factor_kernel(device, batch, "look_up_lpca");
  set_arguments(kernel, ulong(batch.count), ulong(batch.shape.images()), ulong(batch.shape.lights),
                ulong(row_vectors(rank)), clusters, batch.lookups, A, B, mean, batch.out);
  launch_lookups(device, kernel, batch);
}

double look_up_flops(const LookupShape& lookup, std::size_t channels, std::size_t rank) {
  const std::size_t rows = lookup.texels + channels * (lookup.views * lookup.lights + 1);
  return 2.0 * static_cast<double>(rows) * static_cast<double>(rank) +
         2.0 * static_cast<double>(lookup.views * lookup.lights * channels);
}

}  // namespace weft::ops
