#include "weft/btf/selection_text.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <span>
#include <utility>

#include "weft/btf/mip.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

constexpr double slack = 0.01;  // degrees by which a bound reaches further
constexpr double radian = 180.0 / std::numbers::pi;

using Positions = std::vector<std::size_t>;

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

// "a,b,c" at every `mark`, without the blanks round the pieces.
std::vector<std::string_view> split(std::string_view text, std::string_view mark) {
  std::vector<std::string_view> pieces;
  while (true) {
    const std::size_t end = text.find(mark);
    pieces.push_back(trimmed(text.substr(0, end)));
    if (end == std::string_view::npos) return pieces;
    text.remove_prefix(end + mark.size());
  }
}

// A whole number, nothing before or behind it.
template <typename Number>
std::optional<Number> parse_number(std::string_view text) {
  text = trimmed(text);
  Number value{};
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || stop != end || text.empty()) return {};
  return value;
}

std::optional<std::size_t> parse_count(std::string_view text) {
  return parse_number<std::size_t>(text);
}

// What a list chooses from.
struct Choices {
  std::string_view option;
  std::string_view forms;                 // of a term, for messages
  std::span<const std::size_t> numbers;   // of each position
  std::size_t whole = 0;                  // how many the BTF has; 0 where it is not known
  std::string_view holder;                // who holds only some of them
  std::span<const Direction> directions;  // of each position; empty for channels
  std::span<const std::string> names;     // of each position, or empty
};

// ---- conditions on directions

double parse_angle(std::string_view text, std::string_view term, std::string_view option,
                   double least, double most) {
  const std::optional<double> value = parse_number<double>(text);
  if (!value || !(*value >= least && *value <= most)) {
    fail_input("{}: '{}' in '{}' is not an angle from {} to {} degrees", option, text, term, least,
               most);
  }
  return *value;
}

double between_degrees(const Direction& a, const Direction& b) {
  const double x = double{a[1]} * b[2] - double{a[2]} * b[1];
  const double y = double{a[2]} * b[0] - double{a[0]} * b[2];
  const double z = double{a[0]} * b[1] - double{a[1]} * b[0];
  const double dot = double{a[0]} * b[0] + double{a[1]} * b[1] + double{a[2]} * b[2];
  return std::atan2(std::sqrt(x * x + y * y + z * z), dot) * radian;
}

// Bounds "A..B", or "A" for both.
std::pair<std::string_view, std::string_view> bounds(std::string_view text) {
  const std::vector<std::string_view> pieces = split(text, "..");
  if (pieces.size() > 2) return {text, text};  // which is no angle
  return {pieces.front(), pieces.back()};
}

template <typename Predicate>
Positions positions_where(const Choices& choices, Predicate predicate) {
  Positions positions;
  for (std::size_t i = 0; i < choices.directions.size(); ++i) {
    if (predicate(choices.directions[i])) positions.push_back(i);
  }
  return positions;
}

// What follows "theta".
Positions select_theta(std::string_view condition, std::string_view term, const Choices& choices) {
  const auto angle = [&](std::string_view text) {
    return parse_angle(trimmed(text), term, choices.option, 0, 180);
  };
  double low = -1;
  double high = 181;
  if (condition.starts_with("<=")) {
    high = angle(condition.substr(2)) + slack;
  } else if (condition.starts_with(">=")) {
    low = angle(condition.substr(2)) - slack;
  } else if (condition.starts_with("<")) {
    high = angle(condition.substr(1)) - slack;
  } else if (condition.starts_with(">")) {
    low = angle(condition.substr(1)) + slack;
  } else {
    const auto [first, last] = bounds(condition.substr(1));
    low = angle(first) - slack;
    high = angle(last) + slack;
    if (high < low) fail_input("{}: the range '{}' runs backwards", choices.option, term);
  }
  return positions_where(choices, [&](const Direction& direction) {
    const double theta = theta_degrees(direction);
    return theta >= low && theta <= high;
  });
}

