#include "weft/ops/look_up_sparse.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstring>
#include <limits>

#include "weft/ops/launch.hpp"

namespace weft::ops {

namespace {

// Floats of a dictionary's row of one light that are blended at most: it stays in the first cache.
constexpr std::size_t most_blended_floats = 4096;

// So that a light's row is whole vectors of 16 floats.
std::size_t padded_atoms(std::size_t atoms) {
  return round_up(std::max<std::size_t>(atoms, 1), 4);
}

std::size_t light_floats(std::size_t atoms, std::size_t channels) {
  return padded_atoms(atoms) * round_up(channels, 4);
}

bool blends(std::size_t atoms, std::size_t channels) {
  return light_floats(atoms, channels) <= most_blended_floats;
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

std::size_t lookup_dictionary_floats(std::size_t atoms, std::size_t lights, std::size_t channels) {
  return lights * light_floats(atoms, channels);
}

std::vector<float> lookup_dictionary(std::size_t atoms, std::size_t lights, std::size_t channels,
                                     std::span<const float> dictionary) {
  std::vector<float> rows(lookup_dictionary_floats(atoms, lights, channels), 0.0f);
  for (std::size_t i = 0; i < dictionary.size(); ++i) {
    const std::size_t atom = i / (lights * channels);
    const std::size_t light = i / channels % lights;
    rows[light * light_floats(atoms, channels) + atom * round_up(channels, 4) + i % channels] =
        dictionary[i];
  }
  return rows;
}

std::vector<std::uint32_t> end_lists(std::span<const std::uint32_t> atoms, std::size_t length) {
  return ended(atoms, length, std::numeric_limits<std::uint32_t>::max());
}

std::vector<float> end_lists(std::span<const float> coefficients, std::size_t length) {
  return ended(coefficients, length, 0.0f);
}

std::size_t lookup_row(std::size_t length) {
  constexpr std::size_t line = 64 / sizeof(std::uint32_t);
  const std::size_t words = length + ceil_div(length, 2);
  return words < line ? std::bit_ceil(words) : round_up(words, line);
}

std::vector<std::uint32_t> lookup_rows(std::span<const std::uint32_t> atoms,
                                       std::span<const float> coefficients, std::size_t length) {
  const std::size_t row = lookup_row(length);
  std::vector<std::uint32_t> rows(length > 0 ? atoms.size() / length * row : 0, 0);
  for (std::size_t i = 0; i < atoms.size(); ++i) {
    std::uint32_t* words = rows.data() + i / length * row;
    const std::size_t term = i % length;
    words[term] = std::bit_cast<std::uint32_t>(coefficients[i]);
    const auto index = static_cast<std::uint16_t>(atoms[i]);
    std::memcpy(reinterpret_cast<std::byte*>(words + length) + term * sizeof(index), &index,
                sizeof(index));
  }
  return rows;
}

void look_up_sparse(Device& device, const LookupBatch& batch, const SparseLengths& lengths,
                    const Buffer& V, const SparseTerms& P, const Buffer& dictionary,
                    const Buffer& mean, TexelLists lists) {
  const cl_kernel kernel = device.kernel(
      kernel_sources::look_up_sparse,
      fmt::format("{} {} -DK1={} -DK2={} -DROW={} -DATOMS={} -DBLEND={} -DMERGE={}",
                  vector_option(device), lookup_options(device, batch.lookup, batch.shape.channels),
                  lengths.view_terms, lengths.texel_terms, lookup_row(lengths.view_terms),
                  padded_atoms(lengths.light_atoms),
                  blends(lengths.light_atoms, batch.shape.channels) ? 1 : 0,
                  lists == TexelLists::merged ? 1 : 0),
      "look_up_sparse");
  set_arguments(kernel, ulong(batch.count), ulong(batch.shape.views), ulong(batch.shape.lights),
                batch.lookups, P.atoms, P.coefficients, V, dictionary, mean, batch.out);
  launch_items(device, kernel, ceil_div(batch.count, lookup_block(device)));
}

double look_up_sparse_flops(const LookupShape& lookup, std::size_t channels,
                            const SparseLengths& lengths) {
  const std::size_t terms = lookup.texels * lengths.texel_terms * lookup.views * lengths.view_terms;
  const std::size_t values = blends(lengths.light_atoms, channels) && lookup.lights > 1
                                 ? (terms + lengths.light_atoms * lookup.lights) * channels
                                 : terms * lookup.lights * channels;
  return 2.0 * static_cast<double>(values + lookup.views * lookup.lights * channels);
}

}  // namespace weft::ops
