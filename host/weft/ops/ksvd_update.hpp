// The update of the atoms of K-SVD on the device: kernels/ksvd_update.cl. What is computed is
// defined in weft/reference/ksvd.hpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/reference/ksvd.hpp"

namespace weft::ops {

// Sizes of signals and codes. Rows of Y, R and D have `leading` floats, a multiple of
// atom_row_multiple, and are zero from the dimension on.
inline constexpr std::size_t atom_row_multiple = 16;
struct CodeShape {
  std::size_t signals = 0;
  std::size_t leading = 0;
  std::size_t atoms = 0;
  std::size_t k = 0;
};

// Codes on the device, [signals][k]; the first counts[i] of a signal are used.
struct DeviceCodes {
  Buffer indices;       // uint32
  Buffer coefficients;  // float
  Buffer counts;        // uint32 [signals]
};

// Which signals use each atom.
struct AtomUses {
  std::vector<std::size_t> first;      // [atoms + 1]
  std::vector<std::uint32_t> entries;  // signal k + slot, by atom, then by signal
};
// Entries with coefficient 0 are no use. An input error names the size if signals k is more than
// 32 bits count.
AtomUses atom_uses(const CodeShape& shape, std::span<const std::uint32_t> indices,
                   std::span<const float> coefficients);

// R = Y - X D and errors [signals], |r_i|^2, of codes. With `before`, the codes whose residuals by
// the same or a former dictionary R holds, a signal keeps its code where the new one is worse.
// `lanes` work-items go along a row; 0: one on CPUs, 64 on others.
void code_residuals(Device& device, const CodeShape& shape, const Buffer& Y, const Buffer& D,
                    DeviceCodes& codes, const DeviceCodes* before, Buffer& R, Buffer& errors,
                    std::size_t lanes = 0);

class AtomUpdate {
 public:
  // `lanes` as for code_residuals().
  AtomUpdate(Device& device, std::size_t leading, KsvdUpdate update, std::size_t lanes = 0);

  static std::size_t bytes(std::size_t leading);

  // Updates all atoms in their order: from `D` to `updated`, where atoms without use are as before;
  // coefficients and R = Y - X D follow. `entries` are those of `uses`.
  void update(const CodeShape& shape, const AtomUses& uses, const Buffer& entries, const Buffer& D,
              Buffer& updated, Buffer& coefficients, Buffer& R);

  // Steps of the power iteration of the last update, of all atoms; 0 of the approximate one.
  std::size_t steps() const { return steps_; }

 private:
  Device& device_;
  KsvdUpdate update_;
  std::size_t lanes_;
  Buffer partial_;
  Buffer sums_;
  Buffer state_;
  std::size_t steps_ = 0;
};

}  // namespace weft::ops
