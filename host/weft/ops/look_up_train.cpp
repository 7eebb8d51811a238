#include "weft/ops/look_up_train.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <vector>

#include "weft/ops/launch.hpp"
#include "weft/ops/order_lookups.hpp"

namespace weft::ops {
namespace {

// What a core is on the device: [index][in][out], `out` padded to whole vectors.
struct Layout {
  std::size_t n = 0;      // which core
  bool from_left = true;  // `in` is its left rank
  std::size_t in = 1;
  std::size_t out = 1;

  std::size_t out8() const { return row_vectors(out); }
  std::size_t floats(const TtModel& model) const {
    return row_floats(model.size(n) * in, out, "core of a train");
  }
};

// From the outermost cores inwards: those left of the channels', those right of it, and that one.
std::vector<Layout> layouts(const TtModel& model) {
  const std::size_t channel = model.position(Mode::channel);
  std::vector<Layout> all;
  for (std::size_t n = 0; n < channel; ++n) {
    all.push_back({n, true, model.ranks[n], model.ranks[n + 1]});
  }
  for (std::size_t n = mode_count; n-- > channel + 1;) {
    all.push_back({n, false, model.ranks[n + 1], model.ranks[n]});
  }
  all.push_back({channel, true, model.ranks[channel], model.ranks[channel + 1]});
  return all;
}

std::uint64_t mode_code(Mode mode) {
  return static_cast<std::uint64_t>(mode);  // view 0, light 1, row 2, column 3
}

unsigned group_of(Mode mode) {
  if (mode == Mode::view) return 2;
  return mode == Mode::light ? 4 : 1;
}

constexpr std::size_t step_bytes = mode_count * 4 * sizeof(std::uint64_t);

std::size_t core_bytes(const TtModel& model) {
  std::size_t floats = 0;
  for (const Layout& layout : layouts(model)) floats += layout.floats(model);
  return floats * sizeof(float);
}

}  // namespace

TrainCores::TrainCores(Device& device, const TtModel& model)
    : left_steps_(model.position(Mode::channel)),
      right_steps_(mode_count - 1 - left_steps_),
      left_rank_(model.ranks[left_steps_]),
      right_rank_(model.ranks[left_steps_ + 1]),
      cores_(device, core_bytes(model), "cores of a train"),
      steps_(device, step_bytes, "steps of a train") {
  std::vector<std::uint64_t> steps;
  std::vector<float> cores(cores_.size() / sizeof(float), 0.0f);
  std::size_t offset = 0;
  for (const Layout& layout : layouts(model)) {
    const std::size_t n = layout.n;
    const std::size_t size = model.size(n);
    const std::vector<float>& core = model.cores[n];
    const std::size_t right = model.ranks[n + 1];
    pad_rows(
        size * layout.in, layout.out,
        [&](std::size_t row, std::size_t j) {
          const std::size_t i = row / layout.in;
          const std::size_t in = row % layout.in;
          return layout.from_left ? core[(in * size + i) * right + j]
                                  : core[(j * size + i) * right + in];
        },
        std::span(cores).subspan(offset));
    if (model.order[n] == Mode::channel) {
      channel_core_ = offset;
    } else {
      steps.insert(steps.end(), {mode_code(model.order[n]), layout.in, layout.out8(), offset});
      (layout.from_left ? left_groups_ : right_groups_) |= group_of(model.order[n]);
    }
    longest_ = std::max({longest_, round_up(layout.in, row_lanes), layout.out8() * row_lanes});
    offset += layout.floats(model);
  }
  // Few programs for many ranks.
  longest_ = std::bit_ceil(longest_);
  steps.resize(mode_count * 4, 0);
  device.write(cores_, std::span<const float>(cores));
  device.write(steps_, std::span<const std::uint64_t>(steps));
}

std::size_t TrainCores::bytes(const TtModel& model) {
  return core_bytes(model) + step_bytes;
}

void look_up_train(Device& device, const LookupBatch& batch, const TrainCores& cores) {
  const std::string options =
      fmt::format("{} {} -DLONGEST={}", lookup_options(device, batch.lookup, batch.shape.channels),
                  order_option(batch), cores.longest_);
  const cl_kernel kernel = device.kernel(kernel_sources::look_up_train, options, "look_up_train");
  set_arguments(kernel, ulong(batch.count), ulong(batch.first), ulong(batch.shape.width),
                static_cast<std::uint32_t>(cores.left_steps_),
                static_cast<std::uint32_t>(cores.right_steps_),
                static_cast<std::uint32_t>(cores.left_groups_),
                static_cast<std::uint32_t>(cores.right_groups_), ulong(cores.left_rank_),
                ulong(cores.right_rank_), ulong(cores.channel_core_), cores.steps_, cores.cores_,
                order_argument(batch), batch.lookups, batch.out);
  launch_items(device, kernel, ceil_div(batch.count, lookup_block(device)));
}

}  // namespace weft::ops
