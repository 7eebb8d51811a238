#include "verify_mask.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "weft/codecs/occlusion.hpp"

namespace weft {
namespace {

// Texels of two masks that differ.
ErrorTexels differing(const std::vector<std::uint8_t>& wanted,
                      const std::vector<std::uint8_t>& found) {
  ErrorTexels errors;
  errors.texels = wanted.size();
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    if (wanted[i] != found[i]) ++errors.wrong;
  }
  return errors;
}

std::vector<Cell> row(const char* name, const ErrorTexels& errors) {
  return {text_cell(name), count_cell(errors.texels), count_cell(errors.wrong),
          number_cell(errors.share())};
}

double decision_level(OcclusionKind kind) {
  return kind == OcclusionKind::mask ? 0.5 : 0;
}

}  // namespace

MaskCheck verify_mask(Device& device, const Model& model, const Selection& level,
                      const BtfInfo* raw, bool whole, double allowed, Report& report, Job& job) {
  MaskCheck check;
  const Occlusion* const occlusion = model.info.occlusion.get();
  BtfInfo on_device = model.info.btf;
  BtfInfo by_reference = model.info.btf;
  std::size_t undecided = 0;  // texels that rounding may turn
  if (occlusion) {
    const Model& of_mask = *occlusion->model;
    const double unit = find_codec(of_mask.info.codec).decode_tolerance(of_mask);
    const std::vector<float> values = decode_occlusion(&device, *occlusion, job);
    const std::vector<float> reference = decode_occlusion(nullptr, *occlusion, job);
    double largest = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double d = std::abs(static_cast<double>(values[i]) - static_cast<double>(reference[i]));
      if (std::isnan(d) || d > largest) largest = d;
      if (std::abs(static_cast<double>(values[i]) - decision_level(occlusion->kind)) <= 2 * unit) {
        ++undecided;
      }
    }
    check.agree = largest <= allowed * unit;
    Report& section = report.section("mask_device_against_reference");
    section.add("largest_difference", largest);
    section.add("tolerance", unit);
    section.add("largest_in_tolerances", unit > 0 ? largest / unit : 0.0);
    section.add("agree", check.agree);
    on_device = with_mask(on_device, occlusion->kind, values);
    by_reference = with_mask(by_reference, occlusion->kind, reference);
  }
  if (!raw || raw->mask.empty() || on_device.mask.empty()) return check;
  const ErrorTexels errors = differing(raw->mask, select(on_device, level).mask);
  std::vector<std::vector<Cell>> rows{row("device", errors)};
  if (occlusion) {
    rows.push_back(row("reference", differing(raw->mask, select(by_reference, level).mask)));
    const ErrorTexels& recorded = occlusion->errors;
    rows.push_back(
        row(whole ? "recorded in the model" : "recorded of all that the model holds", recorded));
    const std::size_t low = std::min(errors.wrong, recorded.wrong);
    check.as_recorded = !whole || std::max(errors.wrong, recorded.wrong) - low <= undecided;
  }
  report.table("error_texels", {"decoded_by", "texels", "error_texels", "share"}, std::move(rows));
  return check;
}

}  // namespace weft
