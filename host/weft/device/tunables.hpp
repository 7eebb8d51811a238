// The macros of kernels that a device may have its own values for, with their defaults.
//
// A launcher defines one TunableKernel beside itself and asks its Device for the values:
//
//   constexpr Tunable macros[] = {{"KC", 240, {96, 240, 384}, "depth of a block"}};
//   constinit const TunableKernel tunables::gemm{"gemm", macros};
//   ...
//   const std::size_t depth = device.parameter(tunables::gemm, "KC");
//   device.kernel(kernel_sources::gemm, device.tuned_options(tunables::gemm), "gemm");
//
// It is declared below and listed in tunables.cpp: `weft tune` and the tuning database know it
// then. Values decide about speed, and about results no more than by rounding.
#pragma once

#include <array>
#include <cstddef>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>

namespace weft {

struct DeviceLimits;

// The values that a macro may have, ascending.
class LegalValues {
 public:
  static constexpr std::size_t most = 16;

  constexpr LegalValues(std::initializer_list<std::size_t> values) {
    for (const std::size_t value : values) values_.at(count_++) = value;
  }
  constexpr const std::size_t* begin() const { return values_.data(); }
  constexpr const std::size_t* end() const { return values_.data() + count_; }
  constexpr std::size_t size() const { return count_; }
  constexpr bool contains(std::size_t value) const {
    for (const std::size_t legal : *this) {
      if (legal == value) return true;
    }
    return false;
  }

 private:
  std::array<std::size_t, most> values_{};
  std::size_t count_ = 0;
};

struct Tunable {
  const char* macro;     // "KC"
  std::size_t standard;  // the default, one of the legal values
  LegalValues legal;
  const char* meaning;  // "depth of a block"
};

struct TunableKernel {
  const char* name;  // "gemm": the kernel's name in the database and in --kernel
  std::span<const Tunable> macros;
  // Why values, in the order of `macros`, can't go together on a device: "tiles need 96 KiB of
  // local memory"; empty if they can. Null if all legal values can.
  std::string (*conflict)(std::span<const std::size_t> values,
                          const DeviceLimits& limits) = nullptr;
};

// Index of a macro in the kernel's table, or its size if it has none of that name.
std::size_t find_macro(const TunableKernel& kernel, std::string_view macro);

// Every kernel that has tunable macros, by name; one of them, or null.
std::span<const TunableKernel* const> tunable_kernels();
const TunableKernel* find_tunable(std::string_view name);

// Each is defined by its launcher.
namespace tunables {
extern const TunableKernel batch_omp;
extern const TunableKernel convert_tile;
extern const TunableKernel decode_lpca;
extern const TunableKernel decode_pca;
extern const TunableKernel error_sums;
extern const TunableKernel gemm;
extern const TunableKernel gemm_tiled;
extern const TunableKernel scan_tile;
extern const TunableKernel transcode_tile;
}  // namespace tunables

}  // namespace weft
