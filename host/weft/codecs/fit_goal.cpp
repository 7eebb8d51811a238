#include "weft/codecs/fit_goal.hpp"

#include <charconv>
#include <cmath>

#include "weft/error.hpp"
#include "weft/size_text.hpp"

namespace weft {
namespace {

double number(std::string_view text, std::string_view whole) {
  double value = 0;
  const auto [stop, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (status != std::errc() || stop != text.data() + text.size() || !std::isfinite(value)) {
    fail_input("--target {}: '{}' is not a number", whole, text);
  }
  return value;
}

}  // namespace

FitGoal fit_goal(const Parameters& parameters, const BtfInfo& source) {
  FitGoal goal;
  const auto given = parameters.find("target");
  if (given == parameters.end() || given->second.empty()) return goal;
  goal.text = given->second;
  const std::string_view text = goal.text;
  const std::size_t equals = text.find('=');
  const std::string_view kind = text.substr(0, equals);
  const std::string_view value =
      equals == std::string_view::npos ? std::string_view() : text.substr(equals + 1);
  if (kind == "rel") {
    goal.kind = FitGoal::Kind::relative;
    goal.relative = number(value, text);
    if (goal.relative <= 0 || goal.relative >= 1) {
      fail_input("--target {}: a relative error between 0 and 1 is needed", text);
    }
  } else if (kind == "size") {
    goal.kind = FitGoal::Kind::size;
    goal.bytes = parse_size(value, "--target size");
  } else if (kind == "ratio") {
    const double ratio = number(value, text);
    if (ratio < 1) fail_input("--target {}: a ratio of at least 1 is needed", text);
    goal.kind = FitGoal::Kind::size;
    goal.bytes = static_cast<std::size_t>(static_cast<double>(source.bytes()) / ratio);
  } else {
    fail_input("--target {}: rel=EPS, size=BYTES or ratio=R is needed", text);
  }
  return goal;
}

}  // namespace weft
