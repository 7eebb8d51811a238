// From a goal to the list lengths k1, k2 and the rank of `sparse` (Ruiters & Klein 2009,
// section 4.2), for the device's encoder and the reference's alike.
//
// The projection's rank costs no bytes: it is doubled while the projection makes more than half of
// the squared error. One decomposition with long lists foresees the errors of all shorter ones;
// of all pairs k1, k2, those that no other beats in both size and error are tried in the order of
// their sizes. A size takes the last that fits. An error takes the first that meets it, as measured
// of the stored model: the one before was tried too, and misses it.
//
// Where steps of quantisation are searched for besides, the pairs are nested models: sizes do not
// follow from lengths then.
#pragma once

#include <functional>
#include <memory>

#include "weft/btf/btf.hpp"
#include "weft/codecs/fit_goal.hpp"
#include "weft/codecs/nested_models.hpp"
#include "weft/job.hpp"
#include "weft/reference/sparse.hpp"

namespace weft {

// With a goal, the lengths of lists are the most.
struct SparseOptions : SparseRequest {
  // With a goal: most components of the projection, doubled from `rank` on. Less than that: the
  // rank stays.
  std::size_t most_rank = 0;
  Storage storage = Storage::f16;
  FitGoal goal;
};

// The sizes of a fit that follow from the data's.
struct SparseSizes {
  std::size_t texels;
  std::size_t row;          // n = V L C
  std::size_t fibre;        // L C
  std::size_t rank;         // at most
  std::size_t abrdf_atoms;  // no more than signals
  std::size_t light_atoms;

  SparseSizes(const BtfShape& shape, const SparseRequest& request);
};

// The relative error of a model as it is stored.
using MeasureSparse = std::function<double(const SparseModel& model)>;

// The fit that `options` ask for, rounded to its storage. Throws the unmet goal with what was
// reached.
SparseFit fit_sparse(SparseEncoder& encoder, const BtfInfo& source, const SparseOptions& options,
                     const MeasureSparse& measure, Job& job);

// What makes a fit the model that is stored.
using FinishSparse = std::function<std::unique_ptr<Model>(SparseFit fit)>;

// Models of all lengths that no others beat, of one decomposition as the request asks. `source`
// and `job` must outlive them. A model takes another fit, from the decomposition's dictionaries.
std::unique_ptr<NestedModels> nested_sparse(std::unique_ptr<SparseEncoder> encoder,
                                            const BtfInfo& source, const SparseOptions& options,
                                            const NestedRequest& request, FinishSparse finish,
                                            Job& job);

}  // namespace weft
