// The modes of a BTF tensor merged as a user says: T[v, l, y, x, c] as a tensor of fewer, longer
// modes, with channels inside the texels (`yxc`, TensorTextures) or inside the lights (`lc`, the
// K-CTA paper's N-SVD).
//
// The modes of a group are written together in storage order, and its index counts them with the
// last one fastest. Groups are held in the order v, l, y, x, c or, where channels stand alone or
// with directions, v, l, c, y, x: so that those which are merged are neighbours, and images of
// texels come last in either.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "weft/btf/modes.hpp"

namespace weft {

struct ModeGroup {
  std::string name;         // "v", "yxc"
  std::vector<Mode> modes;  // in storage order
  std::size_t size = 1;

  bool has(Mode mode) const;
  // Whether it is of directions, and maybe channels; others are of texels and channels.
  bool of_directions() const { return has(Mode::view) || has(Mode::light); }
};

class ModeGroups {
 public:
  ModeGroups() = default;
  // `merge`: groups of two or more modes, "yxc" or "vl,yx"; the others stand alone. Throws an input
  // error that names --merge and the value for what is no group, for modes named twice, and for
  // modes that are no neighbours in either order: directions with texels, v and c without l, y and
  // c without x.
  ModeGroups(const BtfShape& shape, std::string_view merge);

  const std::vector<ModeGroup>& groups() const { return groups_; }
  std::size_t count() const { return groups_.size(); }
  std::vector<std::size_t> sizes() const;
  // Whether the tensor is [V][L][C][Y][X] and not as stored.
  bool channels_first() const { return channels_first_; }
  // "yxc" or "": what makes them again.
  std::string merge() const;
  // The group of that name. Throws an input error that names `option` and lists the names.
  std::size_t find(std::string_view name, std::string_view option) const;

  // The group that a mode is in.
  std::size_t group_of(Mode mode) const { return group_of_[index_of(mode)]; }
  // By how much an index of the mode moves its group's index.
  std::size_t stride(Mode mode) const { return strides_[index_of(mode)]; }

 private:
  std::vector<ModeGroup> groups_;
  bool channels_first_ = true;
  std::array<std::size_t, mode_count> group_of_{};
  std::array<std::size_t, mode_count> strides_{};
};

}  // namespace weft
