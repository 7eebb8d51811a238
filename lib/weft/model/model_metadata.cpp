#include "weft/model/model_metadata.hpp"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "weft/btf/recorded_selection.hpp"
#include "weft/error.hpp"
#include "weft/io/btf_tensors.hpp"
#include "weft/io/json_text.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

using nlohmann::json;

std::string field_of(const SafetensorsFile& file, const char* key) {
  return fmt::format("{}: metadata \"{}\"", file.path().string(), key);
}

// The text of a field that holds a JSON object, as it stands there.
std::string require_object(std::string_view text, const std::string& where) {
  if (!parse_json(text, where).is_object()) {
    fail_input("{}: {} is no JSON object", where, shown(text));
  }
  return std::string(text);
}

BtfShape read_shape(const SafetensorsFile& file) {
  const std::string where = field_of(file, "shape");
  const std::string_view text = file.require("shape");
  const json list = parse_json(text, where);
  const bool sizes =
      list.is_array() && list.size() == 5 &&
      std::all_of(list.begin(), list.end(), [](const json& n) { return n.is_number_unsigned(); });
  if (!sizes) fail_input("{}: {} is not [V, L, Y, X, C]", where, shown(text));
  return {list[0], list[1], list[2], list[3], list[4]};
}

double read_figure(const json& object, const char* key, const std::string& where) {
  const auto value = object.find(key);
  if (value != object.end()) {
    if (value->is_number()) return value->get<double>();
    if (*value == "inf") return std::numeric_limits<double>::infinity();
    if (*value == "-inf") return -std::numeric_limits<double>::infinity();
    if (*value == "nan") return std::numeric_limits<double>::quiet_NaN();
  }
  fail_input("{}: no figure \"{}\"", where, key);
}

ErrorReport read_errors(std::string_view text, std::size_t count, const std::string& where) {
  const json object = parse_json(text, where);
  if (!object.is_object()) fail_input("{}: {} is no JSON object", where, shown(text));
  ErrorReport report;
  report.count = count;
  report.rmse = read_figure(object, "rmse", where);
  report.peak = read_figure(object, "psnr_peak", where);
  report.psnr = read_figure(object, "psnr", where);
  report.snr = read_figure(object, "snr", where);
  report.relative = read_figure(object, "relative", where);
  report.max_error = read_figure(object, "max_error", where);
  if (object.contains("ssim")) report.ssim = read_figure(object, "ssim", where);
  if (const auto log = object.find("log"); log != object.end()) {
    const std::string log_where = where + " \"log\"";
    if (!log->is_object()) fail_input("{}: no JSON object", log_where);
    report.log =
        LogErrorReport{read_figure(*log, "scale", log_where), read_figure(*log, "rmse", log_where),
                       read_figure(*log, "snr", log_where)};
    if (!(report.log->scale > 0 && std::isfinite(report.log->scale))) {
      fail_input("{}: scale {}", log_where, report.log->scale);
    }
  }
  if (const auto weighted = object.find("weighted"); weighted != object.end()) {
    const std::string part = where + ": \"weighted\"";
    if (!weighted->is_object()) fail_input("{}: no JSON object", part);
    report.weighted = {read_figure(*weighted, "rmse", part), read_figure(*weighted, "psnr", part),
                       read_figure(*weighted, "snr", part),
                       read_figure(*weighted, "relative", part)};
  }
  return report;
}

Storage read_storage(const SafetensorsFile& file) {
  const std::string_view name = file.require("storage");
  if (name == "f16") return Storage::f16;
  if (name == "f32") return Storage::f32;
  fail_input("{}: \"{}\" is none of f16, f32", field_of(file, "storage"), shown(name));
}

}  // namespace

std::string checksum_of(std::span<const std::byte> bytes) {
  return fmt::format("{:016x}", XXH3_64bits(bytes.data(), bytes.size()));
}

// Its state must be aligned to 64 bytes, which the library's own allocation sees to.
struct Checksum::State {
  XXH3_state_t* hash = XXH3_createState();
  State() { XXH3_64bits_reset(hash); }
  ~State() { XXH3_freeState(hash); }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
};

