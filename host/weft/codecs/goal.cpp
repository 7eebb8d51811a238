#include "weft/codecs/goal.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <limits>

#include "weft/error.hpp"
#include "weft/size_text.hpp"

namespace weft {
namespace {

struct KindRow {
  std::string_view name;
  GoalKind kind;
  double above;  // values are in (above, below)
  double below;
};

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr std::array<KindRow, 8> kinds{{{"psnr", GoalKind::psnr, 0, infinity},
                                        {"rmse", GoalKind::rmse, 0, infinity},
                                        {"snr", GoalKind::snr, 0, infinity},
                                        {"rel", GoalKind::relative, 0, 1},
                                        {"max", GoalKind::max, 0, infinity},
                                        {"ssim", GoalKind::ssim, 0, 1},
                                        {"ratio", GoalKind::ratio, 0, infinity},
                                        {"size", GoalKind::size, 0, infinity}}};

double number(std::string_view text, std::string_view whole) {
  double value = 0;
  const auto [stop, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (status != std::errc() || stop != text.data() + text.size() || !std::isfinite(value)) {
    fail_input("--target {}: '{}' is not a number", whole, text);
  }
  return value;
}

double from_decibels(double decibels) {
  return std::pow(10.0, -decibels / 20);
}

}  // namespace

Goal parse_goal(std::string_view text, const BtfInfo& source) {
  const std::size_t equals = text.find('=');
  const std::string_view name = text.substr(0, equals);
  const std::string_view value =
      equals == std::string_view::npos ? std::string_view() : text.substr(equals + 1);
  const KindRow* row = nullptr;
  for (const KindRow& known : kinds) {
    if (known.name == name) row = &known;
  }
  if (row == nullptr) {
    fail_input("--target {}: psnr, rmse, snr, rel, max, ssim, ratio or size=VALUE is needed", text);
  }
  Goal goal;
  goal.kind = row->kind;
  goal.text = text;
  if (goal.kind == GoalKind::size) {
    goal.bytes = parse_size(value, "--target size");
    goal.value = static_cast<double>(goal.bytes);
    if (goal.bytes == 0) fail_input("--target {}: no bytes are left", text);
    return goal;
  }
  goal.value = number(value, text);
  if (!(goal.value > row->above && goal.value < row->below)) {
    if (row->below < infinity) {
      fail_input("--target {}: a number between {} and {} is needed", text, row->above, row->below);
    }
    fail_input("--target {}: a number above {} is needed", text, row->above);
  }
  if (goal.kind == GoalKind::ratio) {
    if (goal.value < 1) fail_input("--target {}: a ratio of at least 1 is needed", text);
    goal.bytes = static_cast<std::size_t>(static_cast<double>(source.bytes()) / goal.value);
    if (goal.bytes == 0) fail_input("--target {}: of {} no bytes are left", text, source.bytes());
  }
  return goal;
}

double Goal::reached(const ErrorReport& errors) const {
  const auto& weighted = errors.weighted;
  switch (kind) {
    case GoalKind::psnr:
      return weighted ? weighted->psnr : errors.psnr;
    case GoalKind::rmse:
      return weighted ? weighted->rmse : errors.rmse;
    case GoalKind::snr:
      return weighted ? weighted->snr : errors.snr;
    case GoalKind::relative:
      return weighted ? weighted->relative : errors.relative;
    case GoalKind::max:
      return errors.max_error;
    case GoalKind::ssim:
      return errors.ssim.value_or(std::numeric_limits<double>::quiet_NaN());
    default:
      return std::numeric_limits<double>::quiet_NaN();
  }
}

bool Goal::met(const ErrorReport& errors) const {
  const bool more_is_better =
      kind == GoalKind::psnr || kind == GoalKind::snr || kind == GoalKind::ssim;
  const double found = reached(errors);
  return more_is_better ? found >= value : found <= value;
}

double Goal::relative(double root_mean_square, double peak) const {
  if (root_mean_square == 0) return 1;  // nothing but zeros: whatever model is exact
  switch (kind) {
    case GoalKind::psnr:
      return peak * from_decibels(value) / root_mean_square;
    case GoalKind::rmse:
      return value / root_mean_square;
    case GoalKind::snr:
      return from_decibels(value);
    case GoalKind::relative:
      return value;
    default:
      return 0;
  }
}

double Goal::missing_factor(const ErrorReport& errors) const {
  const double found = reached(errors);
  switch (kind) {
    case GoalKind::psnr:
    case GoalKind::snr:
      return from_decibels(value - found);
    case GoalKind::ssim:
      // what is missing of 1 grows about with the square of the error
      return std::sqrt((1 - value) / (1 - found));
    default:
      return value / found;
  }
}

}  // namespace weft
