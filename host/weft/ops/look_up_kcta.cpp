#include "weft/ops/look_up_kcta.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"
#include "weft/ops/order_lookups.hpp"

namespace weft::ops {

void look_up_kcta(Device& device, const LookupBatch& batch, const KctaRows& rows,
                  const Buffer& clusters, const Buffer& U, const Buffer& L, const Buffer& T) {
  const cl_kernel kernel = device.kernel(
      kernel_sources::look_up_tucker,
      fmt::format("{} {} -DMIXTURES={} -DRANK_V={} -DLIGHT_CHANNELS={} -DLOCAL_LIGHTS={}",
                  lookup_options(device, batch.lookup, batch.shape.channels), order_option(batch),
                  rows.mixtures, rows.views, rows.light_channels ? 1 : 0,
                  rows.local_lights ? 1 : 0),
      "look_up_kcta");
  set_arguments(kernel, ulong(batch.count), ulong(batch.shape.lights),
                ulong(row_vectors(rows.lights)), ulong(rows.clusters), ulong(batch.first),
                order_argument(batch), batch.lookups, clusters, U, L, T, batch.out);
  launch_items(device, kernel, ceil_div(batch.count, lookup_block(device)));
}

}  // namespace weft::ops
