// Images and single texels from nested code-books: kernels/decode_vq.cl, look_up_vq.cl.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/model/vq.hpp"
#include "weft/ops/look_up_factors.hpp"

namespace weft::ops {

// A model's code-books and the places of its directions on the device.
struct VqTables {
  VqTables(Device& device, const VqModel& model);
  static std::size_t bytes(const VqModel& model);

  OnionSizes grid;
  BtfShape shape;
  std::size_t chromaticities = 0;
  std::size_t size = 0;  // S4
  Buffer P4, c_P4, P3, c_P3, M, P2, c_P2, P1, I2, I1, C;
  Buffer P6, c_P6, channels;
  Buffer views, lights;
};

// Floats of the values of P4's entries in so many images.
std::size_t vq_entry_floats(const VqTables& tables, std::size_t images);

// Images [first, first + images) into `out`, [images][P][C], by way of `entries`.
void decode_vq(Device& device, const VqTables& tables, std::size_t first, std::size_t images,
               Buffer& entries, Buffer& out);

void look_up_vq(Device& device, const LookupBatch& batch, const VqTables& tables);

// Flops of the values of one entry of P4.
double vq_entry_flops(const VqTables& tables);

}  // namespace weft::ops
