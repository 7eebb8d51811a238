#include "weft/device/tuning.hpp"

#include <nlohmann/json.hpp>
#include <utility>

#include "weft/device/device.hpp"
#include "weft/device/tuning_file.hpp"
#include "weft/error.hpp"
#include "weft/io/json_text.hpp"

namespace weft {
namespace {

using Json = nlohmann::json;

// More warnings than this of one database are counted, not told.
constexpr std::size_t most_warnings = 16;

std::vector<std::size_t> standard_values(const TunableKernel& kernel) {
  std::vector<std::size_t> values;
  for (const Tunable& macro : kernel.macros) values.push_back(macro.standard);
  return values;
}

std::string legal_values(const Tunable& macro) {
  std::string list;
  for (const std::size_t value : macro.legal) {
    list += fmt::format("{}{}", list.empty() ? "" : ", ", value);
  }
  return list;
}

}  // namespace

DeviceFingerprint fingerprint(const DeviceLimits& limits) {
  return {limits.is_cpu ? "cpu" : "other",
          limits.platform,
          limits.vendor,
          limits.name,
          limits.version,
          limits.driver};
}

std::string format_values(const TunableKernel& kernel, std::span<const std::size_t> values) {
  std::string text;
  for (std::size_t i = 0; i < kernel.macros.size(); ++i) {
    text += fmt::format("{}{}={}", i == 0 ? "" : " ", kernel.macros[i].macro, values[i]);
  }
  return text;
}

std::string refusal(const TunableKernel& kernel, std::span<const std::size_t> values,
                    const DeviceLimits& limits) {
  for (std::size_t i = 0; i < kernel.macros.size(); ++i) {
    const Tunable& macro = kernel.macros[i];
    if (!macro.legal.contains(values[i])) {
      return fmt::format("{} is {}; legal values are {}", macro.macro, values[i],
                         legal_values(macro));
    }
  }
  return kernel.conflict ? kernel.conflict(values, limits) : std::string();
}

// Reads one database into a Tuning.
class Tuning::Reader {
 public:
  Reader(Tuning& tuning, const DeviceLimits& limits, std::span<const DeviceFingerprint> present,
         const TuningDatabase& database, bool shipped)
      : tuning_(tuning),
        limits_(limits),
        own_(fingerprint(limits)),
        present_(present),
        database_(database),
        shipped_(shipped) {}

  void read() {
    if (database_.text.empty()) return;
    try {
      const Json root = parse_tuning(database_);
      const Json& entries = root.at("entries");
      for (std::size_t i = 0; i < entries.size(); ++i) {
        const std::string problem = read_entry(entries[i]);
        if (!problem.empty()) warn(fmt::format("{}: {}", entry_name(i, entries[i]), problem));
      }
    } catch (const Error& error) {
      warn(fmt::format("{}; the whole file is ignored", error.what()));
    }
    if (unsaid_ > 0) {
      tuning_.warnings_.push_back(
          fmt::format("{}: {} more entries are ignored", database_.name, unsaid_));
    }
  }

 private:
  void warn(std::string warning) {
    if (said_ == most_warnings) {
      ++unsaid_;
      return;
    }
    ++said_;
    tuning_.warnings_.push_back(std::move(warning));
  }

  // "FILE: entry 2 (gemm) is ignored"
  std::string entry_name(std::size_t index, const Json& entry) const {
    std::string kernel;
    if (entry.is_object() && entry.contains("kernel") && entry["kernel"].is_string()) {
      kernel = fmt::format(" ({})", shown(entry["kernel"].get_ref<const std::string&>()));
    }
    return fmt::format("{}: entry {}{} is ignored", database_.name, index, kernel);
  }

  // Empty, or why the entry can't be used.
  std::string read_entry(const Json& entry) {
    if (!entry.is_object()) return "it is not an object";
    for (const char* field : {"device", "values"}) {
      if (!entry.contains(field) || !entry[field].is_object()) {
        return fmt::format("\"{}\" is not an object", field);
      }
    }
    if (!entry.contains("kernel") || !entry["kernel"].is_string()) {
      return "\"kernel\" is not a string";
    }
    bool of_another = false;
    std::string problem = check_device(entry["device"], of_another);
    if (!problem.empty() || of_another) return problem;
    const auto& name = entry["kernel"].get_ref<const std::string&>();
    const TunableKernel* kernel = find_tunable(name);
    if (!kernel) return "no kernel of this name has tunable macros";
    std::vector<std::size_t> values = standard_values(*kernel);
    problem = read_values(entry["values"], *kernel, values);
    if (problem.empty()) problem = refusal(*kernel, values, limits_);
    if (!problem.empty()) return problem;
    if (!read_.insert(name).second) return "an earlier entry holds values for it already";
    tuning_.set(*kernel, std::move(values), shipped_ ? "shipped" : database_.name);
    return {};
  }

