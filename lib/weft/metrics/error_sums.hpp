// Errors of a reconstruction T' against T, pooled over all values, from sums that can be merged.
//
//   RMSE = sqrt(sum (T - T')^2 / n)          PSNR = 20 log10(peak / RMSE)
//   SNR  = 10 log10(sum T^2 / sum (T - T')^2)   relative error = |T - T'|_F / |T|_F
//
// Values of 8-bit data are scaled to [0, 1] first.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "weft/metrics/log_errors.hpp"

namespace weft {

struct ErrorSums {
  std::size_t count = 0;         // n
  double square_reference = 0;   // sum T^2
  double square_difference = 0;  // sum (T - T')^2
  double max_difference = 0;     // max |T - T'|
  double max_reference = 0;      // max |T|

  void merge(const ErrorSums& other);
};

// The same figures of sums with weights w, RMSE = sqrt(sum w (T - T')^2 / sum w).
struct WeightedErrorReport {
  double rmse = 0;
  double psnr = 0;
  double snr = 0;
  double relative = 0;
};

struct ErrorReport {
  std::size_t count = 0;
  double rmse = 0;
  double peak = 1;  // the peak that psnr refers to
  double psnr = 0;  // dB; infinite for an exact reconstruction
  double snr = 0;   // dB; infinite for an exact reconstruction, nan where T is all zero and T' not
  double relative = 0;  // 0 for an exact reconstruction, infinite where T is all zero and T' not
  double max_error = 0;
  std::optional<double> ssim;  // weft/metrics/ssim.hpp, mean over images; where it was asked for
  std::optional<LogErrorReport> log;            // where it was asked for, or a logarithm was fitted
  std::optional<WeightedErrorReport> weighted;  // where a model was fitted with weights
};

// `peak`: 1 for 8-bit data; the data's largest magnitude for float data (1 where that is zero)
// unless given. Where `square_difference` overflowed or vanished the figures say so by inf or 0.
ErrorReport report(const ErrorSums& sums, double peak);
// The same of sums with weights, whose count is the sum of these.
WeightedErrorReport weighted_report(const ErrorSums& sums, double peak);

// A JSON object {"rmse":...,"psnr":...,"psnr_peak":...,"snr":...,"relative":...,"max_error":...};
// with "ssim" where there is one, "log":{"scale":...,"rmse":...,"snr":...} and
// "weighted":{"rmse":...,"psnr":...,"snr":...,"relative":...}; infinities are written as the
// strings "inf" and "-inf", nan as "nan".
std::string to_json(const ErrorReport& report);

}  // namespace weft
