// Values of tunable macros on one device: the defaults of the launchers, over them the entries of
// the database that comes with the program, over those the user's own (device/tuning_file.hpp).
//
//   {"format": "weft tuning", "version": 1, "entries": [
//     {"device": {"kind": "cpu", "platform": "...", "vendor": "...", "name": "...",
//                 "version": "...", "driver": "..."},
//      "kernel": "gemm", "values": {"MC": 96, "KC": 240}}]}
//
// An entry serves a device only if all six texts are that device's own; an entry of the shipped
// database may leave some out and serves every device that the rest describes. Macros that an entry
// does not name keep their defaults. An entry that can't be used (an unknown kernel or macro, a
// value that is not legal, another device) is left aside whole, with one warning that names file,
// entry and reason. Nothing is printed here: tools show the warnings.
#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "weft/device/tunables.hpp"

namespace weft {

// What a device is known by, in the order of `fingerprint_fields`; an empty text of a shipped entry
// fits every device.
using DeviceFingerprint = std::array<std::string, 6>;
inline constexpr std::array<const char*, 6> fingerprint_fields = {"kind", "platform", "vendor",
                                                                  "name", "version",  "driver"};
DeviceFingerprint fingerprint(const DeviceLimits& limits);

// A database as text, and the name by which warnings call it. An empty text holds no entry.
struct TuningDatabase {
  std::string name;
  std::string text;
};

class Tuning {
 public:
  // The defaults alone.
  Tuning() = default;
  // `present`: the devices of this machine, whose entries are passed over without warning.
  // `warnings`: what could not be read, to be kept with the others.
  Tuning(const DeviceLimits& limits, std::span<const DeviceFingerprint> present,
         const TuningDatabase& shipped, const TuningDatabase& user,
         std::vector<std::string> warnings = {});

  // The value of a macro; a run-time error if the kernel has no such macro.
  std::size_t value(const TunableKernel& kernel, std::string_view macro) const;
  // All values, in the order of the kernel's table.
  std::vector<std::size_t> values(const TunableKernel& kernel) const;
  // "-DMC=96 -DKC=240": all macros of the kernel.
  std::string options(const TunableKernel& kernel) const;
  // Where the values come from: "default", "shipped", the name of the user's file, or what set()
  // was told.
  std::string source(const TunableKernel& kernel) const;
  // The kernels whose values were asked for.
  const std::set<std::string>& used() const { return used_; }

  // Sets legal values, in the order of the table, as a search does.
  void set(const TunableKernel& kernel, std::vector<std::size_t> values, std::string source);

  // One line for each entry, or database, that is left aside.
  const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  struct Values {
    std::vector<std::size_t> values;
    std::string source;
  };
  class Reader;

  std::map<std::string, Values, std::less<>> kernels_;
  std::vector<std::string> warnings_;
  mutable std::set<std::string> used_;
};

// Why values, in the order of the kernel's table, can't be used on a device; empty if they can.
std::string refusal(const TunableKernel& kernel, std::span<const std::size_t> values,
                    const DeviceLimits& limits);

// "MC=96 KC=240".
std::string format_values(const TunableKernel& kernel, std::span<const std::size_t> values);

}  // namespace weft
