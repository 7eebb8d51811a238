#include "weft/ops/look_up_tucker.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"
#include "weft/ops/order_lookups.hpp"

namespace weft::ops {

void look_up_tucker(Device& device, const LookupBatch& batch, const TuckerRows& rows,
                    const Buffer& V, const Buffer& L, const Buffer& T) {
  const cl_kernel kernel = device.kernel(
      kernel_sources::look_up_tucker,
      fmt::format("{} {} -DRANK_V={} -DVIEWS_MERGED={} -DLIGHT_CHANNELS={}",
                  lookup_options(device, batch.lookup, batch.shape.channels), order_option(batch),
                  rows.views, rows.views_merged ? 1 : 0, rows.light_channels ? 1 : 0),
      "look_up_tucker");
  set_arguments(kernel, ulong(batch.count), ulong(batch.shape.lights),
                ulong(row_vectors(rows.lights)), ulong(batch.first), order_argument(batch),
                batch.lookups, V, L, T, batch.out);
  launch_items(device, kernel, ceil_div(batch.count, lookup_block(device)));
}

}  // namespace weft::ops
