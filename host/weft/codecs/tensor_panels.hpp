// An unfolding of a BTF in any groups of modes as a stream of panels, with modes that were already
// projected onto a basis.
//
//   X[(m, b), (m', b')] = scale sum_{j, j'} T[m, j, m', j'] B[j, b] B'[j', b']
//
// Rows and columns each have modes `free` that are as they are (m), and modes `bound` that a basis
// stands for (j): B is [product of their sizes][rank]. Each group is in storage order, v l y x c,
// but for the rows' `cut` mode, which comes first: the stream is made of slabs of it.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "weft/btf/modes.hpp"
#include "weft/btf/tile.hpp"
#include "weft/codecs/panel_stream.hpp"
#include "weft/job.hpp"

namespace weft {

struct ModeSide {
  std::vector<Mode> free;
  std::vector<Mode> bound;
  std::vector<float> basis;  // row-major [sizes of bound][rank]; empty where there are none
  std::size_t rank = 1;

  std::size_t free_size(const BtfShape& shape) const;
  std::size_t bound_size(const BtfShape& shape) const;
  // Rows or columns of the unfolding.
  std::size_t size(const BtfShape& shape) const { return free_size(shape) * rank; }
};

// Puts a group of modes in storage order.
void sort_modes(std::vector<Mode>& modes);

// The mode of `rows.free` that slabs are of, and how many of its indices each has: of the shape
// alone.
struct SlabShape {
  Mode cut = Mode::view;
  std::size_t count = 1;
};
SlabShape slab_shape(const BtfShape& shape, const ModeSide& rows);

// The rows' free modes in the order in which they come, the cut mode first.
std::vector<Mode> row_modes(const BtfShape& shape, const ModeSide& rows);

// `scale` is a power of two. Source and job must outlive the stream.
std::unique_ptr<PanelStream> tensor_panels(Device& device, TileSource& source, ModeSide rows,
                                           ModeSide columns, float scale, const Job& job);

// Bytes that such a stream holds in a pass.
std::size_t tensor_panels_bytes(const Device& device, const BtfInfo& info, const ModeSide& rows,
                                const ModeSide& columns);

}  // namespace weft
