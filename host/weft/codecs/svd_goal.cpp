#include "weft/codecs/svd_goal.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "weft/error.hpp"

namespace weft {

double resolved_error(Arithmetic arithmetic) {
  return arithmetic == Arithmetic::f32 ? 1e-2 : 1e-5;
}

double noise_floor(Arithmetic arithmetic, double squares, const SvdTarget& target) {
  const double unit = arithmetic == Arithmetic::f32 ? 0x1p-24 : 0x1p-53;
  return std::max(4 * unit * std::sqrt(squares), target.noise);
}

double wanted_squares(const SvdTarget& target, double squares) {
  double wanted = std::numeric_limits<double>::infinity();
  if (target.tolerance > 0) {
    wanted = target.tolerance * target.tolerance * (squares + target.constant_squares);
  }
  if (target.energy > 0) wanted = std::min(wanted, (1 - target.energy) * squares);
  return wanted;
}

std::size_t smallest_rank(std::span<const double> values, double rest, double wanted) {
  if (rest > wanted) return values.size() + 1;
  std::size_t k = values.size();
  while (k > 0 && rest + values[k - 1] * values[k - 1] <= wanted) {
    --k;
    rest += values[k] * values[k];
  }
  return k;
}

void fail_unmet(const SvdTarget& target, double squares, double residual_squares, std::size_t rank,
                std::string_view why) {
  residual_squares = std::max(residual_squares, 0.0);
  std::string goal;
  if (target.tolerance > 0) {
    goal = fmt::format("--tolerance {:g}: {:.3g} was reached", target.tolerance,
                       std::sqrt(residual_squares / (squares + target.constant_squares)));
  }
  if (target.energy > 0) {
    goal += fmt::format("{}--energy {}: {} was reached", goal.empty() ? "" : ", ", target.energy,
                        1 - residual_squares / squares);
  }
  fail(ErrorKind::unmet_goal, "{} with {} components, {}", goal, rank, why);
}

std::string memory_binds(std::size_t k, double needed, std::size_t memory) {
  constexpr double gibibyte = 0x1p30;
  needed = std::max(needed, static_cast<double>(k + 1));
  return fmt::format(
      "the most that --memory allows: {:.0f} or more are needed, with about {:.2g}GiB", needed,
      static_cast<double>(memory) / gibibyte * needed / static_cast<double>(k));
}

}  // namespace weft
