#include "weft/ops/turn_channels.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

constexpr std::size_t texels_of_item = 2048;
constexpr std::size_t panels_of_item = 16;

cl_kernel turning_kernel(Device& device, const ChannelsFirst& images, const char* name) {
  return device.kernel(kernel_sources::turn_channels,
                       fmt::format("{} -DCHANNELS={} -DRANK={} -DFACTOR={} -DTEXELS={} -DPANELS={}",
                                   vector_option(device), images.channels, images.rank,
                                   images.factor ? 1 : 0, texels_of_item, panels_of_item),
                       name);
}

}  // namespace

void turn_channels(Device& device, const ChannelsFirst& images, Buffer& to, std::size_t to_offset) {
  const cl_kernel kernel = turning_kernel(device, images, "turn_channels");
  set_arguments(kernel, ulong(images.texels), images.buffer, ulong(images.offset),
                images.factor ? *images.factor : images.buffer, to, ulong(to_offset));
  launch_items(device, kernel, ceil_div(images.texels, texels_of_item), images.count);
}

void pack_channels(Device& device, const ChannelsFirst& images, Buffer& panels) {
  const cl_kernel kernel = turning_kernel(device, images, "pack_channels");
  set_arguments(kernel, ulong(images.count), ulong(images.texels), images.buffer,
                ulong(images.offset), images.factor ? *images.factor : images.buffer, panels);
  const std::size_t width = panel_width(device);
  launch_items(device, kernel,
               ceil_div(ceil_div(images.texels * images.channels, width), panels_of_item));
}

}  // namespace weft::ops
