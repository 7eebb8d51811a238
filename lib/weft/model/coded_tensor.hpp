// Entropy-coded tensors of a model file: U8 blobs, and what the metadata say of each.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "weft/model/entropy_code.hpp"
#include "weft/model/model.hpp"

namespace weft {

class ModelFile;

// What a blob holds. The numbers of a quantised tensor are in the order [components][outer][inner],
// indices in that of their tensor.
struct CodedTensor {
  DType dtype = DType::f32;        // F32: quantised; else the type of the indices
  std::vector<std::size_t> shape;  // of the tensor
  unsigned bits = 0;               // of the codes of a quantised tensor
  CodeLayout layout = CodeLayout::planes;
  std::optional<std::size_t> along;  // the axis of which differences are kept

  std::size_t elements() const;
};

using CodedTensors = std::map<std::string, CodedTensor, std::less<>>;

struct CodedBlob {
  CodedTensor tensor;
  std::vector<std::byte> bytes;
};

// The smallest of the codings of a tensor: quantised values with their codes, see codes_of, or
// indices. Deterministic.
CodedBlob encode_quantised(const ModelTensor& tensor, unsigned bits,
                           const std::vector<std::int32_t>& codes);
CodedBlob encode_indices(const ModelTensor& tensor);
// Of U8 numbers that are 0 or 1.
CodedBlob encode_bits(const ModelTensor& tensor);

// The numbers of a blob. Throws an input error that begins with `where` for what is wrong with it,
// or for a code of more than its bits.
std::vector<std::int32_t> decode_numbers(const CodedTensor& tensor, std::size_t component_axis,
                                         std::span<const std::byte> blob, std::string_view where);

// The metadata `coded`, a JSON object, both ways:
//   {"basis":{"along":3,"bits":8,"dtype":"F32","layout":"planes","shape":[32,41,41,3]}}
// Reading throws input errors that name `where` and the tensor: unknown or missing fields, bits
// outside 4 to 16, an axis that the shape has not, shapes whose product overflows.
std::string coded_json(const CodedTensors& tensors);
CodedTensors read_coded(std::string_view text, const std::string& where);

// Shape of a tensor of a file, of what a blob holds if it is one; throws an input error if it is
// not there.
std::vector<std::size_t> tensor_shape(const ModelFile& file, std::string_view name);

}  // namespace weft
