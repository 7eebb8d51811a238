// A device that does not exist, and tuning databases with entries for it.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/device/tuning.hpp"

namespace weft::test {

using Json = nlohmann::json;

inline DeviceLimits sample_limits() {
  DeviceLimits limits;
  limits.platform = "Sample Platform";
  limits.vendor = "Sample Vendor";
  limits.name = "Sample Device";
  limits.version = "OpenCL 3.0 sample";
  limits.driver = "1.0";
  limits.is_cpu = true;
  limits.max_work_group = 1024;
  limits.local_memory = 65536;
  limits.compute_units = 2;
  return limits;
}

// A good entry: decode_pca on that device.
inline Json sample_entry() {
  Json device = Json::object();
  const DeviceFingerprint texts = fingerprint(sample_limits());
  for (std::size_t i = 0; i < texts.size(); ++i) device[fingerprint_fields[i]] = texts[i];
  return {{"device", device}, {"kernel", "decode_pca"}, {"values", {{"IMAGES", 32}}}};
}

// A database of sample entries, each with some fields replaced.
inline TuningDatabase sample_database(const std::string& name, const std::vector<Json>& patches) {
  Json entries = Json::array();
  for (const Json& patch : patches) {
    Json entry = sample_entry();
    for (const auto& [field, value] : patch.items()) entry[field] = value;
    entries.push_back(entry);
  }
  return {name, Json{{"format", "weft tuning"}, {"version", 1}, {"entries", entries}}.dump()};
}

}  // namespace weft::test