  // Empty if the entry is for this device, or (`of_another`) for another device of this machine.
  std::string check_device(const Json& device, bool& of_another) const {
    DeviceFingerprint texts;
    for (std::size_t i = 0; i < texts.size(); ++i) {
      const char* field = fingerprint_fields[i];
      if (!device.contains(field)) {
        if (shipped_) continue;
        return fmt::format("its device has no \"{}\"", field);
      }
      if (!device[field].is_string()) return fmt::format("\"{}\" is not a string", field);
      texts[i] = device[field].get<std::string>();
    }
    const auto fits = [&](const DeviceFingerprint& candidate) {
      for (std::size_t i = 0; i < texts.size(); ++i) {
        const bool any = shipped_ && texts[i].empty();
        if (!any && texts[i] != candidate[i]) return false;
      }
      return true;
    };
    if (fits(own_)) return {};
    // a shipped database is about devices that most machines don't have
    of_another = shipped_;
    for (const DeviceFingerprint& candidate : present_) of_another |= fits(candidate);
    if (of_another) return {};
    std::size_t different = 0;
    while (texts[different] == own_[different]) ++different;
    return fmt::format("it is for another device: {} \"{}\", where this one's is \"{}\"",
                       fingerprint_fields[different], shown(texts[different]),
                       shown(own_[different]));
  }

  static std::string read_values(const Json& object, const TunableKernel& kernel,
                                 std::vector<std::size_t>& values) {
    for (const auto& [macro, value] : object.items()) {
      const std::size_t index = find_macro(kernel, macro);
      if (index == values.size()) {
        return fmt::format("the kernel has no tunable macro \"{}\"", shown(macro));
      }
      if (!value.is_number_unsigned()) {
        return fmt::format("{} is not an unsigned whole number", shown(macro));
      }
      values[index] = value.get<std::size_t>();
    }
    return {};
  }

  Tuning& tuning_;
  const DeviceLimits& limits_;
  DeviceFingerprint own_;
  std::span<const DeviceFingerprint> present_;
  const TuningDatabase& database_;
  bool shipped_;
  std::set<std::string> read_;
  std::size_t said_ = 0;
  std::size_t unsaid_ = 0;
};

Tuning::Tuning(const DeviceLimits& limits, std::span<const DeviceFingerprint> present,
               const TuningDatabase& shipped, const TuningDatabase& user,
               std::vector<std::string> warnings)
    : warnings_(std::move(warnings)) {
  Reader(*this, limits, present, shipped, true).read();
  Reader(*this, limits, present, user, false).read();
}

std::size_t Tuning::value(const TunableKernel& kernel, std::string_view macro) const {
  const std::size_t index = find_macro(kernel, macro);
  if (index == kernel.macros.size()) {
    fail_runtime("kernel {} has no tunable macro {}", kernel.name, macro);
  }
  used_.insert(kernel.name);
  const auto found = kernels_.find(kernel.name);
  return found == kernels_.end() ? kernel.macros[index].standard : found->second.values[index];
}

std::vector<std::size_t> Tuning::values(const TunableKernel& kernel) const {
  const auto found = kernels_.find(kernel.name);
  return found == kernels_.end() ? standard_values(kernel) : found->second.values;
}

std::string Tuning::options(const TunableKernel& kernel) const {
  used_.insert(kernel.name);
  const std::vector<std::size_t> all = values(kernel);
  std::string text;
  for (std::size_t i = 0; i < kernel.macros.size(); ++i) {
    text += fmt::format("{}-D{}={}", i == 0 ? "" : " ", kernel.macros[i].macro, all[i]);
  }
  return text;
}

std::string Tuning::source(const TunableKernel& kernel) const {
  const auto found = kernels_.find(kernel.name);
  return found == kernels_.end() ? "default" : found->second.source;
}

void Tuning::set(const TunableKernel& kernel, std::vector<std::size_t> values, std::string source) {
  kernels_.insert_or_assign(kernel.name, Values{std::move(values), std::move(source)});
}

}  // namespace weft
