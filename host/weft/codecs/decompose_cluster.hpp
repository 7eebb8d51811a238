// The update of one cluster of clustered tensor approximation (Tsai & Shih 2012, section 4.3): the
// N-mode SVD of its slices by alternating least squares, on a device.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/codecs/held_tensor.hpp"
#include "weft/codecs/slice_rows.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/reference/kcta.hpp"

namespace weft {

// How slices lie: sizes and ranks of the modes, the clustered one first, after the global bases.
struct SliceShape {
  std::vector<std::size_t> groups;  // which group each mode is
  std::vector<std::size_t> sizes;
  std::vector<std::size_t> ranks;

  explicit SliceShape(const KctaRequest& request);
  std::size_t slices() const { return sizes[0]; }
  std::size_t row() const;
  std::size_t core_row() const;
  // Modes behind the first with a basis for each cluster.
  bool local(std::size_t axis) const { return ranks[axis] < sizes[axis]; }
  bool any_local() const;
};

// A cluster: its core [R_m][R_n ...] and the bases of the modes behind the first, or none.
struct ClusterBases {
  std::vector<float> Z;
  std::vector<std::vector<float>> U;  // of mode a at a
};

class ClusterDecomposition {
 public:
  // What it does is added to the stage of that name.
  ClusterDecomposition(Device& device, const SliceShape& shape, const char* stage, Job& job)
      : device_(device), shape_(shape), stage_(stage), job_(job) {}

  // From slices alone, or from a mixing matrix with orthonormal columns, [slices][R], and the bases
  // that the cluster has; R is R_m, or the slices if they are fewer. The cluster gets new bases and
  // a core; returns its mixing matrix for these slices.
  std::vector<float> begin(ClusterBases& cluster, const RowList& slices);
  std::vector<float> refine(ClusterBases& cluster, const RowList& slices, std::vector<float> U_m);

 private:
  HeldTensor onto_rows(const RowList& slices, const std::vector<float>& U_m);
  HeldTensor projected(const HeldTensor& T, std::size_t axis, const std::vector<float>& U);
  std::vector<float> leading_basis(const HeldTensor& T, std::size_t axis);
  std::vector<float> sweep(ClusterBases& cluster, const RowList& slices,
                           const std::vector<float>& U_m);
  std::vector<float> decompose_slices(ClusterBases& cluster, const RowList& slices,
                                      std::size_t rank);
  Stage& stage() { return job_.stage(stage_); }

  Device& device_;
  const SliceShape& shape_;
  const char* stage_;
  Job& job_;
  std::vector<float> projected_;  // slices, onto the bases of the other modes
};

}  // namespace weft
