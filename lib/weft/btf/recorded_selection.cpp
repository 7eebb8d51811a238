#include "weft/btf/recorded_selection.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

#include "weft/btf/mip.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

using List = std::optional<std::vector<std::size_t>>;

// The numbers of `count` held entries.
std::vector<std::size_t> numbers_of(const List& recorded, std::size_t count, std::size_t whole,
                                    std::string_view name, std::string_view where) {
  if (!recorded) {
    std::vector<std::size_t> all(count);
    std::iota(all.begin(), all.end(), std::size_t{0});
    return all;
  }
  if (recorded->size() != count) {
    fail_input("{}: {} {} for {}", where, recorded->size(), name, count);
  }
  std::vector<std::size_t> sorted = *recorded;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
    fail_input("{}: {} are repeated", where, name);
  }
  if (whole != 0 && sorted.back() >= whole) {
    fail_input("{}: {} of {} {}", where, sorted.back(), whole, name);
  }
  return *recorded;
}

bool within(const Region& part, std::size_t height, std::size_t width) {
  return part.width > 0 && part.height > 0 && part.x < width && part.y < height &&
         part.width <= width - part.x && part.height <= height - part.y;
}

Region held_region(const BtfShape& shape, const RecordedSelection& recorded,
                   std::string_view where) {
  constexpr std::size_t largest = std::numeric_limits<std::size_t>::max();
  const std::size_t level = recorded.level;
  if (level >= 48) fail_input("{}: level {}", where, level);
  Region region;
  if (recorded.region) {
    region = *recorded.region;
  } else if (recorded.of) {
    region = {0, 0, recorded.of->width, recorded.of->height};
  } else {
    if (std::max(shape.width, shape.height) > largest >> level) {
      fail_input("{}: level {}", where, level);
    }
    region = {0, 0, shape.width << level, shape.height << level};
  }
  const bool fits = recorded.of ? within(region, recorded.of->height, recorded.of->width)
                                : within(region, largest, largest);
  if (!fits || mip_side(region.height, level) != shape.height ||
      mip_side(region.width, level) != shape.width) {
    fail_input("{}: region {},{},{}x{} at level {} for {} x {} texels", where, region.x, region.y,
               region.width, region.height, level, shape.width, shape.height);
  }
  return region;
}

// The numbers of a part of what is held.
List composed_list(const std::vector<std::size_t>& held, const List& recorded, const List& part) {
  if (!part) return recorded;
  std::vector<std::size_t> numbers;
  numbers.reserve(part->size());
  for (const std::size_t index : *part) numbers.push_back(held[index]);
  return numbers;
}

}  // namespace

HeldPart held_part(const BtfInfo& info, const RecordedSelection& recorded, std::string_view where) {
  const BtfShape& shape = info.shape;
  HeldPart held;
  held.whole = recorded.selects_all() ? shape : recorded.of;
  const BtfShape whole = held.whole.value_or(BtfShape{});
  const auto same_where_all = [&](const List& list, std::size_t count, std::size_t of,
                                  std::string_view name) {
    if (!list && of != 0 && of != count) fail_input("{}: {} of {} {}", where, count, of, name);
  };
  same_where_all(recorded.views, shape.views, whole.views, "views");
  same_where_all(recorded.lights, shape.lights, whole.lights, "lights");
  same_where_all(recorded.channels, shape.channels, whole.channels, "channels");
  held.views = numbers_of(recorded.views, shape.views, whole.views, "views", where);
  held.lights = numbers_of(recorded.lights, shape.lights, whole.lights, "lights", where);
  held.channels = numbers_of(recorded.channels, shape.channels, whole.channels, "channels", where);
  held.region = held_region(shape, recorded, where);
  held.level = recorded.level;
  return held;
}

RecordedSelection composed(const BtfInfo& info, const RecordedSelection& recorded,
                           const Selection& part, std::string_view where) {
  const HeldPart held = held_part(info, recorded, where);
  RecordedSelection result;
  result.of = held.whole;
  result.views = composed_list(held.views, recorded.views, part.views);
  result.lights = composed_list(held.lights, recorded.lights, part.lights);
  result.channels = composed_list(held.channels, recorded.channels, part.channels);
  result.region = recorded.region;
  if (part.region) {
    // texels of the level, the last of which may average less than 2^level of the BTF's
    const auto stretch = [&](std::size_t first, std::size_t count, std::size_t size) {
      return std::min(count << held.level, size - (first << held.level));
    };
    result.region = Region{held.region.x + (part.region->x << held.level),
                           held.region.y + (part.region->y << held.level),
                           stretch(part.region->x, part.region->width, held.region.width),
                           stretch(part.region->y, part.region->height, held.region.height)};
  }
  result.level = recorded.level + part.level;
  return result;
}

}  // namespace weft
