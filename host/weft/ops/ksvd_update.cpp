#include "weft/ops/ksvd_update.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <bit>
#include <limits>

#include "weft/error.hpp"
#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

constexpr std::size_t granule_rows = 32;
constexpr std::size_t most_granules = 256;
constexpr std::size_t gpu_lanes = 64;

// The power iteration ends where |E^T E d - rho d| is this part of rho, which is then within its
// square over the gap of the leading eigenvalue, and here at the latest.
constexpr float converged = 0x1p-10f;
constexpr std::size_t most_steps = 64;
constexpr std::size_t steps_at_once = 2;  // before the host looks whether that is so

// Rows that a work-group adds up: a function of their number alone.
std::size_t granule_of(std::size_t count) {
  return std::max(granule_rows, round_up(ceil_div(count, most_granules), granule_rows));
}

std::size_t lanes_on(const Device& device, std::size_t lanes) {
  if (lanes > 0) return lanes;
  return device.limits().is_cpu
             ? 1
             : std::bit_floor(std::min(gpu_lanes, device.limits().max_work_group));
}

cl_kernel update_kernel(Device& device, std::size_t lanes, bool power, const char* name) {
  return device.kernel(
      kernel_sources::ksvd_update,
      fmt::format("{} -DLANES={} -DPOWER={}", vector_option(device), lanes, power ? 1 : 0), name);
}

void launch_groups(Device& device, cl_kernel kernel, std::size_t groups, std::size_t lanes) {
  if (groups == 0) return;
  const std::array<std::size_t, 1> global{groups * lanes};
  const std::array<std::size_t, 1> local{lanes};
  device.launch(kernel, global, local);
}

}  // namespace

AtomUses atom_uses(const CodeShape& shape, std::span<const std::uint32_t> indices,
                   std::span<const float> coefficients) {
  if (shape.signals > 0 && shape.k > std::numeric_limits<std::uint32_t>::max() / shape.signals) {
    fail_input("{} signals of {} atoms each are more than are updated at once", shape.signals,
               shape.k);
  }
  AtomUses uses;
  uses.first.assign(shape.atoms + 1, 0);
  for (std::size_t entry = 0; entry < indices.size(); ++entry) {
    if (coefficients[entry] != 0) ++uses.first[indices[entry] + 1];
  }
  for (std::size_t j = 0; j < shape.atoms; ++j) uses.first[j + 1] += uses.first[j];
  uses.entries.resize(uses.first.back());
  std::vector<std::size_t> next(uses.first.begin(), uses.first.end() - 1);
  for (std::size_t entry = 0; entry < indices.size(); ++entry) {
    if (coefficients[entry] == 0) continue;
    uses.entries[next[indices[entry]]++] = static_cast<std::uint32_t>(entry);
  }
  return uses;
}

void code_residuals(Device& device, const CodeShape& shape, const Buffer& Y, const Buffer& D,
                    DeviceCodes& codes, const DeviceCodes* before, Buffer& R, Buffer& errors,
                    std::size_t lanes) {
  const std::size_t items = lanes_on(device, lanes);
  const cl_kernel kernel = update_kernel(device, items, false, "code_residuals");
  const DeviceCodes& old = before ? *before : codes;
  set_arguments(kernel, ulong(shape.k), ulong(shape.leading), std::uint32_t{before ? 1U : 0U}, Y, D,
                codes.indices, codes.coefficients, codes.counts, old.indices, old.coefficients,
                old.counts, R, errors);
  launch_groups(device, kernel, shape.signals, items);
}

AtomUpdate::AtomUpdate(Device& device, std::size_t leading, KsvdUpdate update, std::size_t lanes)
    : device_(device),
      update_(update),
      lanes_(lanes_on(device, lanes)),
      partial_(device, most_granules * leading * sizeof(float), "sums of an atom's signals"),
      sums_(device, most_granules * 2 * sizeof(float), "sums of an atom's coefficients"),
      state_(device, 2 * sizeof(float), "state of an atom") {}

std::size_t AtomUpdate::bytes(std::size_t leading) {
  return (most_granules * (leading + 2) + 2) * sizeof(float);
}

void AtomUpdate::update(const CodeShape& shape, const AtomUses& uses, const Buffer& entries,
                        const Buffer& D, Buffer& updated, Buffer& coefficients, Buffer& R) {
  steps_ = 0;
  const std::array<cl_kernel, 2> products{update_kernel(device_, lanes_, false, "atom_products"),
                                          update_kernel(device_, lanes_, true, "atom_products")};
  const std::array<cl_kernel, 2> normalise{update_kernel(device_, lanes_, false, "normalise_atom"),
                                           update_kernel(device_, lanes_, true, "normalise_atom")};
  const cl_kernel apply = update_kernel(device_, lanes_, false, "apply_atom");
  for (std::size_t j = 0; j < shape.atoms; ++j) {
    const std::size_t first = uses.first[j];
    const std::size_t count = uses.first[j + 1] - first;
    const std::size_t granule = granule_of(count);
    const std::size_t granules = ceil_div(count, granule);
    // E^T w and the atom, of the coefficients or of E d
    const auto step = [&](std::size_t power) {
      set_arguments(products[power], ulong(shape.k), ulong(shape.leading), ulong(first),
                    ulong(count), ulong(granule), ulong(j), entries, coefficients, R, updated,
                    state_, partial_, sums_);
      launch_groups(device_, products[power], granules, lanes_);
      set_arguments(normalise[power], ulong(shape.leading), ulong(granules), ulong(j), D, partial_,
                    sums_, updated, state_);
      launch_groups(device_, normalise[power], 1, lanes_);
    };
    step(0);
    if (count == 0) continue;
    if (update_ == KsvdUpdate::exact) {
      std::array<float, 2> state{0, 1};
      for (std::size_t steps = 0; steps < most_steps && state[1] > converged;) {
        for (std::size_t i = 0; i < steps_at_once; ++i, ++steps) step(1);
        steps_ += steps_at_once;
        device_.read(state_, std::span<float>(state));
      }
    }
    set_arguments(apply, ulong(shape.k), ulong(shape.leading), ulong(first), ulong(count),
                  ulong(granule), ulong(j), entries, D, updated, state_, coefficients, R);
    launch_groups(device_, apply, granules, lanes_);
    if (j % 64 == 63) check_interrupt();
  }
  device_.finish();
}

}  // namespace weft::ops
