#include "weft/codecs/tucker_plan.hpp"

#include <algorithm>

#include "weft/codecs/held_tensor.hpp"
#include "weft/codecs/long_modes.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

using By = TensorTiles::By;

// What is held after the modes of one kind are projected, if the others are as long as they are.
double held_values(const TuckerRequest& request, By kind) {
  double values = 1;
  for (std::size_t n = 0; n < request.groups.count(); ++n) {
    const ModeGroup& group = request.groups.groups()[n];
    values *= static_cast<double>(kind_of(group) == kind ? request.most[n] : group.size);
  }
  return values;
}

bool cuts_any(const TuckerRequest& request, By kind) {
  for (std::size_t n = 0; n < request.groups.count(); ++n) {
    if (kind_of(request.groups.groups()[n]) == kind && request.cuts(n)) return true;
  }
  return false;
}

std::size_t longest_cut(const TuckerRequest& request) {
  std::size_t longest = 1;
  for (std::size_t n = 0; n < request.groups.count(); ++n) {
    if (request.cuts(n)) longest = std::max(longest, request.groups.groups()[n].size);
  }
  return longest;
}

}  // namespace

By kind_of(const ModeGroup& group) {
  return group.of_directions() ? By::texels : By::images;
}

By first_kind(const TuckerRequest& request) {
  if (!cuts_any(request, By::texels)) return By::images;
  if (!cuts_any(request, By::images) || request.has_goal()) return By::texels;
  return held_values(request, By::texels) <= held_values(request, By::images) ? By::texels
                                                                              : By::images;
}

MemoryPlan plan_tucker(Device& device, TileSource& source, const TuckerOptions& options,
                       const Job& job) {
  const TuckerRequest& request = options.request;
  MemoryPlan plan;
  std::size_t streaming = 0;
  std::size_t tile = 0;
  for (const By kind : {By::texels, By::images}) {
    const TensorTiles tiles(device, source, request.groups, kind, 1.0f, job);
    streaming = std::max(streaming, tiles.bytes());
    tile = std::max(tile, tiles.largest_values() * sizeof(float));
  }
  plan.add("tile", streaming + 3 * tile);
  plan.add("products", HeldTensor::working_bytes(device, source.info().shape.values(),
                                                 longest_cut(request), options.gram));
  for (std::size_t n = 0; n < request.groups.count(); ++n) {
    if (!request.cuts(n)) continue;
    const std::size_t size = request.groups.groups()[n].size;
    if (size > longest_gram_mode) {
      plan.add("vectors of a long mode",
               long_mode_bytes(device, source, request.groups, n, request.most[n]));
    } else {
      plan.add("small problem", 6 * size * size * sizeof(double));
    }
  }
  if (!request.has_goal()) {
    const double held = held_values(request, first_kind(request)) * sizeof(float);
    plan.add("projected tensor", static_cast<std::size_t>(held));
    if (request.method == TuckerMethod::hooi) {
      const double other = std::max(held_values(request, By::texels),
                                    cuts_any(request, By::images) && cuts_any(request, By::texels)
                                        ? held_values(request, By::images)
                                        : 0.0);
      plan.add("projected tensors of an iteration",
               static_cast<std::size_t>(other) * 2 * sizeof(float));
    }
    plan.add("model", product(request.most) * sizeof(float));
  }
  return plan;
}

}  // namespace weft
