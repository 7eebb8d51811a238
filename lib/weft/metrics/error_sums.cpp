#include "weft/metrics/error_sums.hpp"

#include <fmt/core.h>

#include <cmath>
#include <limits>

namespace weft {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// The larger; NaN if either is, so that a NaN met anywhere stays visible.
double max_or_nan(double a, double b) {
  return std::isnan(a) || a > b ? a : b;
}

std::string json_number(double value) {
  if (std::isnan(value)) return "\"nan\"";
  if (std::isinf(value)) return value > 0 ? "\"inf\"" : "\"-inf\"";
  return fmt::format("{}", value);
}

}  // namespace

void ErrorSums::merge(const ErrorSums& other) {
  count += other.count;
  square_reference += other.square_reference;
  square_difference += other.square_difference;
  max_difference = max_or_nan(max_difference, other.max_difference);
  max_reference = max_or_nan(max_reference, other.max_reference);
}

ErrorReport report(const ErrorSums& sums, double peak) {
  ErrorReport result;
  result.count = sums.count;
  result.peak = peak;
  result.max_error = sums.max_difference;
  if (sums.square_difference == 0) {
    result.psnr = infinity;
    result.snr = infinity;
    return result;
  }
  // sqrt(sum / n) of a nonzero sum: n is at least 1.
  result.rmse = std::sqrt(sums.square_difference / static_cast<double>(sums.count));
  result.psnr = 20 * std::log10(peak / result.rmse);
  if (std::isinf(sums.square_difference)) {
    result.snr = -infinity;
    result.relative = infinity;
  } else if (sums.square_reference == 0) {
    result.snr = std::numeric_limits<double>::quiet_NaN();
    result.relative = infinity;
  } else {
    result.snr = 10 * (std::log10(sums.square_reference) - std::log10(sums.square_difference));
    result.relative = std::sqrt(sums.square_difference) / std::sqrt(sums.square_reference);
  }
  return result;
}

WeightedErrorReport weighted_report(const ErrorSums& sums, double peak) {
  const ErrorReport errors = report(sums, peak);
  return {errors.rmse, errors.psnr, errors.snr, errors.relative};
}

std::string to_json(const ErrorReport& report) {
  const std::string ssim =
      report.ssim ? fmt::format(R"(,"ssim":{})", json_number(*report.ssim)) : std::string();
  const std::string log =
      report.log ? fmt::format(R"(,"log":{{"scale":{},"rmse":{},"snr":{}}})",
                               json_number(report.log->scale), json_number(report.log->rmse),
                               json_number(report.log->snr))
                 : std::string();
  const std::string weighted =
      report.weighted
          ? fmt::format(R"(,"weighted":{{"rmse":{},"psnr":{},"snr":{},"relative":{}}})",
                        json_number(report.weighted->rmse), json_number(report.weighted->psnr),
                        json_number(report.weighted->snr), json_number(report.weighted->relative))
          : std::string();
  return fmt::format(
      R"({{"rmse":{},"psnr":{},"psnr_peak":{},"snr":{},"relative":{},"max_error":{}{}{}{}}})",
      json_number(report.rmse), json_number(report.psnr), json_number(report.peak),
      json_number(report.snr), json_number(report.relative), json_number(report.max_error), ssim,
      log, weighted);
}

}  // namespace weft
