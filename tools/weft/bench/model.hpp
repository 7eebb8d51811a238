// How fast a model is decoded: in bulk, and texel by texel.
#pragma once

#include <cstddef>
#include <string>

#include "report.hpp"
#include "selection_options.hpp"
#include "weft/device/device.hpp"

namespace weft {

struct ModelBenchOptions {
  std::string model;  // a .weft file
  bool bound = true;  // measure the device's peaks too, and say what part of them is reached
  std::size_t lookups = 1'000'000;  // random look-ups of one call
  std::string filter;               // only measurements whose name contains this
  SelectionOptions selection;       // of the model
};

// Adds the fields of one model to the report, those whose name the filter is part of:
//
//   texel          mean of 1000 random texels by Model::decode_texel, one thread of the host;
//                  of tucker and tt also its products and sums
//   images         all of them on the device, beside what their flops and bytes take at the peaks
//   look_ups       random (texel, view, light) in one call, as they come and sorted by texel; and a
//                  tenth as many of 4 texels, 3 views and 3 lights, random too; in a model of all
//                  directions, of views and lights between the measured ones, with a view and a
//                  texel of their own and, coherent, 64 of each
//   lights         directions to light drawn, and densities of directions, on the device and by the
//                  reference: each of a view and a texel of its own, and coherent, 64 of each; of
//                  slices that are looked up and inverted, and, of a codec that has them, directly
//                  from its own tables: on all cores, and on one beside how many times as fast that
//                  is as the reference's slices, which take one, too
void bench_model(Device& device, const ModelBenchOptions& options, Report& report);

}  // namespace weft
