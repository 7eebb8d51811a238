#include "weft/ops/look_up_raw.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"

namespace weft::ops {

void look_up_raw(Device& device, const LookupBatch& batch, DType dtype, std::size_t first,
                 std::size_t images, const Buffer& raw) {
  const cl_kernel kernel =
      device.kernel(kernel_sources::look_up_raw,
                    fmt::format("{} {}", value_options(dtype, true),
                                lookup_options(device, batch.lookup, batch.shape.channels)),
                    "look_up_raw");
  set_arguments(kernel, ulong(batch.count), ulong(batch.shape.lights), ulong(batch.shape.texels()),
                ulong(first), ulong(images), batch.lookups, raw, batch.out);
  launch_items(device, kernel, ceil_div(batch.count, lookup_block(device)));
}

void expand_taps(Device& device, const LookupShape& lookup, std::size_t first, std::size_t count,
                 const Buffer& lookups, Buffer& taps) {
  const cl_kernel kernel =
      device.kernel(kernel_sources::look_up_raw, lookup_options(device, lookup, 1), "expand_taps");
  set_arguments(kernel, ulong(first), ulong(count), lookups, taps);
  launch_items(device, kernel, ceil_div(count, lookup_block(device)));
}

void sum_taps(Device& device, const LookupShape& lookup, std::size_t channels, std::size_t first,
              std::size_t count, const Buffer& lookups, const Buffer& values, Buffer& out) {
  const cl_kernel kernel = device.kernel(kernel_sources::look_up_raw,
                                         lookup_options(device, lookup, channels), "sum_taps");
  set_arguments(kernel, ulong(first), ulong(count), lookups, values, out);
  launch_items(device, kernel, ceil_div(count, lookup_block(device)));
}

void reduce_mip(Device& device, const BtfInfo& info, std::size_t images, std::size_t first_in,
                const Buffer& in, std::size_t first_out, Buffer& out) {
  const BtfShape& shape = info.shape;
  const cl_kernel kernel =
      device.kernel(kernel_sources::reduce_mip,
                    fmt::format("{} -DENCODING={} -DCHANNELS={}", value_options(info.dtype, true),
                                static_cast<int>(info.encoding), shape.channels),
                    "reduce_mip");
  set_arguments(kernel, ulong(shape.height), ulong(shape.width), ulong(first_in), ulong(first_out),
                in, out);
  launch_items(device, kernel, ceil_div(shape.height, 2), images);
}

}  // namespace weft::ops
