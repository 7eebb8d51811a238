// A surface of layers in device memory, in the tables of kernels/surface_march.cl.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

class DeviceSurface {
 public:
  // Copies a surface that `validate` accepts.
  DeviceSurface(Device& device, const Surface& surface);

  // Bytes of device memory per cell of so many layers, so many of them with undersides, and bytes
  // of host memory per cell while they are copied.
  static std::size_t cell_bytes(std::size_t layers, std::size_t undersides);
  static std::size_t copied_cell_bytes(std::size_t layers, std::size_t undersides);

  const Buffer& heights() const { return heights_; }
  const Buffer& ceilings() const { return ceilings_; }
  const Buffer& shape() const { return shape_; }
  const Buffer& color() const { return color_; }
  const Buffer& lobes() const { return lobes_; }

  // What a program of surface_march.cl is compiled for.
  const std::string& build_options() const { return build_options_; }

 private:
  Buffer heights_, ceilings_, shape_, color_, lobes_;
  std::string build_options_;
};

// log2 of the side of a block of cells that `surface_ceilings` bounds.
inline constexpr std::size_t block_bits = 3;

// For blocks of cells, [rows / side][columns / side] rounded up, the highest elevation of any layer
// within the block and side + 1 cells round it.
std::vector<float> surface_ceilings(const Surface& surface);

}  // namespace weft