// What follows "phi=".
Positions select_phi(std::string_view range, std::string_view term, const Choices& choices) {
  const auto [first, last] = bounds(range);
  const double low = parse_angle(first, term, choices.option, -360, 360);
  const double high = parse_angle(last, term, choices.option, -360, 360);
  const auto turned = [](double angle) {
    const double rest = std::fmod(angle, 360.0);
    return rest < 0 ? rest + 360 : rest;
  };
  const double width = high - low >= 360 ? 360 : turned(high - low);
  return positions_where(choices, [&](const Direction& direction) {
    const double theta = theta_degrees(direction);
    if (theta <= slack) return true;
    // as far on the sphere as the slack is
    const double reach = slack / std::sin(theta / radian);
    const double beyond = turned(phi_degrees(direction) - low);
    return beyond <= width + reach || beyond >= 360 - reach;
  });
}

// What follows "cone=".
Positions select_cone(std::string_view cone, std::string_view term, const Choices& choices) {
  const std::vector<std::string_view> angles = split(cone, "/");
  if (angles.size() != 3) {
    fail_input("{}: '{}' is not a cone=THETA/PHI/HALFANGLE such as cone=30/90/15", choices.option,
               term);
  }
  const Direction axis =
      direction_from_degrees(parse_angle(angles[0], term, choices.option, 0, 180),
                             parse_angle(angles[1], term, choices.option, -360, 360));
  const double half_angle = parse_angle(angles[2], term, choices.option, 0, 180);
  return positions_where(choices, [&](const Direction& direction) {
    return between_degrees(axis, direction) <= half_angle + slack;
  });
}

// The positions that a condition selects; nothing if the term is none.
std::optional<Positions> select_by_condition(std::string_view term, const Choices& choices) {
  if (choices.directions.empty()) return {};
  const std::size_t sign = term.find_first_of("<>=");
  if (sign == std::string_view::npos) return {};
  const std::string_view name = trimmed(term.substr(0, sign));
  const std::string_view condition = term.substr(sign);
  if (name == "theta") return select_theta(condition, term, choices);
  if (condition.front() != '=') return {};
  if (name == "phi") return select_phi(trimmed(condition.substr(1)), term, choices);
  if (name == "cone") return select_cone(trimmed(condition.substr(1)), term, choices);
  return {};
}

// ---- numbers and names

std::size_t position_of(std::size_t number, std::string_view term, const Choices& choices) {
  if (number < choices.numbers.size() && choices.numbers[number] == number) return number;
  const auto found = std::find(choices.numbers.begin(), choices.numbers.end(), number);
  if (found != choices.numbers.end()) {
    return static_cast<std::size_t>(found - choices.numbers.begin());
  }
  if (choices.whole != 0 && number >= choices.whole) {
    fail_input("{}: '{}' is out of range: there are {}, counted from 0", choices.option, term,
               choices.whole);
  }
  fail_input("{}: {} of '{}' is not in {}, which holds {}{}", choices.option, number, term,
             choices.holder, ranges_text(choices.numbers),
             choices.whole != 0 ? fmt::format(" of {}", choices.whole) : "");
}

// "8-11" or "0-80:4", first number to last.
Positions select_range(std::string_view term, std::size_t dash, const Choices& choices) {
  const std::size_t colon = std::min(term.find(':', dash), term.size());
  const std::optional<std::size_t> first = parse_count(term.substr(0, dash));
  const std::optional<std::size_t> last = parse_count(term.substr(dash + 1, colon - dash - 1));
  const std::optional<std::size_t> step =
      colon < term.size() ? parse_count(term.substr(colon + 1)) : 1;
  if (!first || !last || !step) {
    fail_input("{}: '{}' is not {}", choices.option, term, choices.forms);
  }
  if (*step == 0) fail_input("{}: the step of '{}' is 0", choices.option, term);
  if (*last < *first) fail_input("{}: the range '{}' runs backwards", choices.option, term);
  position_of(*last - (*last - *first) % *step, term, choices);  // the last may well be absent
  Positions positions;
  for (std::size_t number = *first; number <= *last; number += *step) {
    positions.push_back(position_of(number, term, choices));
    if (*last - number < *step) break;
  }
  return positions;
}

