#include "weft/ops/order_lookups.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <span>
#include <vector>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {
constexpr std::size_t most_lookups = std::size_t{1} << 20;  // of an order
}  // namespace

TexelOrder::TexelOrder(Device& device, std::size_t texels) : device_(device), texels_(texels) {
  if (!device.limits().is_cpu || texels > most_lookups) return;
  starts_ = Buffer(device, texels * sizeof(std::uint32_t), "look-ups of each texel");
  order_ = Buffer(device, most_lookups * sizeof(std::uint32_t), "order of the look-ups");
}

std::size_t TexelOrder::most_bytes(std::size_t texels) {
  return (texels + most_lookups) * sizeof(std::uint32_t);
}

void TexelOrder::for_each(const LookupBatch& batch,
                          const std::function<void(const LookupBatch&)>& work) {
  if (!order_ || batch.count < texels_) return work(batch);
  const cl_kernel kernel =
      device_.kernel(kernel_sources::order_lookups, fmt::format("-DWORDS={}", batch.lookup.words()),
                     "order_lookups");
  const std::vector<std::uint32_t> zeros(texels_, 0);
  for (std::size_t first = 0; first < batch.count; first += most_lookups) {
    LookupBatch part = batch;
    part.first = first;
    part.count = std::min(most_lookups, batch.count - first);
    part.order = &order_;
    device_.write(starts_, std::span<const std::uint32_t>(zeros));
    set_arguments(kernel, ulong(part.first), ulong(part.count), ulong(texels_), batch.lookups,
                  starts_, order_);
    launch_items(device_, kernel, 1);
    work(part);
  }
}

std::string order_option(const LookupBatch& batch) {
  return fmt::format("-DORDERED={}", batch.order ? 1 : 0);
}

const Buffer& order_argument(const LookupBatch& batch) {
  return batch.order ? *batch.order : batch.lookups;
}

}  // namespace weft::ops
