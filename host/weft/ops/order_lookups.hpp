// Look-ups in the order of their texels: kernels/order_lookups.cl.
#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include "weft/device/device.hpp"
#include "weft/ops/look_up_factors.hpp"

namespace weft::ops {

// Room for the order of the look-ups in a BTF of so many texels.
class TexelOrder {
 public:
  TexelOrder(Device& device, std::size_t texels);

  // Most device memory of it.
  static std::size_t most_bytes(std::size_t texels);

  // Calls work with parts of a batch, in turn: with an order by texels on a CPU device where there
  // are as many look-ups as texels, else with the batch as it is.
  void for_each(const LookupBatch& batch, const std::function<void(const LookupBatch&)>& work);

 private:
  Device& device_;
  std::size_t texels_;
  Buffer starts_, order_;  // none on devices that do not sort
};

// For one kernel: the option that tells it whether there is an order, and that as its argument.
std::string order_option(const LookupBatch& batch);
const Buffer& order_argument(const LookupBatch& batch);

}  // namespace weft::ops