// Positions of an index, a name or a range.
Positions select_by_number(std::string_view term, const Choices& choices) {
  if (const std::optional<std::size_t> number = parse_count(term)) {
    return {position_of(*number, term, choices)};
  }
  const auto name = std::find(choices.names.begin(), choices.names.end(), term);
  if (name != choices.names.end()) {
    return {static_cast<std::size_t>(name - choices.names.begin())};
  }
  const std::size_t dash = term.find('-');
  if (dash == std::string_view::npos) {
    fail_input("{}: '{}' is not {}", choices.option, term, choices.forms);
  }
  return select_range(term, dash, choices);
}

// ---- lists

Positions parse_list(std::string_view text, const Choices& choices) {
  const std::size_t count = choices.numbers.size();
  Positions result;
  std::vector<bool> chosen(count, false);
  std::vector<bool> numbered(count, false);  // chosen by a number
  for (const std::string_view part : split(text, ",")) {
    // what all terms of the part select, in the order of the first
    std::optional<Positions> selected;
    bool by_number = false;
    for (const std::string_view term : split(part, "&")) {
      std::optional<Positions> found;
      if (term == "all") {
        found.emplace(count);
        std::iota(found->begin(), found->end(), std::size_t{0});
      } else {
        found = select_by_condition(term, choices);
      }
      by_number = !found && !selected && term.size() == part.size();
      if (!found) found = select_by_number(term, choices);
      if (!selected) {
        selected = std::move(found);
        continue;
      }
      std::vector<bool> kept(count, false);
      for (const std::size_t position : *found) kept[position] = true;
      std::erase_if(*selected, [&](std::size_t position) { return !kept[position]; });
    }
    if (selected->empty()) {
      fail_input("{}: '{}' selects none of the {} there are", choices.option, part, count);
    }
    for (const std::size_t position : *selected) {
      if (by_number) {
        if (numbered[position]) {
          fail_input("{}: {} is repeated by '{}'", choices.option, choices.numbers[position], part);
        }
        numbered[position] = true;
      }
      if (!chosen[position]) result.push_back(position);
      chosen[position] = true;
    }
  }
  return result;
}

// Nothing for what is everything, in its order.
std::optional<Positions> list_or_nothing(std::string_view text, const Choices& choices) {
  if (trimmed(text).empty() || trimmed(text) == "all") return {};
  Positions positions = parse_list(text, choices);
  bool everything = positions.size() == choices.numbers.size();
  for (std::size_t i = 0; everything && i < positions.size(); ++i) everything = positions[i] == i;
  if (everything) return {};
  return positions;
}

// ---- texels

struct Extent {
  std::size_t width = 0;
  std::size_t height = 0;
};

std::optional<Extent> parse_extent(std::string_view text) {
  const std::vector<std::string_view> sides = split(text, "x");
  if (sides.size() != 2) return {};
  const std::optional<std::size_t> width = parse_count(sides[0]);
  const std::optional<std::size_t> height = parse_count(sides[1]);
  if (!width || !height) return {};
  return Extent{*width, *height};
}

// The rectangle in the BTF's texels.
Region parse_region(std::string_view text, const HeldPart& held, std::string_view bounds_text) {
  const Region& all = held.region;
  const std::size_t granule = std::size_t{1} << held.level;
  const std::vector<std::string_view> pieces = split(text, ",");
  std::optional<std::size_t> x, y;
  std::optional<Extent> extent;
  if (pieces.size() == 3) {
    x = parse_count(pieces[0]);
    y = parse_count(pieces[1]);
    extent = parse_extent(pieces[2]);
  } else if (constexpr std::string_view centred = "center:"; trimmed(text).starts_with(centred)) {
    extent = parse_extent(trimmed(text).substr(centred.size()));
    const auto first = [granule](std::size_t begin, std::size_t size, std::size_t part) {
      return part < size ? begin + (size - part) / 2 / granule * granule : begin;
    };
    if (extent) {
      x = first(all.x, all.width, extent->width);
      y = first(all.y, all.height, extent->height);
    }
  }
  if (!x || !y || !extent) {
    fail_input(
        "--region: '{}' is not a region X,Y,WIDTHxHEIGHT or center:WIDTHxHEIGHT such as "
        "64,0,128x128 or center:64x64",
        text);
  }
  const Region region{*x, *y, extent->width, extent->height};
  if (region.width == 0 || region.height == 0) {
    fail_input("--region: the region '{}' is empty", text);
  }
  const auto within = [](std::size_t begin, std::size_t size, std::size_t first,
                         std::size_t whole) {
    return begin >= first && begin - first < whole && size <= whole - (begin - first);
  };
  if (!within(region.x, region.width, all.x, all.width) ||
      !within(region.y, region.height, all.y, all.height)) {
    fail_input("--region: '{}' does not lie within {}", text, bounds_text);
  }
  return region;
}

