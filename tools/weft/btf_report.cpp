#include "btf_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/metrics/error_sums.hpp"
#include "weft/model/model.hpp"

namespace weft {
namespace {

std::string range_text(const std::vector<Direction>& directions) {
  double low = 180.0;
  double high = 0.0;
  for (const Direction& direction : directions) {
    const double theta = theta_degrees(direction);
    low = std::min(low, theta);
    high = std::max(high, theta);
  }
  return fmt::format("{} (theta {:.4g} to {:.4g} degrees)", directions.size(), low, high);
}

void add_fields(Report& report, const BtfInfo& info, bool has_mask) {
  const BtfShape& s = info.shape;
  report.add("shape", Cell{fmt::format("V {} x L {} x Y {} x X {} x C {}", s.views, s.lights,
                                       s.height, s.width, s.channels),
                           fmt::format("[{},{},{},{},{}]", s.views, s.lights, s.height, s.width,
                                       s.channels)});
  report.add("dtype", name_of(info.dtype));
  report.add("encoding", name_of(info.encoding));
  report.add("quantity", name_of(info.quantity));
  report.add("layout", name_of(info.layout));
  const auto add_directions = [&report](const char* name, const std::vector<Direction>& list) {
    std::string json = "[";
    for (const Direction& d : list) {
      json +=
          fmt::format("{}[{},{}]", json.size() > 1 ? "," : "", theta_degrees(d), phi_degrees(d));
    }
    report.add(name, Cell{range_text(list), json + "]"});
  };
  add_directions("view_directions", info.view_directions);
  add_directions("light_directions", info.light_directions);
  if (!info.channel_names.empty()) {
    std::string json;
    for (const std::string& name : info.channel_names) json += "," + text_cell(name).json;
    report.add("channel_names", Cell{fmt::format("{}", fmt::join(info.channel_names, ", ")),
                                     "[" + json.substr(1) + "]"});
  }
  report.add("mask", has_mask);
  if (!info.mask_distance.empty()) report.add("mask_distance", true);
  if (!info.source.empty()) report.add("source", info.source);
}

}  // namespace

void add_btf_fields(Report& report, const BtfInfo& info) {
  add_fields(report, info, !info.mask.empty());
}

void add_btf_fields(Report& report, const ModelInfo& info) {
  add_fields(report, info.btf, !info.btf.mask.empty() || info.occlusion);
}

void add_error_fields(Report& report, const ErrorReport& errors) {
  report.add("rmse", errors.rmse);
  report.add("psnr", errors.psnr, "dB");
  report.add("psnr_peak", errors.peak);
  report.add("snr", errors.snr, "dB");
  report.add("relative", errors.relative);
  report.add("max_error", errors.max_error);
  if (errors.ssim) report.add("ssim", *errors.ssim);
  if (errors.log) {
    report.add("log_rmse", errors.log->rmse);
    report.add("log_snr", errors.log->snr, "dB");
    report.add("log_scale", errors.log->scale);
  }
}

void add_weighted_fields(Report& report, const WeightedErrorReport& errors) {
  report.add("rmse", errors.rmse);
  report.add("psnr", errors.psnr, "dB");
  report.add("snr", errors.snr, "dB");
  report.add("relative", errors.relative);
}

}  // namespace weft
