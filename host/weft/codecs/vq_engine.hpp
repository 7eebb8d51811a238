// What the steps of `vq` do on the device, see lib/weft/reference/vq.hpp: values are resampled and
// the nearest code-vectors found there.
#pragma once

#include <memory>

#include "weft/btf/btf.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/reference/vq.hpp"

namespace weft {

// `trained`: as in plan_vq.
MemoryPlan plan_device_vq(Device& device, const BtfInfo& source, const VqRequest& request,
                          std::size_t trained, const Job& job);

// Resampling and search on the device; it must outlive the engine.
std::unique_ptr<VqEngine> device_vq_engine(Device& device, const BtfInfo& source,
                                           const VqRequest& request);

}  // namespace weft
