// The texel side of local subspaces, on the host: per cluster an orthonormal basis of the columns
// that its texels' coefficients form.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace weft {

// U [P][k] from coefficients [P][k]: within the texels of each cluster its columns are orthonormal,
// sum to zero and span those of the coefficients less their means. Where these are fewer than the
// cluster's texels allow (one less than it has), random ones fill up: what they find is for the
// next products to say. Columns that a cluster has no room for are zero.
std::vector<float> texel_basis(std::span<const std::uint32_t> labels, std::size_t clusters,
                               std::size_t k, std::span<const float> coefficients,
                               std::uint64_t seed);

// Gives every empty cluster the half of the texels of the worst cluster (that of the largest summed
// error) that it reconstructs worst, while there is error to be shared. Returns how many were
// given any.
std::size_t fill_empty_clusters(std::span<std::uint32_t> labels, std::size_t clusters,
                                std::span<const float> errors);

}  // namespace weft
