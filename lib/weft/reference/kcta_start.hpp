// Where clustered tensor approximation begins, and what it does with clusters that lose all their
// slices (Tsai & Shih 2012, sections 5.1 and 5.3). Points and slices are few: all of it is exact
// and serial, the same for the device and the reference.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "weft/btf/mode_groups.hpp"

namespace weft {

//   directions  clusters of the slices' parameters: directions on the hemisphere, or places
//   slices      k-means of the slices themselves, in their leading subspace
//   random      slices dealt out in a random order
enum class KctaStart { directions, slices, random };

std::string_view name_of(KctaStart start);

// Points in a space of so many dimensions, row-major.
struct SlicePoints {
  std::size_t dimension = 0;
  std::vector<double> values;

  std::size_t size() const { return dimension == 0 ? 0 : values.size() / dimension; }
};

// The parameters of a group's indices: unit vectors of directions, places of texels in [0, 1].
// Indices that differ by channel alone have the same.
SlicePoints slice_parameters(const BtfInfo& info, const ModeGroups& groups, std::size_t group);

// The slices in their leading subspace, from the Gram matrix [n][n] of their values.
SlicePoints leading_subspace(std::size_t n, std::span<const double> gram, std::size_t dimension);

// The cluster of each point, `count` of them, none empty, at most as many as there are points: from
// the point next to the middle, always the farthest one (directions) or by cluster_seeds
// (slices), and Lloyd's iterations from there. Ties go to the lowest index.
std::vector<std::uint32_t> cluster_points(const SlicePoints& points, std::size_t count);
std::vector<std::uint32_t> cluster_points(const SlicePoints& points, std::size_t count,
                                          std::uint64_t seed);

// Slices dealt out in a random order.
std::vector<std::uint32_t> deal_slices(std::size_t slices, std::size_t count, std::uint64_t seed);

// A slice that went from one cluster to another.
struct SliceMove {
  std::size_t slice;
  std::uint32_t from;
  std::uint32_t to;
};

// Gives every cluster without slices the worse half of the cluster with the largest sum of errors,
// in turn. members: clusters of each slice, [slices][K], which becomes the new one; errors: of each
// slice. There are at least as many slices as clusters.
std::vector<SliceMove> fill_empty_clusters(std::size_t clusters, std::size_t mixtures,
                                           std::span<std::uint32_t> members,
                                           std::span<const double> errors);

// The lists [cluster] of slices, ascending.
std::vector<std::vector<std::size_t>> slices_of_clusters(std::size_t clusters, std::size_t mixtures,
                                                         std::span<const std::uint32_t> members);

}  // namespace weft
