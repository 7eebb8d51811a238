#include "weft/codecs/tucker_plan.hpp"

#include <algorithm>

#include "weft/codecs/held_tensor.hpp"
#include "weft/codecs/long_modes.hpp"
#include "weft/codecs/scattered_rows.hpp"
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

namespace {

MemoryPlan working_plan(Device& device, TileSource& source, const TuckerOptions& options,
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
  plan.add("tile", streaming + 3 * tile +
                       ScatteredRows::bytes(source.info().shape.values(), tile / sizeof(float)));
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
  return plan;
}

// Tensors of that size that are held at a time: an iteration makes one from another.
std::size_t held_at_once(const TuckerRequest& request) {
  return request.method == TuckerMethod::hooi ? 2 : 1;
}

std::size_t largest_held(const TuckerRequest& request) {
  double held = held_values(request, first_kind(request));
  if (request.method == TuckerMethod::hooi && cuts_any(request, By::images) &&
      cuts_any(request, By::texels)) {
    held = std::max(held_values(request, By::texels), held_values(request, By::images));
  }
  return static_cast<std::size_t>(held) * sizeof(float);
}

}  // namespace

FloatStore::Place place_of_held(Device& device, TileSource& source, const TuckerOptions& options,
                                const Job& job, std::size_t bytes) {
  std::size_t others = working_plan(device, source, options, job).total();
  for (const MemoryItem& item : job.held) others += item.bytes;
  const std::size_t held = held_at_once(options.request) * bytes;
  return others + held <= job.memory ? FloatStore::Place::memory : FloatStore::Place::file;
}

MemoryPlan plan_tucker(Device& device, TileSource& source, const TuckerOptions& options,
                       const Job& job) {
  const TuckerRequest& request = options.request;
  MemoryPlan plan = working_plan(device, source, options, job);
  if (request.has_goal()) return plan;
  const std::size_t held = largest_held(request);
  if (place_of_held(device, source, options, job, held) == FloatStore::Place::memory) {
    plan.add("projected tensor", held_at_once(request) * held);
  }
  return plan;
}

}  // namespace weft
