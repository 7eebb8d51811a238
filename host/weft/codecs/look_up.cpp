#include "weft/codecs/look_up.hpp"

#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "weft/error.hpp"

namespace weft {
namespace {

// The records in the order of their first image, and within it of their first texel.
std::vector<std::size_t> image_order(const LookupShape& lookup, const BtfShape& shape,
                                     std::span<const std::uint32_t> lookups) {
  std::vector<std::size_t> order(lookups.size() / lookup.words());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto key = [&](std::size_t i) {
    const Lookup taps(lookup, lookups.subspan(i * lookup.words(), lookup.words()));
    return std::pair(taps.views[0] * shape.lights + taps.lights[0], taps.texels[0]);
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t i, std::size_t j) { return key(i) < key(j); });
  return order;
}

}  // namespace

void look_up(Device& device, DeviceSampler& sampler, const BtfShape& shape,
             const LookupShape& lookup, std::span<const std::uint32_t> lookups, LookupOrder order,
             std::span<float> out, Job& job) {
  validate_lookups(lookup, shape, lookups);
  const std::size_t words = lookup.words(), channels = shape.channels;
  const std::size_t count = lookups.size() / words;
  if (out.size() != count * channels) {
    fail_input("{} look-ups of {} channels give no {} values", count, channels, out.size());
  }
  if (count == 0) return;
  const bool sorts = order == LookupOrder::by_image;
  const std::size_t on_device = words * sizeof(std::uint32_t) + channels * sizeof(float);
  const std::size_t each = sorts ? 2 * on_device : on_device;
  MemoryPlan plan;
  if (sorts) plan.add("order of the look-ups", 2 * count * sizeof(std::size_t));
  const std::size_t room = job.memory > plan.total() ? job.memory - plan.total() : 0;
  const std::size_t allocated =
      device.limits().largest_allocation / (words * sizeof(std::uint32_t));
  const std::size_t batch = std::clamp<std::size_t>(room / 2 / each, 1, std::min(count, allocated));
  plan.add("look-ups in hand", batch * each);
  job.plan(plan);

  const std::vector<std::size_t> places =
      sorts ? image_order(lookup, shape, lookups) : std::vector<std::size_t>{};
  Buffer records(device, batch * words * sizeof(std::uint32_t), "look-ups");
  Buffer values(device, batch * channels * sizeof(float), "values looked up");
  std::vector<std::uint32_t> sorted;
  std::vector<float> found;
  for (std::size_t first = 0; first < count; first += batch) {
    check_interrupt();
    const std::size_t n = std::min(batch, count - first);
    const StageTimer timer(job, "look-ups", static_cast<double>(n) * sampler.lookup_flops(lookup));
    if (!sorts) {
      device.write(records, lookups.subspan(first * words, n * words));
      sampler.look_up(lookup, n, records, values);
      device.read(values, out.subspan(first * channels, n * channels));
    } else {
      sorted.clear();
      for (std::size_t i = first; i < first + n; ++i) {
        const auto record = lookups.subspan(places[i] * words, words);
        sorted.insert(sorted.end(), record.begin(), record.end());
      }
      device.write(records, std::span<const std::uint32_t>(sorted));
      sampler.look_up(lookup, n, records, values);
      found.resize(n * channels);
      device.read(values, std::span<float>(found));
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t c = 0; c < channels; ++c) {
          out[places[first + i] * channels + c] = found[i * channels + c];
        }
      }
    }
    job.advance("look up", first + n, count);
  }
}

}  // namespace weft
