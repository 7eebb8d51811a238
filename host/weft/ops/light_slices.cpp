#include "weft/ops/light_slices.hpp"

#include <fmt/core.h>

#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

std::size_t block(const Device& device) {
  return device.limits().is_cpu ? 64 : 1;
}

template <typename T>
Buffer table(Device& device, const std::vector<T>& values, const char* what) {
  Buffer buffer(device, values.size() * sizeof(T), what);
  device.write(buffer, std::span<const T>(values));
  return buffer;
}

void launch_entries(Device& device, cl_kernel kernel, std::size_t count) {
  launch_items(device, kernel, ceil_div(count, block(device)));
}

}  // namespace

DeviceLightNodes::DeviceLightNodes(Device& device, const BtfInfo& info, const LightNodes& nodes)
    : side_(nodes.side()), lights_(nodes.lights()) {
  info_.encoding = info.encoding;
  info_.shape = info.shape;
  const LightNodes::Tables tables = nodes.tables();
  std::vector<std::uint32_t> terms;
  for (std::size_t k = 0; k < tables.lights.size(); ++k) {
    terms.push_back(tables.lights[k]);
    terms.push_back(std::bit_cast<std::uint32_t>(tables.weights[k]));
  }
  const std::span<const double> albedo = nodes.albedo_weights();
  first_ = table(device, tables.first, "terms of nodes of slices");
  terms_ = table(device, terms, "lights of nodes of slices");
  defence_ = table(device, tables.defence, "cosines of nodes of slices");
  albedo_weights_ =
      table(device, std::vector<float>(albedo.begin(), albedo.end()), "weights of albedos");
}

cl_kernel DeviceLightNodes::kernel(Device& device, const char* name) const {
  return device.kernel(
      kernel_sources::light_slices,
      fmt::format("-DENCODING={} -DCHANNELS={} -DENTRIES={}", static_cast<int>(info_.encoding),
                  info_.shape.channels, block(device)),
      name);
}

void DeviceLightNodes::write_lookups(Device& device, std::size_t slices, const Buffer& texels,
                                     const Buffer& views, Buffer& lookups) const {
  const cl_kernel write = kernel(device, "write_slice_lookups");
  set_arguments(write, ulong(slices), static_cast<cl_uint>(lights_), texels, views, lookups);
  launch_entries(device, write, slices);
}

void DeviceLightNodes::make_densities(Device& device, std::size_t slices, const Buffer& values,
                                      Buffer& luminances, Buffer& nodes, Buffer& row_sums) const {
  const cl_kernel weigh = kernel(device, "slice_luminances");
  set_arguments(weigh, ulong(slices * lights_), values, luminances);
  launch_entries(device, weigh, slices * lights_);
  const cl_kernel gather = kernel(device, "slice_nodes");
  set_arguments(gather, ulong(slices), static_cast<cl_uint>(lights_), static_cast<cl_uint>(side_),
                static_cast<float>(LightNodes::defensive_share), first_, terms_, defence_,
                luminances, nodes, row_sums);
  launch_entries(device, gather, slices);
}

void DeviceLightNodes::albedos(Device& device, std::size_t slices, const Buffer& values,
                               Buffer& out) const {
  const cl_kernel sum = kernel(device, "slice_albedos");
  set_arguments(sum, ulong(slices), static_cast<cl_uint>(lights_), albedo_weights_, values, out);
  launch_entries(device, sum, slices);
}

void DeviceLightNodes::draw(Device& device, std::size_t count, const Buffer& slice_of,
                            const Buffer& numbers, const Buffer& nodes, const Buffer& row_sums,
                            Buffer& drawn) const {
  const cl_kernel invert = kernel(device, "draw_lights");
  set_arguments(invert, ulong(count), static_cast<cl_uint>(side_), slice_of, numbers, nodes,
                row_sums, drawn);
  launch_entries(device, invert, count);
}

void DeviceLightNodes::densities(Device& device, std::size_t count, const Buffer& slice_of,
                                 const Buffer& lights, const Buffer& nodes, Buffer& out) const {
  const cl_kernel find = kernel(device, "light_densities");
  set_arguments(find, ulong(count), static_cast<cl_uint>(side_), slice_of, lights, nodes, out);
  launch_entries(device, find, count);
}

}  // namespace weft::ops
