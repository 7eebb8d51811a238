#include "weft/device/tuning_file.hpp"

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <system_error>

#include "weft/device/kernel_sources.hpp"
#include "weft/error.hpp"
#include "weft/io/atomic_file.hpp"
#include "weft/io/json_text.hpp"

namespace weft {
namespace {

using Json = nlohmann::json;

constexpr const char* format_name = "weft tuning";
constexpr std::uint64_t format_version = 1;

std::optional<std::string> environment(const char* name) {
  const char* value = std::getenv(name);
  if (!value) return std::nullopt;
  return std::string(value);
}

Json device_json(const DeviceFingerprint& device) {
  Json object = Json::object();
  for (std::size_t i = 0; i < device.size(); ++i) object[fingerprint_fields[i]] = device[i];
  return object;
}

Json entry_json(const TuningResult& result) {
  return {{"device", device_json(result.device)},
          {"kernel", result.kernel},
          {"values", result.values},
          {"measured",
           {{"shape", result.shape},
            {"default_seconds", result.default_seconds},
            {"seconds", result.seconds}}}};
}

bool is_for(const Json& entry, const TuningResult& result) {
  return entry.is_object() && entry.value("kernel", Json()) == result.kernel &&
         entry.value("device", Json()) == device_json(result.device);
}

// What a file holds already; an empty database if it is missing.
Json existing(const std::filesystem::path& file) {
  std::vector<std::string> warnings;
  const TuningDatabase database = read_tuning(file, warnings);
  if (!warnings.empty()) fail_input("{}: not a tuning database: {}", file.string(), warnings[0]);
  if (!database.text.empty()) return parse_tuning(database);
  return {{"format", format_name}, {"version", format_version}, {"entries", Json::array()}};
}

}  // namespace

TuningDatabase shipped_tuning() {
  return {"the shipped tuning database", shipped_tuning_text};
}

std::filesystem::path user_tuning_file() {
  if (const auto named = environment("WEFT_TUNING")) return *named;
  const auto config = environment("XDG_CONFIG_HOME");
  if (config && !config->empty()) return std::filesystem::path(*config) / "weft" / "tuning.json";
  const auto home = environment("HOME");
  if (!home || home->empty()) return {};
  return std::filesystem::path(*home) / ".config" / "weft" / "tuning.json";
}

TuningDatabase read_tuning(const std::filesystem::path& file, std::vector<std::string>& warnings) {
  TuningDatabase database{file.string(), {}};
  if (file.empty()) return database;
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(file, error);
  if (status.type() == std::filesystem::file_type::not_found) return database;
  const auto refuse = [&](const std::string& reason) {
    warnings.push_back(fmt::format("{}: {}; the whole file is ignored", file.string(), reason));
    return database;
  };
  // a pipe would wait for ever, a device never end
  if (!std::filesystem::is_regular_file(status)) return refuse("it is not a regular file");
  std::ifstream stream(file, std::ios::binary);
  std::string text(largest_tuning_file + 1, '\0');
  stream.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (!stream.eof() && stream.fail()) return refuse("it can't be read");
  text.resize(static_cast<std::size_t>(stream.gcount()));
  if (text.size() > largest_tuning_file) {
    return refuse(fmt::format("it is larger than {} bytes", largest_tuning_file));
  }
  if (text.empty()) return refuse("it is empty");
  database.text = std::move(text);
  return database;
}

TuningDatabase read_user_tuning(std::vector<std::string>& warnings) {
  const std::filesystem::path file = user_tuning_file();
  std::error_code error;
  if (!file.empty() && environment("WEFT_TUNING") && !std::filesystem::exists(file, error)) {
    warnings.push_back(fmt::format("WEFT_TUNING={}: there is no such file", file.string()));
  }
  return read_tuning(file, warnings);
}

Json parse_tuning(const TuningDatabase& database) {
  Json root = parse_json(database.text, database.name);
  if (!root.is_object() || !root.contains("format") || root["format"] != format_name) {
    fail_input("{}: \"format\" is not \"{}\"", database.name, format_name);
  }
  if (!root.contains("version") || root["version"] != format_version) {
    fail_input("{}: \"version\" is {}, where {} is known", database.name,
               root.contains("version") ? shown(root["version"].dump()) : "missing",
               format_version);
  }
  if (!root.contains("entries") || !root["entries"].is_array()) {
    fail_input("{}: \"entries\" is not an array", database.name);
  }
  return root;
}

void check_tuning_file(const std::filesystem::path& file) {
  existing(file);
  // the folder of a new file may be missing still
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  std::error_code error;
  if (std::filesystem::exists(folder, error)) AtomicFile probe(file);
}

void save_tuning(const std::filesystem::path& file, const std::vector<TuningResult>& results) {
  Json root = existing(file);
  Json entries = Json::array();
  for (Json& entry : root["entries"]) {
    bool replaced = false;
    for (const TuningResult& result : results) replaced |= is_for(entry, result);
    if (!replaced) entries.push_back(std::move(entry));
  }
  for (const TuningResult& result : results) entries.push_back(entry_json(result));
  root["entries"] = std::move(entries);
  const std::string text = root.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
  if (text.size() > largest_tuning_file) {
    fail_input("{}: it would be larger than {} bytes", file.string(), largest_tuning_file);
  }
  // in one step
  if (file.has_parent_path()) {
    std::error_code error;
    std::filesystem::create_directories(file.parent_path(), error);
    if (error) {
      fail_input("{}: can't make the folder: {}", file.parent_path().string(), error.message());
    }
  }
  AtomicFile out(file);
  out.write(std::as_bytes(std::span(text)));
  out.commit();
}

}  // namespace weft
