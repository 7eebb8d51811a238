#include "weft/metrics/log_errors.hpp"

#include <cmath>
#include <limits>

namespace weft {

void LogErrorSums::merge(const LogErrorSums& other) {
  count += other.count;
  square_reference += other.square_reference;
  square_difference += other.square_difference;
}

LogErrorReport report(const LogErrorSums& sums, double scale) {
  LogErrorReport result{scale, 0, std::numeric_limits<double>::infinity()};
  if (sums.square_difference == 0) return result;
  result.rmse = std::sqrt(sums.square_difference / static_cast<double>(sums.count));
  result.snr = sums.square_reference == 0
                   ? std::numeric_limits<double>::quiet_NaN()
                   : 10 * std::log10(sums.square_reference / sums.square_difference);
  return result;
}

}  // namespace weft
