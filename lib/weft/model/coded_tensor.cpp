#include "weft/model/coded_tensor.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/safetensors.hpp"
#include "weft/model/quantise.hpp"

namespace weft {
namespace {

using nlohmann::json;

NumberType number_type(DType dtype) {
  return dtype == DType::f32 ? NumberType{2, true} : NumberType{size_of(dtype), false};
}

// Neighbours along an axis of a tensor whose component axis, if it has one, has become the first.
Neighbours neighbours_of(const CodedTensor& tensor, std::size_t component_axis) {
  if (!tensor.along) return {};
  Neighbours neighbours;
  for (std::size_t i = *tensor.along + 1; i < tensor.shape.size(); ++i) {
    if (i != component_axis) neighbours.stride *= tensor.shape[i];
  }
  neighbours.size = tensor.shape[*tensor.along];
  return neighbours;
}

// Of each layout with differences along no axis and along each: the first numbers decide.
CodedBlob smallest(const ModelTensor& tensor, unsigned bits,
                   std::span<const std::int32_t> numbers) {
  constexpr std::size_t most_tried = std::size_t{1} << 19;
  const NumberType type = number_type(tensor.dtype);
  const std::size_t tried = std::min(numbers.size(), most_tried);
  const auto coded = [&](CodedTensor how, std::size_t count) {
    const Neighbours neighbours = neighbours_of(how, tensor.component_axis);
    std::vector<std::byte> bytes = entropy_code(numbers.first(count), type, how.layout, neighbours);
    return CodedBlob{std::move(how), std::move(bytes)};
  };
  std::optional<CodedBlob> best;
  const auto attempt = [&](CodeLayout layout, std::optional<std::size_t> along) {
    CodedBlob blob = coded({tensor.dtype, tensor.shape, bits, layout, along}, tried);
    if (!best || blob.bytes.size() < best->bytes.size()) best = std::move(blob);
  };
  for (const CodeLayout layout : {CodeLayout::planes, CodeLayout::classes}) {
    if (layout == CodeLayout::classes && !type.is_signed) continue;
    attempt(layout, std::nullopt);
    for (std::size_t axis = 0; axis < tensor.shape.size(); ++axis) {
      if (axis != tensor.component_axis && tensor.shape[axis] > 1) attempt(layout, axis);
    }
  }
  return tried == numbers.size() ? std::move(*best) : coded(best->tensor, numbers.size());
}

std::size_t count_field(const json& value, const std::string& where, const char* field) {
  if (!value.is_number_unsigned()) fail_input("{}: \"{}\" is no number", where, field);
  return value.get<std::size_t>();
}

CodedTensor read_tensor(const json& entry, const std::string& where) {
  if (!entry.is_object()) fail_input("{}: no JSON object", where);
  CodedTensor tensor;
  bool has_shape = false;
  bool has_layout = false;
  bool has_dtype = false;
  for (const auto& [key, value] : entry.items()) {
    if (key == "dtype") {
      const std::optional<DType> dtype =
          value.is_string() ? dtype_from_name(value.get<std::string>()) : std::nullopt;
      has_dtype =
          dtype == DType::f32 || dtype == DType::u8 || dtype == DType::u16 || dtype == DType::u32;
      if (!has_dtype) fail_input("{}: \"dtype\" is none of F32, U8, U16, U32", where);
      tensor.dtype = *dtype;
    } else if (key == "shape") {
      has_shape = value.is_array();
      std::size_t elements = 1;
      for (const json& size : value) {
        tensor.shape.push_back(count_field(size, where, "shape"));
        const std::size_t next = tensor.shape.back();
        if (next != 0 && elements > std::numeric_limits<std::uint32_t>::max() / next) {
          fail_input("{}: \"shape\" has too many values", where);
        }
        elements *= next;
      }
    } else if (key == "bits") {
      const std::size_t bits = count_field(value, where, "bits");
      if (bits < least_bits || bits > most_bits) {
        fail_input("{}: \"bits\": {} is not within {} to {}", where, bits, least_bits, most_bits);
      }
      tensor.bits = static_cast<unsigned>(bits);
    } else if (key == "layout") {
      const std::optional<CodeLayout> layout =
          value.is_string() ? code_layout_from_name(value.get<std::string>()) : std::nullopt;
      if (!layout) fail_input("{}: \"layout\" is none of planes, classes, bits", where);
      tensor.layout = *layout;
      has_layout = true;
    } else if (key == "along") {
      tensor.along = count_field(value, where, "along");
    } else {
      fail_input("{}: unknown field \"{}\"", where, shown(key));
    }
  }
  if (!has_dtype || !has_shape || !has_layout) {
    fail_input("{}: one of \"dtype\", \"shape\" and \"layout\" is missing", where);
  }
  const bool real = tensor.dtype == DType::f32;
  if (real != (tensor.bits != 0)) {
    fail_input("{}: \"bits\" belong to F32 and to nothing else", where);
  }
  if (!real && tensor.layout == CodeLayout::classes) {
    fail_input("{}: \"layout\": classes are of signed numbers", where);
  }
  if (tensor.layout == CodeLayout::bits && (tensor.dtype != DType::u8 || tensor.along)) {
    fail_input("{}: \"layout\": bits are of U8, and not along an axis", where);
  }
  if (tensor.along && *tensor.along >= tensor.shape.size()) {
    fail_input("{}: \"along\": {} is no axis of {}", where, *tensor.along,
               shape_text(tensor.shape));
  }
  return tensor;
}

}  // namespace

std::size_t CodedTensor::elements() const {
  return TensorInfo{"", dtype, shape}.elements();
}

CodedBlob encode_quantised(const ModelTensor& tensor, unsigned bits,
                           const std::vector<std::int32_t>& codes) {
  return smallest(tensor, bits, codes);
}

CodedBlob encode_indices(const ModelTensor& tensor) {
  const std::size_t bytes = size_of(tensor.dtype);
  std::vector<std::int32_t> indices(tensor.values.size() / bytes);
  for (std::size_t i = 0; i < indices.size(); ++i) {
    std::uint32_t index = 0;
    for (std::size_t b = bytes; b-- > 0;) {
      index = index << 8 | std::to_integer<std::uint32_t>(tensor.values[i * bytes + b]);
    }
    indices[i] = static_cast<std::int32_t>(index);
  }
  return smallest(tensor, 0, indices);
}

CodedBlob encode_bits(const ModelTensor& tensor) {
  std::vector<std::int32_t> numbers;
  numbers.reserve(tensor.values.size());
  for (const std::byte value : tensor.values) {
    numbers.push_back(std::to_integer<std::int32_t>(value));
  }
  const CodedTensor how{tensor.dtype, tensor.shape, 0, CodeLayout::bits, std::nullopt};
  return {how, entropy_code(numbers, number_type(tensor.dtype), how.layout, {})};
}

std::vector<std::int32_t> decode_numbers(const CodedTensor& tensor, std::size_t component_axis,
                                         std::span<const std::byte> blob, std::string_view where) {
  if (tensor.along && *tensor.along == component_axis) {
    fail_input("{}: differences along {}, the axis of its components", where, *tensor.along);
  }
  std::vector<std::int32_t> numbers =
      entropy_decode(blob, tensor.elements(), number_type(tensor.dtype), tensor.layout,
                     neighbours_of(tensor, component_axis), where);
  if (tensor.dtype != DType::f32) return numbers;
  const std::int32_t largest = largest_code(tensor.bits);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (numbers[i] < -largest || numbers[i] > largest) {
      fail_input("{}: code {} at index {} has more than {} bits", where, numbers[i], i,
                 tensor.bits);
    }
  }
  return numbers;
}

std::string coded_json(const CodedTensors& tensors) {
  json object = json::object();
  for (const auto& [name, tensor] : tensors) {
    json& entry = object[name];
    entry["dtype"] = name_of(tensor.dtype);
    entry["shape"] = tensor.shape;
    entry["layout"] = name_of(tensor.layout);
    if (tensor.bits != 0) entry["bits"] = tensor.bits;
    if (tensor.along) entry["along"] = *tensor.along;
  }
  return object.dump();
}

CodedTensors read_coded(std::string_view text, const std::string& where) {
  const json object = parse_json(text, where);
  if (!object.is_object()) fail_input("{}: no JSON object", where);
  CodedTensors tensors;
  for (const auto& [name, entry] : object.items()) {
    tensors[name] = read_tensor(entry, fmt::format("{}: \"{}\"", where, shown(name)));
  }
  return tensors;
}

}  // namespace weft
