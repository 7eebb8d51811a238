// What a compression is asked to reach: `--target KIND=VALUE`.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "weft/btf/btf.hpp"
#include "weft/metrics/error_sums.hpp"

namespace weft {

enum class GoalKind { none, psnr, rmse, snr, relative, max, ssim, ratio, size };

struct Goal {
  GoalKind kind = GoalKind::none;
  double value = 0;       // as asked; bytes for a size
  std::size_t bytes = 0;  // most bytes of the file, of a ratio or size
  std::string text;       // as it was given: "psnr=38"

  explicit operator bool() const { return kind != GoalKind::none; }
  bool by_size() const { return kind == GoalKind::ratio || kind == GoalKind::size; }
  // Of a model with these errors, the weighted ones of a weighted fit; of goals by errors only.
  double reached(const ErrorReport& errors) const;
  bool met(const ErrorReport& errors) const;
  // The relative error that is asked for, of data with so large a root mean square and peak; 0
  // where a goal does not say it: of max and ssim.
  double relative(double root_mean_square, double peak) const;
  // The factor by which a model's |T - T'| is to change to meet the goal: exact for goals that are
  // one another's, a guess for max and ssim.
  double missing_factor(const ErrorReport& errors) const;
};

inline constexpr std::string_view goal_help =
    "Goal that is met by measured errors, or by the file's size, from which ranks or lengths of "
    "lists are chosen: psnr=DB, snr=DB, rmse=E, rel=E, max=E, ssim=S, ratio=R or size=BYTES (as "
    "4MiB); ranks that are given are the most";

// Throws input errors that name the option and the value: an unknown kind, what is no number or out
// of its kind's range, a size without bytes.
Goal parse_goal(std::string_view text, const BtfInfo& source);

}  // namespace weft
