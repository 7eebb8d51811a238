// The steps of drawing directions to light on a device: kernels/light_slices.cl.
#pragma once

#include <cstddef>

#include "weft/btf/btf.hpp"
#include "weft/device/device.hpp"
#include "weft/scene/light_nodes.hpp"

namespace weft::ops {

// A material's LightNodes in device memory.
class DeviceLightNodes {
 public:
  DeviceLightNodes(Device& device, const BtfInfo& info, const LightNodes& nodes);

  std::size_t side() const { return side_; }
  std::size_t cells() const { return side_ * side_; }
  std::size_t lights() const { return lights_; }

  // Records of LookupShape{1, 3, 1} under every light, [slices][lights][8] words, of slices at
  // `texels`, [slices], and `views`, [slices][8] words of DeviceHemisphere.
  void write_lookups(Device& device, std::size_t slices, const Buffer& texels, const Buffer& views,
                     Buffer& lookups) const;
  // The densities of slices: nodes [slices][cells], row_sums [slices][side], from what was looked
  // up, [slices][lights][channels]. `luminances`, [slices][lights], is written on the way.
  void make_densities(Device& device, std::size_t slices, const Buffer& values, Buffer& luminances,
                      Buffer& nodes, Buffer& row_sums) const;
  // [slices][channels]
  void albedos(Device& device, std::size_t slices, const Buffer& values, Buffer& out) const;
  // drawn: [count][4], direction and density, for numbers [count][2] and slices slice_of [count].
  void draw(Device& device, std::size_t count, const Buffer& slice_of, const Buffer& numbers,
            const Buffer& nodes, const Buffer& row_sums, Buffer& drawn) const;
  // Densities of lights [count][4], whose last words are not read.
  void densities(Device& device, std::size_t count, const Buffer& slice_of, const Buffer& lights,
                 const Buffer& nodes, Buffer& out) const;

 private:
  cl_kernel kernel(Device& device, const char* name) const;

  BtfInfo info_;  // encoding and channels
  std::size_t side_, lights_;
  Buffer first_, terms_, defence_, albedo_weights_;
};

}  // namespace weft::ops