Checksum::Checksum() : state_(std::make_unique<State>()) {}
Checksum::~Checksum() = default;
void Checksum::add(std::span<const std::byte> bytes) {
  XXH3_64bits_update(state_->hash, bytes.data(), bytes.size());
}
std::string Checksum::text() const {
  return fmt::format("{:016x}", XXH3_64bits_digest(state_->hash));
}

std::string checksums_json(const Checksums& checksums) {
  return json(checksums).dump();
}

Metadata model_metadata(const ModelInfo& info, const std::string& where) {
  if (info.codec.empty()) fail_input("{}: a model needs the name of its codec", where);
  const BtfShape& shape = info.btf.shape;
  Metadata metadata;
  metadata["weft.format"] = file_format_version;
  metadata["weft.version"] = info.program_version.empty() ? version() : info.program_version;
  metadata["codec"] = info.codec;
  metadata["parameters"] = require_object(info.parameters, where + ": parameters");
  metadata["selection"] = require_object(info.selection, where + ": selection");
  metadata["colour_transform"] = to_text(info.colour_transform);
  if (!info.weights.empty()) {
    metadata["weights"] = require_object(info.weights, where + ": weights");
  }
  metadata["storage"] = info.storage == Storage::f16 ? "f16" : "f32";
  metadata["shape"] = fmt::format("[{},{},{},{},{}]", shape.views, shape.lights, shape.height,
                                  shape.width, shape.channels);
  metadata["dtype"] = name_of(info.btf.dtype);
  put_btf_metadata(info.btf, metadata);
  if (info.errors) metadata["errors"] = to_json(*info.errors);
  return metadata;
}

ModelInfo read_model_info(const SafetensorsFile& file) {
  if (file.value("weft.format").empty()) {
    fail_input("{}: not a model (no metadata \"weft.format\")", file.path().string());
  }
  check_format_version(file, base_format_version);
  if (file.value("codec").empty()) {
    fail_input("{}: not a model (no metadata \"codec\"){}", file.path().string(),
               file.find("btf") != nullptr ? ": it is a raw BTF" : "");
  }

  ModelInfo info;
  info.codec = file.require("codec");
  info.program_version = file.require("weft.version");
  info.parameters = require_object(file.require("parameters"), field_of(file, "parameters"));
  info.selection = require_object(file.require("selection"), field_of(file, "selection"));
  if (file.metadata().count("weights") != 0) {
    info.weights = require_object(file.value("weights"), field_of(file, "weights"));
  }
  info.storage = read_storage(file);

  const std::string_view dtype = file.require("dtype");
  const std::optional<DType> type = dtype_from_name(dtype);
  if (!type) fail_input("{}: \"{}\" is no dtype", field_of(file, "dtype"), shown(dtype));
  info.btf.dtype = *type;
  info.btf.shape = read_shape(file);
  for (const char* key : {"encoding", "quantity", "layout", "channel_names", "source"}) {
    file.require(key);  // foreign raw files may leave them out, models never do
  }
  get_btf_metadata(file, info.btf);
  get_directions(file, info.btf);  // validates
  info.colour_transform =
      colour_transform_from_text(file.require("colour_transform"), info.btf.shape.channels,
                                 field_of(file, "colour_transform"));
  const std::string where = field_of(file, "selection");
  held_part(info.btf, recorded_from_json(info.selection, where), where);  // which must fit

  if (file.metadata().count("errors") != 0) {
    info.errors =
        read_errors(file.value("errors"), info.btf.shape.values(), field_of(file, "errors"));
  }
  return info;
}

Checksums read_checksums(const SafetensorsFile& file) {
  const std::string where = field_of(file, "checksums");
  const json object = parse_json(file.require("checksums"), where);
  if (!object.is_object()) fail_input("{}: no JSON object", where);
  Checksums checksums;
  for (const auto& [name, value] : object.items()) {
    if (!value.is_string()) fail_input("{}: \"{}\": not a string", where, shown(name));
    checksums[name] = value.get<std::string>();
  }
  return checksums;
}

}  // namespace weft
