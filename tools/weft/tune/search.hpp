// The search for good values of a kernel's macros within a time budget. It knows no device: a
// TuneWork checks and times candidates for it.
//
// Every candidate is checked before it counts, and timed beside the base values, turn by turn, so
// that a machine that changes its speed favours none. A small grid of legal values is visited
// whole, in a seeded order; of a larger one the neighbours of the best until none is better, then a
// seeded sample, and so on. At the end the best is timed against the base once more, and
// replaces it only if the gain stands out of the noise.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/device/tunables.hpp"

namespace weft {

// Values of a kernel's macros, in the order of its table.
using TuneValues = std::vector<std::size_t>;

class TuneWork {
 public:
  virtual ~TuneWork() = default;
  // Empty if the kernel computes what it should with these values, else what is wrong.
  virtual std::string check(const TuneValues& values) = 0;
  // Seconds of one run.
  virtual double time(const TuneValues& values) = 0;
  // Seconds since any fixed moment: the clock of the budget.
  virtual double now() = 0;
};

struct TuneOptions {
  double budget = 60;  // seconds; the candidate at hand is finished
  std::uint64_t seed = 0;
  // Called with the number of candidates so far, and with all there are.
  std::function<void(std::size_t done, std::size_t all)> progress;
};

struct TuneOutcome {
  std::size_t legal = 0;                // combinations of legal values that suit the device
  std::size_t tried = 0;                // of them, the base included
  std::size_t rejected = 0;             // for a wrong result or a failure
  std::vector<std::string> rejections;  // the first few, "MC=48 KC=96: element 3 is ..."
  TuneValues best;                      // the base, unless something is better by more than noise
  bool improved = false;
  // Of the last comparison: medians, and half the distance of the quartiles of best / base.
  double base_seconds = 0;
  double best_seconds = 0;
  double noise = 0;
  bool compared = false;  // whether there was anything to compare the base with
};

// `base`: the values to beat; `first`: the candidates to look at before any other. Throws a
// run-time error if the base itself is wrong, and whatever else than an input or run-time error
// comes from the work (an interruption).
TuneOutcome tune_kernel(const TunableKernel& kernel, const DeviceLimits& limits,
                        const TuneValues& base, const std::vector<TuneValues>& first,
                        TuneWork& work, const TuneOptions& options);

}  // namespace weft
