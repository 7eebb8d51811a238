// What a material reflects in all of even light, view by view: for weft info --albedo.
#pragma once

#include "report.hpp"
#include "weft/btf/btf.hpp"
#include "weft/scene/light_sampling.hpp"

namespace weft {

// Adds a table `albedo`: for each measured view, its angles and the albedo of each channel
// (weft/scene/light_sampling.hpp), the mean over texels that are spread evenly, at most 64 of them.
void add_albedo_table(Report& report, const BtfInfo& info, LightSampler& sampler);

}  // namespace weft
