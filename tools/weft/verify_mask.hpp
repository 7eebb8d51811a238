// What weft verify checks of a model's mask: its model, if it has one, by device and reference, and
// its error texels against the raw BTF's.
#pragma once

#include "report.hpp"
#include "weft/btf/selection.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/model/model.hpp"

namespace weft {

struct MaskCheck {
  bool agree = true;        // device and reference, within `allowed` tolerances
  bool as_recorded = true;  // the error texels of the whole
};

// Adds what it finds to the report. `raw`: the part of the raw BTF, of mip level `level.level`,
// that the model decodes to, or null; `whole`: whether that is all that the model was fitted to.
MaskCheck verify_mask(Device& device, const Model& model, const Selection& level,
                      const BtfInfo* raw, bool whole, double allowed, Report& report, Job& job);

}  // namespace weft
