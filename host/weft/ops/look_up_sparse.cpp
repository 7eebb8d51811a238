#include "weft/ops/look_up_sparse.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <limits>

#include "weft/ops/launch.hpp"

namespace weft::ops {

std::size_t sparse_channel_floats(std::size_t channels) {
  return round_up(channels, 4);
}

std::vector<float> pad_channels(std::span<const float> values, std::size_t channels) {
  const std::size_t row = sparse_channel_floats(channels);
  std::vector<float> rows(values.size() / channels * row, 0.0f);
  for (std::size_t i = 0; i < values.size(); ++i) {
    rows[i / channels * row + i % channels] = values[i];
  }
  return rows;
}

std::vector<std::uint32_t> end_lists(std::span<const std::uint32_t> atoms, std::size_t length) {
  std::vector<std::uint32_t> lists;
  for (std::size_t first = 0; length > 0 && first < atoms.size(); first += length) {
    const auto list = atoms.subspan(first, length);
    lists.insert(lists.end(), list.begin(), list.end());
    lists.push_back(std::numeric_limits<std::uint32_t>::max());
  }
  return lists;
}

void look_up_sparse(Device& device, const LookupBatch& batch, const SparseLengths& lengths,
                    const SparseTerms& V, const SparseTerms& P, const Buffer& dictionary,
                    const Buffer& mean, TexelLists lists) {
  const cl_kernel kernel = device.kernel(
      kernel_sources::look_up_sparse,
      fmt::format("{} -DK1={} -DK2={} -DMERGE={}",
                  lookup_options(device, batch.lookup, batch.shape.channels), lengths.view_terms,
                  lengths.texel_terms, lists == TexelLists::merged ? 1 : 0),
      "look_up_sparse");
  set_arguments(kernel, ulong(batch.count), ulong(batch.shape.views), ulong(batch.shape.lights),
                batch.lookups, P.atoms, P.coefficients, V.atoms, V.coefficients, dictionary, mean,
                batch.out);
  launch_items(device, kernel, ceil_div(batch.count, lookup_block(device)));
}

double look_up_sparse_flops(const LookupShape& lookup, std::size_t channels,
                            const SparseLengths& lengths) {
  const std::size_t atoms = lookup.texels * lengths.texel_terms;
  const std::size_t directions = lookup.views * lookup.lights;
  return 2.0 * static_cast<double>(atoms * directions * channels) *
             static_cast<double>(lengths.view_terms + 1) +
         2.0 * static_cast<double>(directions * channels);
}

}  // namespace weft::ops
