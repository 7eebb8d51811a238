// How fast a model is decoded: in bulk, and texel by texel.
#pragma once

#include <cstddef>
#include <string>

#include "report.hpp"
#include "weft/device/device.hpp"

namespace weft {

struct ModelBenchOptions {
  std::string model;                // a .weft file
  std::size_t lookups = 1'000'000;  // random look-ups of one call
};

// Adds the fields of one model to the report:
//
//   texel_time     mean of 1000 random texels by Model::decode_texel, one thread of the host
//   images         all of them on the device, beside what their flops and bytes take at the peaks
//   look-ups       random (texel, view, light) in one call, as they come and sorted by texel
void bench_model(Device& device, const ModelBenchOptions& options, Report& report);

}  // namespace weft
