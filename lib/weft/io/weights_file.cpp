#include "weft/io/weights_file.hpp"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/mapped_file.hpp"
#include "weft/io/npy.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

template <typename T>
T load(std::span<const std::byte> bytes, std::size_t i) {
  T value;
  std::memcpy(&value, bytes.data() + i * sizeof(T), sizeof(T));
  return value;
}

double value_at(DType dtype, std::span<const std::byte> bytes, std::size_t i) {
  switch (dtype) {
    case DType::u8:
      return load<std::uint8_t>(bytes, i);
    case DType::f16:
      return half_to_float(load<std::uint16_t>(bytes, i));
    case DType::f32:
      return load<float>(bytes, i);
    default:
      return load<double>(bytes, i);
  }
}

std::string shape_text(const std::vector<std::size_t>& shape) {
  std::string text;
  for (const std::size_t size : shape) text += fmt::format("{}{}", text.empty() ? "" : ", ", size);
  return "(" + text + (shape.size() == 1 ? ",)" : ")");
}

// "view 3", "row 2, column 5"
std::string place_of(const std::string& mode, const std::vector<std::size_t>& shape,
                     std::size_t i) {
  if (shape.size() == 2) return fmt::format("row {}, column {}", i / shape[1], i % shape[1]);
  return fmt::format("{} {}", mode.substr(0, mode.size() - 1), i);
}

std::vector<double> read_list(const std::string& part, const std::string& mode,
                              const std::filesystem::path& path,
                              const std::vector<std::size_t>& shape) {
  const NpyHeader header = read_npy_header(path);
  if (header.shape != shape) {
    fail_input("--weights {}: {}: shape {} instead of {}, one weight for each of the BTF's {}",
               part, path.string(), shape_text(header.shape), shape_text(shape), mode);
  }
  const MappedFile file(path);
  const std::span<const std::byte> bytes = file.bytes().subspan(header.data_offset);
  std::vector<double> weights(bytes.size() / size_of(header.dtype));
  bool any = false;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    weights[i] = value_at(header.dtype, bytes, i);
    if (!(weights[i] >= 0) || !(weights[i] <= most_weight) ||
        (weights[i] > 0 && weights[i] < least_weight)) {
      fail_input("--weights {}: {}: {} at {}: a weight is 0 or lies in [{:g}, {:g}]", part,
                 path.string(), weights[i], place_of(mode, shape, i), least_weight, most_weight);
    }
    any = any || weights[i] > 0;
  }
  if (!any) fail_input("--weights {}: {}: all {} have weight zero", part, path.string(), mode);
  return weights;
}

Weights read_part(const std::string& part, const BtfInfo& info) {
  if (part == "cos") return cosine_weights(info);
  const std::size_t equals = part.find('=');
  const std::string mode = part.substr(0, equals);
  const std::string path = equals == std::string::npos ? "" : part.substr(equals + 1);
  const BtfShape& shape = info.shape;
  Weights weights;
  if (!path.empty() && mode == "views") {
    weights.views = read_list(part, mode, path, {shape.views});
  } else if (!path.empty() && mode == "lights") {
    if (info.layout == Layout::paired) {
      fail_input("--weights {}: a paired BTF has no lights of its own; views are its pairs", part);
    }
    weights.lights = read_list(part, mode, path, {shape.lights});
  } else if (!path.empty() && mode == "texels") {
    weights.texels = read_list(part, mode, path, {shape.height, shape.width});
  } else {
    fail_input("--weights: '{}' is none of cos, views=FILE, lights=FILE, texels=FILE", part);
  }
  return weights;
}

std::vector<std::string> parts_of(std::string_view text) {
  std::vector<std::string> parts;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t comma = std::min(text.find(',', begin), text.size());
    parts.emplace_back(text.substr(begin, comma - begin));
    begin = comma + 1;
  }
  return parts;
}

std::string checksum_of(const Weights& weights) {
  XXH64_hash_t hash = 0;
  for (const std::vector<double>* list : {&weights.views, &weights.lights, &weights.texels}) {
    hash = XXH3_64bits_withSeed(list->data(), list->size() * sizeof(double), hash);
  }
  return fmt::format("{:016x}", hash);
}

std::string member(std::string_view json, const char* name, std::string_view where) {
  const nlohmann::json object = parse_json(json, where);
  const auto value = object.is_object() ? object.find(name) : object.end();
  if (value == object.end() || !value->is_string()) fail_input("{}: no text \"{}\"", where, name);
  return value->get<std::string>();
}

}  // namespace

Weights read_weights(std::string_view text, const BtfInfo& info) {
  Weights weights;
  std::vector<std::string> seen;
  for (const std::string& part : parts_of(text)) {
    const std::string kind = part.substr(0, part.find('='));
    if (std::find(seen.begin(), seen.end(), kind) != seen.end()) {
      fail_input("--weights {}: {} is given twice", text, kind);
    }
    seen.push_back(kind);
    weights = weights * read_part(part, info);
  }
  return weights;
}

std::string weights_json(std::string_view text, const Weights& weights) {
  std::string given;
  for (const std::string& part : parts_of(text)) {
    const std::size_t equals = part.find('=');
    if (!given.empty()) given += ",";
    given += equals == std::string::npos
                 ? part
                 : part.substr(0, equals + 1) +
                       std::filesystem::path(part.substr(equals + 1)).filename().string();
  }
  nlohmann::ordered_json object;
  object["given"] = given;
  object["checksum"] = checksum_of(weights);
  return object.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

std::string given_weights(std::string_view json, std::string_view where) {
  return member(json, "given", where);
}

bool are_given(const Weights& weights, std::string_view json, std::string_view where) {
  return checksum_of(weights) == member(json, "checksum", where);
}

}  // namespace weft
