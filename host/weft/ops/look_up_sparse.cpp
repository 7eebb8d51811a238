#include "weft/ops/look_up_sparse.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <limits>

#include "weft/ops/launch.hpp"

namespace weft::ops {

namespace {

// Atoms in whole vectors, or 0 where terms are read one by one.
std::size_t summed_atoms(std::size_t width, std::size_t atoms) {
  return atoms > most_summed_atoms ? 0 : round_up(std::max<std::size_t>(atoms, 1), width);
}

// Whole vectors of 4 floats.
std::size_t channel_floats(std::size_t channels) {
  return round_up(channels, 4);
}

template <typename T>
std::vector<T> ended(std::span<const T> terms, std::size_t length, T end) {
  std::vector<T> lists;
  for (std::size_t first = 0; length > 0 && first < terms.size(); first += length) {
    const auto list = terms.subspan(first, length);
    lists.insert(lists.end(), list.begin(), list.end());
    lists.push_back(end);
  }
  return lists;
}

}  // namespace

std::size_t lookup_dictionary_floats(std::size_t width, std::size_t atoms, std::size_t lights,
                                     std::size_t channels) {
  const std::size_t summed = summed_atoms(width, atoms);
  return lights * (summed > 0 ? channels * summed : atoms * channel_floats(channels));
}

std::vector<float> lookup_dictionary(std::size_t width, std::size_t atoms, std::size_t lights,
                                     std::size_t channels, std::span<const float> dictionary) {
  std::vector<float> rows(lookup_dictionary_floats(width, atoms, lights, channels), 0.0f);
  const std::size_t summed = summed_atoms(width, atoms);
  for (std::size_t i = 0; i < dictionary.size(); ++i) {
    const std::size_t atom = i / (lights * channels);
    const std::size_t row = i / channels;
    const std::size_t at = summed > 0 ? i % (lights * channels) * summed + atom
                                      : row * channel_floats(channels) + i % channels;
    rows[at] = dictionary[i];
  }
  return rows;
}

std::vector<std::uint32_t> end_lists(std::span<const std::uint32_t> atoms, std::size_t length) {
  return ended(atoms, length, std::numeric_limits<std::uint32_t>::max());
}

std::vector<float> end_lists(std::span<const float> coefficients, std::size_t length) {
  return ended(coefficients, length, 0.0f);
}

void look_up_sparse(Device& device, const LookupBatch& batch, const SparseLengths& lengths,
                    const SparseTerms& V, const SparseTerms& P, const Buffer& dictionary,
                    const Buffer& mean, TexelLists lists) {
  const cl_kernel kernel = device.kernel(
      kernel_sources::look_up_sparse,
      fmt::format("{} {} -DK1={} -DK2={} -DATOMS={} -DMERGE={}", vector_option(device),
                  lookup_options(device, batch.lookup, batch.shape.channels), lengths.view_terms,
                  lengths.texel_terms, summed_atoms(vector_width(device), lengths.light_atoms),
                  lists == TexelLists::merged ? 1 : 0),
      "look_up_sparse");
  set_arguments(kernel, ulong(batch.count), ulong(batch.shape.views), ulong(batch.shape.lights),
                batch.lookups, P.atoms, P.coefficients, V.atoms, V.coefficients, dictionary, mean,
                batch.out);
  launch_items(device, kernel, ceil_div(batch.count, lookup_block(device)));
}

double look_up_sparse_flops(const LookupShape& lookup, std::size_t channels,
                            const SparseLengths& lengths) {
  const std::size_t terms = lookup.texels * lengths.texel_terms * lookup.views * lengths.view_terms;
  const std::size_t lit = lookup.lights + 1;
  const std::size_t values = summed_atoms(1, lengths.light_atoms) > 0
                                 ? terms + lengths.light_atoms * lit * channels
                                 : terms * lit * channels;
  return 2.0 * static_cast<double>(values + lookup.views * lookup.lights * channels);
}

}  // namespace weft::ops
