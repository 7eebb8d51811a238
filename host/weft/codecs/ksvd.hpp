// Dictionary learning by K-SVD on the device; what is computed is defined in
// weft/reference/ksvd.hpp.
//
// All signals are held on the device, with their residuals, or as many as KsvdOptions::batch says:
// they are then read from the source twice per iteration, to learn and to measure.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <string>

#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/reference/ksvd.hpp"

namespace weft {

// The rows of Y, in host memory or made as they are asked for.
struct KsvdSignals {
  std::size_t signals = 0;
  std::size_t dimension = 0;
  // Writes the rows from `first` on that fit into `rows`; the same every time.
  std::function<void(std::size_t first, std::span<float> rows)> read;

  // Row-major values that outlive it.
  static KsvdSignals of(std::size_t dimension, std::span<const float> values);
};

// Fits dictionary and codes. Signals of any magnitude up to 1e37: they are scaled by a power of
// two. `name` begins the names of the job's stages ("NAME: coding", "NAME: atoms") and of the note
// that lists |Y - X D| / |Y| of all iterations. The same bits for the same signals, options and
// device.
//
// Throws input errors: sizes of 0, a `given` dictionary of another size, a NaN or infinity in it or
// in the signals, which the message locates, or more memory than the job has (a smaller batch takes
// less).
KsvdFit<float> ksvd(Device& device, const KsvdSignals& signals, const KsvdOptions& options,
                    std::span<const float> given, Job& job, const std::string& name = "K-SVD");

// Device and host memory that it takes.
MemoryPlan ksvd_plan(const Device& device, std::size_t signals, std::size_t dimension,
                     const KsvdOptions& options);

}  // namespace weft
