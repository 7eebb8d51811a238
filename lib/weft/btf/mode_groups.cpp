#include "weft/btf/mode_groups.hpp"

#include <algorithm>
#include <iterator>

#include "weft/error.hpp"

namespace weft {

bool ModeGroup::has(Mode mode) const {
  return std::find(modes.begin(), modes.end(), mode) != modes.end();
}

ModeGroups::ModeGroups(const BtfShape& shape, std::string_view merge) {
  // which modes go together
  std::array<std::size_t, mode_count> merged{};  // 0: alone
  std::size_t lists = 0;
  for (std::size_t at = 0; at < merge.size();) {
    const std::size_t end = std::min(merge.find(',', at), merge.size());
    const std::string_view list = merge.substr(at, end - at);
    ++lists;
    for (std::size_t i = 0; i < list.size(); ++i) {
      std::size_t& mark = merged[index_of(mode_from_name(list.substr(i, 1), "--merge"))];
      if (mark != 0) fail_input("--merge {}: mode {} is named twice", merge, list[i]);
      mark = lists;
    }
    if (list.size() < 2) fail_input("--merge {}: a group has at least two of v, l, y, x, c", merge);
    if (end + 1 == merge.size()) fail_input("--merge {}: nothing follows the last comma", merge);
    at = end + 1;
  }
  const auto together = [&](Mode a, Mode b) {
    return merged[index_of(a)] != 0 && merged[index_of(a)] == merged[index_of(b)];
  };
  channels_first_ = !together(Mode::column, Mode::channel) && !together(Mode::row, Mode::channel);

  const std::array<Mode, mode_count> order =
      channels_first_ ? std::array{Mode::view, Mode::light, Mode::channel, Mode::row, Mode::column}
                      : std::array{Mode::view, Mode::light, Mode::row, Mode::column, Mode::channel};
  for (std::size_t i = 0; i < mode_count; ++i) {
    if (i > 0 && together(order[i - 1], order[i])) {
      groups_.back().modes.push_back(order[i]);
    } else {
      groups_.push_back({"", {order[i]}, 1});
    }
  }
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    ModeGroup& group = groups_[g];
    for (auto mode = group.modes.rbegin(); mode != group.modes.rend(); ++mode) {
      group_of_[index_of(*mode)] = g;
      strides_[index_of(*mode)] = group.size;
      group.size *= mode_size(shape, *mode);
      group.name.insert(0, name_of(*mode));
    }
    // Everything that was to be merged must have come to stand together, directions without texels.
    for (const Mode mode : all_modes) {
      if (together(group.modes.front(), mode) && !group.has(mode)) {
        fail_input(
            "--merge {}: modes {} and {} are no neighbours; with c go l, vl, x or yx, and "
            "directions are not merged with texels",
            merge, name_of(group.modes.front()), name_of(mode));
      }
    }
    if (group.of_directions() && (group.has(Mode::row) || group.has(Mode::column))) {
      fail_input("--merge {}: directions are not merged with texels", merge);
    }
  }
}

std::vector<std::size_t> ModeGroups::sizes() const {
  std::vector<std::size_t> sizes;
  std::transform(groups_.begin(), groups_.end(), std::back_inserter(sizes),
                 [](const ModeGroup& group) { return group.size; });
  return sizes;
}

std::string ModeGroups::merge() const {
  std::string text;
  for (const ModeGroup& group : groups_) {
    if (group.modes.size() > 1) text += (text.empty() ? "" : ",") + group.name;
  }
  return text;
}

std::size_t ModeGroups::find(std::string_view name, std::string_view option) const {
  std::string names;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    if (groups_[g].name == name) return g;
    names += (names.empty() ? "" : ", ") + groups_[g].name;
  }
  fail_input("{}: there is no mode '{}', only {}", option, name, names);
}

}  // namespace weft