// The rectangle in the texels of the mip level that is held.
Region reduced_region(std::string_view text, const Region& region, const HeldPart& held,
                      std::string_view holder) {
  const std::size_t granule = std::size_t{1} << held.level;
  // the last texel of a level may average less
  const auto whole_texels = [granule](std::size_t begin, std::size_t size, std::size_t whole) {
    return begin % granule == 0 && (size % granule == 0 || begin + size == whole);
  };
  const std::size_t x = region.x - held.region.x;
  const std::size_t y = region.y - held.region.y;
  if (!whole_texels(x, region.width, held.region.width) ||
      !whole_texels(y, region.height, held.region.height)) {
    fail_input("--region: '{}' cuts texels of {}, which are {} x {} of the BTF's from {},{} on",
               text, holder, granule, granule, held.region.x, held.region.y);
  }
  return {x >> held.level, y >> held.level, mip_side(region.width, held.level),
          mip_side(region.height, held.level)};
}

}  // namespace

Selection parse_selection(const SelectionText& text, const BtfInfo& info, const HeldPart& held,
                          std::string_view holder) {
  constexpr std::string_view direction_forms =
      "an index, a range (8-11, 0-80:4), a condition (theta<=60, theta=20..60, phi=30..120, "
      "cone=30/90/15) or all";
  const BtfShape whole = held.whole.value_or(BtfShape{});
  Selection selection;
  selection.views = list_or_nothing(
      text.views,
      {"--views", direction_forms, held.views, whole.views, holder, info.view_directions, {}});
  const bool some_lights = !trimmed(text.lights).empty() && trimmed(text.lights) != "all";
  if (some_lights && info.layout == Layout::paired) {
    fail_input("--lights: '{}': a paired BTF has no lights of its own; select views (pairs)",
               text.lights);
  }
  selection.lights = list_or_nothing(
      text.lights,
      {"--lights", direction_forms, held.lights, whole.lights, holder, info.light_directions, {}});

  std::vector<std::string> names = info.channel_names;
  if (constexpr std::string_view colours = "RGB"; names.empty() && whole.channels == 3) {
    for (const std::size_t channel : held.channels) names.emplace_back(1, colours[channel]);
  }
  selection.channels =
      list_or_nothing(text.channels, {"--channels",
                                      "an index, a range (0-2), a channel's name or all",
                                      held.channels,
                                      whole.channels,
                                      holder,
                                      {},
                                      names});

  BtfShape part = info.shape;
  if (const std::string_view region = trimmed(text.region); !region.empty() && region != "all") {
    std::string bounds_text = fmt::format("{} x {} texels", held.region.width, held.region.height);
    if (held.whole != std::optional(info.shape)) {
      bounds_text = fmt::format("the {},{},{}x{} that {} holds", held.region.x, held.region.y,
                                held.region.width, held.region.height, holder);
    }
    const Region wanted = parse_region(region, held, bounds_text);
    if (wanted != held.region) selection.region = reduced_region(region, wanted, held, holder);
    part.width = mip_side(wanted.width, held.level);
    part.height = mip_side(wanted.height, held.level);
  }
  const std::size_t level = text.level.value_or(held.level);
  if (level < held.level) {
    fail_input("--level {}: {} holds mip level {} and none that is finer", level, holder,
               held.level);
  }
  const std::size_t last = held.level + last_mip_level(part.height, part.width);
  if (level > last) {
    fail_input("--level {}: the last mip level of {} x {} texels is {}", level, part.width,
               part.height, last);
  }
  selection.level = level - held.level;
  return selection;
}

Selection parse_selection(const SelectionText& text, const BtfInfo& info) {
  return parse_selection(text, info, held_part(info, {}, "selection"), "the BTF");
}

}  // namespace weft
