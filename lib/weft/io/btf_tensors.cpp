#include "weft/io/btf_tensors.hpp"

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"

namespace weft {
namespace {

std::string field_of(const SafetensorsFile& file, std::string_view key) {
  return fmt::format("{}: metadata \"{}\"", file.path().string(), key);
}

std::vector<std::string> read_channel_names(const SafetensorsFile& file) {
  const std::string_view text = file.value("channel_names");
  if (text.empty()) return {};
  const std::string where = field_of(file, "channel_names");
  const nlohmann::json list = parse_json(text, where);
  if (!list.is_array()) fail_input("{}: {} is no list of strings", where, shown(text));
  std::vector<std::string> names;
  for (const nlohmann::json& name : list) {
    if (!name.is_string()) fail_input("{}: {} is no list of strings", where, shown(text));
    names.push_back(name.get<std::string>());
  }
  return names;
}

const TensorInfo& checked_tensor(const SafetensorsFile& file, std::string_view name, DType dtype,
                                 const std::vector<std::size_t>& shape) {
  const TensorInfo& tensor = file.get(name);
  if (tensor.dtype != dtype) {
    fail_input("{}: tensor \"{}\": dtype {} instead of {}", file.path().string(), name,
               name_of(tensor.dtype), name_of(dtype));
  }
  if (tensor.shape != shape) {
    fail_input("{}: tensor \"{}\": shape {} instead of {}", file.path().string(), name,
               shape_text(tensor.shape), shape_text(shape));
  }
  return tensor;
}

std::vector<Direction> read_directions(const SafetensorsFile& file, std::string_view name,
                                       std::size_t count) {
  const TensorInfo& tensor = checked_tensor(file, name, DType::f32, {count, 3});
  // The tensor is there with all its bytes: `count` is no mere claim.
  std::vector<Direction> directions(count);
  std::memcpy(directions.data(), file.data(tensor).data(), tensor.bytes());
  return directions;
}

}  // namespace

void put_btf_metadata(const BtfInfo& info, Metadata& metadata) {
  metadata["encoding"] = name_of(info.encoding);
  metadata["quantity"] = name_of(info.quantity);
  metadata["layout"] = name_of(info.layout);
  try {
    metadata["channel_names"] = nlohmann::json(info.channel_names).dump();
  } catch (const nlohmann::json::exception&) {
    fail_input("channel_names: a name is not valid UTF-8");
  }
  metadata["source"] = info.source;
}

void get_btf_metadata(const SafetensorsFile& file, BtfInfo& info) {
  info.encoding = info.dtype == DType::u8 ? Encoding::srgb : Encoding::linear;
  if (file.metadata().count("encoding") != 0) {
    info.encoding = encoding_from_name(file.value("encoding"), field_of(file, "encoding"));
  }
  if (file.metadata().count("quantity") != 0) {
    info.quantity = quantity_from_name(file.value("quantity"), field_of(file, "quantity"));
  }
  if (file.metadata().count("layout") != 0) {
    info.layout = layout_from_name(file.value("layout"), field_of(file, "layout"));
  }
  info.channel_names = read_channel_names(file);
  info.source = file.value("source");
}

std::vector<TensorInfo> btf_side_tensors(const BtfInfo& info) {
  std::vector<TensorInfo> tensors{
      {"view_directions", DType::f32, {info.view_directions.size(), 3}},
      {"light_directions", DType::f32, {info.light_directions.size(), 3}}};
  if (!info.mask.empty()) {
    tensors.push_back({"mask", DType::u8, {info.shape.views, info.shape.height, info.shape.width}});
  }
  return tensors;
}

std::span<const std::byte> btf_side_values(const BtfInfo& info, std::string_view tensor) {
  if (tensor == "view_directions") return std::as_bytes(std::span(info.view_directions));
  if (tensor == "light_directions") return std::as_bytes(std::span(info.light_directions));
  return std::as_bytes(std::span(info.mask));
}

void get_directions(const SafetensorsFile& file, BtfInfo& info) {
  info.view_directions = read_directions(file, "view_directions", info.shape.views);
  info.light_directions =
      read_directions(file, "light_directions",
                      info.layout == Layout::paired ? info.shape.views : info.shape.lights);
  validate(info, file.path().string());
}

void get_mask(const SafetensorsFile& file, BtfInfo& info) {
  info.mask.clear();
  if (file.find("mask") == nullptr) return;
  const BtfShape& shape = info.shape;
  const TensorInfo& mask =
      checked_tensor(file, "mask", DType::u8, {shape.views, shape.height, shape.width});
  info.mask.resize(mask.bytes());
  std::memcpy(info.mask.data(), file.data(mask).data(), mask.bytes());
  validate(info, file.path().string());
}

void get_btf_side_tensors(const SafetensorsFile& file, BtfInfo& info) {
  get_directions(file, info);
  get_mask(file, info);
}

TensorInfo mask_distance_tensor(const BtfInfo& info) {
  return {"mask_distance", DType::f32, {info.shape.views, info.shape.height, info.shape.width}};
}

void get_mask_distance(const SafetensorsFile& file, BtfInfo& info) {
  info.mask_distance.clear();
  if (file.find("mask_distance") == nullptr) return;
  const TensorInfo& tensor =
      checked_tensor(file, "mask_distance", DType::f32, mask_distance_tensor(info).shape);
  info.mask_distance.resize(tensor.bytes() / sizeof(float));
  std::memcpy(info.mask_distance.data(), file.data(tensor).data(), tensor.bytes());
  validate(info, file.path().string());
}

void check_format_version(const SafetensorsFile& file, std::string_view newest) {
  const std::string_view found = file.value("weft.format");
  const auto known = [&](std::string_view version) {
    return version.size() == 1 && version >= file_format_version && version <= newest;
  };
  if (found.empty() || known(found)) return;
  const bool number =
      std::all_of(found.begin(), found.end(), [](char c) { return c >= '0' && c <= '9'; });
  if (!number) {
    fail_input("{}: metadata \"weft.format\": \"{}\" is no version", file.path().string(),
               shown(found));
  }
  fail_input(
      "{}: weft.format {} (written by version {}) is not read by this version, which reads {}",
      file.path().string(), shown(found), shown(file.value("weft.version")),
      newest == file_format_version ? std::string(newest)
                                    : fmt::format("{} to {}", file_format_version, newest));
}

}  // namespace weft
