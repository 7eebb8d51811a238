// Dictionary learning, as K-SVD of texels has it: the residuals of their codes, and one update of
// all atoms.
#include <algorithm>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "bench/benchmark.hpp"
#include "weft/ops/ksvd_update.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {

constexpr std::size_t signals = 16384, dimension = 300, atoms = 256, k = 9;
constexpr double values = static_cast<double>(signals * k * dimension);

// Codes of `k` atoms each, in no order, and what is updated with them.
struct DictionaryData {
  explicit DictionaryData(Device& device)
      : shape{signals, ops::round_up(dimension, ops::atom_row_multiple), atoms, k},
        Y(padded_rows(device, signals, shape.leading)),
        D(padded_rows(device, atoms, shape.leading)),
        updated(device, D.size(), "dictionary"),
        R(device, Y.size(), "residuals"),
        errors(device, signals * sizeof(float), "errors") {
    std::vector<std::uint32_t> indices(signals * k);
    std::vector<float> coefficients(signals * k);
    reference::fill_random(2, coefficients);
    for (std::size_t i = 0; i < signals; ++i) {
      // atoms of a signal: one of each of k parts
      for (std::size_t s = 0; s < k; ++s) {
        const std::size_t part = atoms / k;
        indices[i * k + s] =
            static_cast<std::uint32_t>(s * part + reference::splitmix64(s, i) % part);
      }
    }
    uses = ops::atom_uses(shape, indices, coefficients);
    entries = Buffer(device, uses.entries.size() * sizeof(std::uint32_t), "uses");
    codes.indices = Buffer(device, indices.size() * sizeof(std::uint32_t), "indices");
    codes.coefficients = Buffer(device, coefficients.size() * sizeof(float), "coefficients");
    codes.counts = Buffer(device, signals * sizeof(std::uint32_t), "counts");
    device.write(entries, std::span<const std::uint32_t>(uses.entries));
    device.write(codes.indices, std::span<const std::uint32_t>(indices));
    device.write(codes.coefficients, std::span<const float>(coefficients));
    const std::vector<std::uint32_t> counts(signals, k);
    device.write(codes.counts, std::span<const std::uint32_t>(counts));
    ops::code_residuals(device, shape, Y, D, codes, nullptr, R, errors);
  }

  static Buffer padded_rows(Device& device, std::size_t rows, std::size_t leading) {
    std::vector<float> row_values(rows * leading);
    reference::fill_random(rows, row_values);
    for (std::size_t i = 0; i < rows; ++i) {
      std::fill_n(row_values.begin() + static_cast<std::ptrdiff_t>(i * leading + dimension),
                  leading - dimension, 0.0f);
    }
    Buffer buffer(device, row_values.size() * sizeof(float), "rows");
    device.write(buffer, std::span<const float>(row_values));
    return buffer;
  }

  ops::CodeShape shape;
  Buffer Y, D, updated, R, errors, entries;
  ops::DeviceCodes codes;
  ops::AtomUses uses;
};

Run residuals(Device& device) {
  const auto data = std::make_shared<DictionaryData>(device);
  return [=, &device] {
    ops::code_residuals(device, data->shape, data->Y, data->D, data->codes, nullptr, data->R,
                        data->errors);
  };
}

Run update(Device& device) {
  const auto data = std::make_shared<DictionaryData>(device);
  const auto operation =
      std::make_shared<ops::AtomUpdate>(device, data->shape.leading, KsvdUpdate::approximate);
  return [=] {
    operation->update(data->shape, data->uses, data->entries, data->D, data->updated,
                      data->codes.coefficients, data->R);
    std::swap(data->D, data->updated);  // the one that the residuals are of
  };
}

}  // namespace

std::vector<Benchmark> dictionary_benchmarks() {
  const char* shape = "16384 x 300, 256 atoms, k 9";
  return {
      {"code_residuals", shape, 2 * values, 8.0 * signals * dimension, false, residuals},
      {"ksvd_update", shape, 10 * values, 12 * values, false, update},
  };
}

}  // namespace weft
