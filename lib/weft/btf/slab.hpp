// Slabs of a source, a range of one mode's indices and all of the others', with their modes in any
// order: what is needed where a job takes a BTF apart along other modes than images.
#pragma once

#include <cstddef>
#include <span>

#include "weft/btf/modes.hpp"
#include "weft/btf/tile.hpp"

namespace weft {

// Indices [first, first + count) of `mode`.
struct Slab {
  Mode mode = Mode::view;
  std::size_t first = 0;
  std::size_t count = 0;
};

// Copies a slab to `out` as a row-major tensor of the modes in `order`, in the source's dtype, and
// releases the images that it reads. Of mapped images only what is wanted is touched; others are
// read whole, one at a time.
void read_slab(TileSource& source, const Slab& slab, const ModeOrder& order,
               std::span<std::byte> out);

}  // namespace weft
