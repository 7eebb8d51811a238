// Errors of a reconstruction T' against T on a logarithmic scale, for data of high dynamic range,
// of which the plain errors see the highlights alone. With l(x) = sgn(x) ln(1 + |x| / s),
//
//   log RMSE = sqrt(sum (l(T) - l(T'))^2 / n)
//   log SNR  = 10 log10(sum l(T)^2 / sum (l(T) - l(T'))^2)
//
// pooled over all values. Where values are far above s, the log RMSE is that of their relative
// errors; far below, it is the RMSE in units of s.
#pragma once

#include <cstddef>

namespace weft {

struct LogErrorSums {
  std::size_t count = 0;         // n
  double square_reference = 0;   // sum l(T)^2
  double square_difference = 0;  // sum (l(T) - l(T'))^2

  void merge(const LogErrorSums& other);
};

struct LogErrorReport {
  double scale = 1;  // s
  double rmse = 0;
  double snr = 0;  // dB; infinite for an exact reconstruction, nan where T is all zero and T' not
};

LogErrorReport report(const LogErrorSums& sums, double scale);

// Log errors, where they are asked for besides the plain ones.
struct LogErrorRequest {
  double scale = 1;   // s
  LogErrorSums sums;  // the answer
};

}  // namespace weft
