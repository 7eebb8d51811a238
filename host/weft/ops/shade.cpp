#include "weft/ops/shade.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <span>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

std::size_t block(const Device& device) {
  return device.limits().is_cpu ? 64 : 1;
}

// At least one element, so that there is a buffer to set as an argument.
template <typename T>
Buffer table(Device& device, const std::vector<T>& values, const char* what) {
  Buffer buffer(device, std::max<std::size_t>(values.size(), 1) * sizeof(T), what);
  device.write(buffer, std::span<const T>(values));
  return buffer;
}

cl_kernel shade_kernel(Device& device, const char* name, const BtfInfo* info = nullptr,
                       ShadeLookups kind = ShadeLookups::measured) {
  std::string options = fmt::format("-DENTRIES={}", block(device));
  if (kind == ShadeLookups::directions) options += " -DDIRECTIONS=1";
  if (info) {
    options +=
        fmt::format(" -DENCODING={} -DCHANNELS={} -DBRDF={}", static_cast<int>(info->encoding),
                    info->shape.channels, info->quantity == Quantity::brdf ? 1 : 0);
  }
  return device.kernel(kernel_sources::shade_points, options, name);
}

void launch_entries(Device& device, cl_kernel kernel, std::size_t count) {
  launch_items(device, kernel, ceil_div(count, block(device)));
}

}  // namespace

DeviceHemisphere::DeviceHemisphere(Device& device, const Hemisphere& hemisphere) {
  const HemisphereTables tables = hemisphere.tables();
  triangle_count_ = tables.triangles.size() / 6;
  edge_count_ = tables.edges.size() / 4;
  side_ = tables.side;
  measured_ = table(device, tables.directions, "measured directions");
  triangles_ = table(device, tables.triangles, "triangles");
  triangle_rows_ = table(device, tables.triangle_rows, "weights of triangles");
  edges_ = table(device, tables.edges, "edges");
  edge_rows_ = table(device, tables.edge_rows, "weights of edges");
  grid_ = table(device, tables.grid, "grid of triangles");
}

std::size_t DeviceHemisphere::bytes() const {
  return measured_.size() + triangles_.size() + triangle_rows_.size() + edges_.size() +
         edge_rows_.size() + grid_.size();
}

void DeviceHemisphere::weigh(Device& device, std::size_t count, const Buffer& directions,
                             Buffer& out) const {
  const cl_kernel kernel =
      device.kernel(kernel_sources::weigh_directions, fmt::format("-DDIRECTIONS={}", block(device)),
                    "weigh_directions");
  set_arguments(kernel, ulong(count), directions, static_cast<cl_uint>(triangle_count_),
                static_cast<cl_uint>(edge_count_), static_cast<cl_uint>(side_), measured_,
                triangles_, triangle_rows_, edges_, edge_rows_, grid_, out);
  launch_entries(device, kernel, count);
}

LookupShape lookup_shape(ShadeLookups lookups) {
  switch (lookups) {
    case ShadeLookups::grid:
      return {4, 1, 3};
    case ShadeLookups::directions:
      return {4, 1, 1, true};
    default:
      return {4, 3, 3};
  }
}

void write_lookups(Device& device, std::size_t count, const Buffer& list, const ShadeTables& tables,
                   ShadeLookups kind, Buffer& lookups) {
  if (kind == ShadeLookups::directions) {
    const cl_kernel kernel = shade_kernel(device, "write_direction_lookups");
    set_arguments(kernel, ulong(count), list, tables.point_of, tables.taps, tables.view_directions,
                  tables.light_directions, lookups);
    launch_entries(device, kernel, count);
    return;
  }
  const bool of_grid = kind == ShadeLookups::grid;
  const cl_kernel kernel = device.kernel(
      kernel_sources::shade_points,
      fmt::format("-DENTRIES={} -DGRID={}", block(device), of_grid ? 1 : 0), "write_lookups");
  // without a grid there is no such table, and it is not looked at
  set_arguments(kernel, ulong(count), list, tables.point_of, tables.taps, tables.views,
                of_grid ? tables.grid_views : tables.point_of, tables.lights, lookups);
  launch_entries(device, kernel, count);
}

void write_mask_lookups(Device& device, std::size_t count, const Buffer& list,
                        const ShadeTables& tables, Buffer& lookups) {
  const cl_kernel kernel = shade_kernel(device, "write_mask_lookups");
  set_arguments(kernel, ulong(count), list, tables.taps, tables.views, lookups);
  launch_entries(device, kernel, count);
}

void set_masks(Device& device, std::size_t count, const Buffer& list, const Buffer& values,
               ShadeTables& tables) {
  const cl_kernel kernel = shade_kernel(device, "set_masks");
  set_arguments(kernel, ulong(count), list, values, tables.masks);
  launch_entries(device, kernel, count);
}

void set_opacities(Device& device, std::size_t count, const Buffer& list, const Buffer& values,
                   const VisibilityMapping* mapping, ShadeTables& tables) {
  const cl_kernel kernel = shade_kernel(device, "set_opacities");
  const VisibilityMapping used = mapping ? *mapping : VisibilityMapping{};
  set_arguments(kernel, ulong(count), list, values, cl_uint{mapping ? 1u : 0u},
                static_cast<float>(used.threshold), static_cast<float>(used.weight), tables.masks);
  launch_entries(device, kernel, count);
}

void light_entries(Device& device, const BtfInfo& info, ShadeLookups kind, std::size_t count,
                   const Buffer& list, const Buffer& values, ShadeTables& tables) {
  const cl_kernel kernel = shade_kernel(device, "light_entries", &info, kind);
  set_arguments(kernel, ulong(count), list, tables.point_of, values, tables.share, tables.masks,
                kind == ShadeLookups::directions ? tables.light_directions : tables.lights,
                tables.irradiance, tables.light);
  launch_entries(device, kernel, count);
}

void sum_points(Device& device, std::size_t points, const ShadeTables& tables, Buffer& radiance) {
  const cl_kernel kernel = shade_kernel(device, "sum_points");
  set_arguments(kernel, ulong(points), tables.first, tables.share, tables.masks, tables.light,
                radiance);
  launch_entries(device, kernel, points);
}

}  // namespace weft::ops
