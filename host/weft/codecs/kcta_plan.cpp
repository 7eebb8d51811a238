#include "weft/codecs/kcta_plan.hpp"

#include <algorithm>

#include "weft/codecs/held_tensor.hpp"
#include "weft/codecs/mix_slices.hpp"
#include "weft/codecs/slice_rows.hpp"
#include "weft/codecs/tucker_plan.hpp"

namespace weft {

TuckerOptions global_bases_kcta(const KctaRequest& request) {
  TuckerOptions options;
  options.request.groups = request.groups;
  options.request.most = request.groups.sizes();
  for (std::size_t n = 0; n < request.groups.count(); ++n) {
    if (request.cuts(n) && request.global_mode[n] != 0) {
      options.request.most[n] = request.ranks[n];
    }
  }
  options.request.storage = Storage::f32;
  return options;
}

std::size_t held_beside_kcta(const KctaRequest& request, const SliceShape& shape) {
  const std::size_t residual = request.mixtures > 1 ? shape.slices() : 0;
  return (request.clusters * shape.ranks[0] + residual) * shape.row() * sizeof(float);
}

MemoryPlan working_plan_kcta(const Device& device, const KctaRequest& request,
                             const SliceShape& shape) {
  MemoryPlan plan;
  const std::size_t rank = shape.ranks[0];
  const std::size_t rows = std::max(shape.slices(), request.clusters * rank);
  plan.add("blocks of slices", row_products_bytes(device, 2 * rows, shape.row()));
  std::size_t longest = 1;
  std::size_t eigen = shape.slices();
  for (std::size_t a = 1; a < shape.sizes.size(); ++a) {
    if (shape.local(a)) longest = std::max(longest, shape.sizes[a]);
  }
  eigen = std::max(eigen, longest);
  plan.add("projected slices",
           3 * rank * shape.row() * sizeof(float) +
               HeldTensor::working_bytes(device, rank * shape.row(), longest, Arithmetic::f32));
  plan.add("slices of a core", shape.slices() * shape.core_row() * sizeof(float));
  plan.add("clusters", 3 * request.clusters * rank * shape.core_row() * sizeof(float));
  const std::size_t products = request.clusters * rank;
  plan.add("small problem",
           (6 * eigen * eigen + products * (2 * products + shape.slices())) * sizeof(double));
  if (request.grid_side > 0) plan.add("grid of views", grid_bytes(request));
  return plan;
}

MemoryPlan plan_kcta(Device& device, TileSource& source, const KctaRequest& request,
                     const Job& job) {
  const TuckerOptions global = global_bases_kcta(request);
  const MemoryPlan streaming = plan_tucker(device, source, global, job);
  const SliceShape shape(request);
  MemoryPlan plan = working_plan_kcta(device, request, shape);
  const std::size_t slices = shape.slices() * shape.row() * sizeof(float);
  std::size_t others = plan.total();
  for (const MemoryItem& item : job.held) others += item.bytes;
  // where they do not fit they are held in files
  if (place_of_held(device, source, global, job, slices) == FloatStore::Place::memory) {
    plan.add("slices", slices);
    others += slices;
  }
  const std::size_t beside = held_beside_kcta(request, shape);
  if (others + beside <= job.memory) plan.add("slices of clusters", beside);
  // the bases of all clusters come first, and give back what they take
  return streaming.total() > plan.total() ? streaming : plan;
}

}  // namespace weft
