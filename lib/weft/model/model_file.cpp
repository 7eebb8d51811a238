// Reading. Nothing is allocated before the container has shown that the bytes are there.
#include "weft/model/model_file.hpp"

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <optional>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"
#include "weft/model/component_scale.hpp"
#include "weft/model/model_metadata.hpp"

namespace weft {
namespace {

constexpr std::string_view scale_suffix = ".scale";

std::string scale_name(std::string_view tensor) {
  return std::string(tensor) + std::string(scale_suffix);
}

// Values may be unaligned in a file that is not of ours.
template <typename T>
T element(std::span<const std::byte> bytes, std::size_t index) {
  T value;
  std::memcpy(&value, bytes.data() + index * sizeof(T), sizeof(T));
  return value;
}

template <typename T>
std::vector<T> copy_of(std::span<const std::byte> bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  if (!values.empty()) std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

// The first element whose exponent bits are all ones: an infinity or NaN.
template <typename T>
std::optional<std::size_t> first_not_finite(std::span<const std::byte> bytes, T exponent_bits) {
  for (std::size_t i = 0; i < bytes.size() / sizeof(T); ++i) {
    if ((element<T>(bytes, i) & exponent_bits) == exponent_bits) return i;
  }
  return std::nullopt;
}

void check_finite(const SafetensorsFile& file, const TensorInfo& tensor) {
  const std::span<const std::byte> bytes = file.data(tensor);
  std::optional<std::size_t> found;
  if (tensor.dtype == DType::f16) {
    found = first_not_finite<std::uint16_t>(bytes, 0x7c00);
  } else if (tensor.dtype == DType::f32) {
    found = first_not_finite<std::uint32_t>(bytes, 0x7f800000);
  } else if (tensor.dtype == DType::f64) {
    found = first_not_finite<std::uint64_t>(bytes, 0x7ff0000000000000);
  }
  if (found) {
    fail_input("{}: tensor \"{}\": value at index {} is not finite", file.path().string(),
               shown(tensor.name), *found);
  }
}

void check_checksums(const SafetensorsFile& file) {
  const std::string where = file.path().string();
  const Checksums checksums = read_checksums(file);
  for (const TensorInfo& tensor : file.tensors()) {
    const auto wanted = checksums.find(tensor.name);
    if (wanted == checksums.end()) {
      fail_input("{}: tensor \"{}\": no checksum", where, shown(tensor.name));
    }
    const std::string found = checksum_of(file.data(tensor));
    if (found != wanted->second) {
      fail_input("{}: tensor \"{}\": checksum {} instead of {}: the file is damaged", where,
                 shown(tensor.name), found, shown(wanted->second));
    }
  }
  for (const auto& [name, checksum] : checksums) {
    if (file.find(name) == nullptr) {
      fail_input("{}: metadata \"checksums\": no tensor \"{}\"", where, shown(name));
    }
  }
}

// Every F16 tensor has scales, every scale an F16 tensor, and scales are powers of two.
void check_scales(const SafetensorsFile& file) {
  const std::string where = file.path().string();
  for (const TensorInfo& tensor : file.tensors()) {
    if (tensor.dtype == DType::f16 && file.find(scale_name(tensor.name)) == nullptr) {
      fail_input("{}: tensor \"{}\" is F16 without \"{}\"", where, shown(tensor.name),
                 shown(scale_name(tensor.name)));
    }
    if (!tensor.name.ends_with(scale_suffix)) continue;
    const TensorInfo* scaled = file.find(
        std::string_view(tensor.name).substr(0, tensor.name.size() - scale_suffix.size()));
    if (scaled == nullptr || scaled->dtype != DType::f16) {
      fail_input("{}: tensor \"{}\" scales no F16 tensor", where, shown(tensor.name));
    }
    if (tensor.dtype != DType::f32 || tensor.shape.size() != 1) {
      fail_input("{}: tensor \"{}\": {} of shape {} instead of a list of F32", where,
                 shown(tensor.name), name_of(tensor.dtype), shape_text(tensor.shape));
    }
    for (std::size_t i = 0; i < tensor.shape[0]; ++i) {
      const float scale = element<float>(file.data(tensor), i);
      int exponent = 0;
      if (!(scale > 0) || std::frexp(scale, &exponent) != 0.5f) {
        fail_input("{}: tensor \"{}\": value {} at index {} is no power of two", where,
                   shown(tensor.name), scale, i);
      }
    }
  }
}

}  // namespace

ModelFile::ModelFile(const std::filesystem::path& path)
    : file_(path), info_(read_model_info(file_)) {
  check_checksums(file_);
  for (const TensorInfo& tensor : file_.tensors()) check_finite(file_, tensor);
  check_scales(file_);
}

std::vector<float> ModelFile::real_tensor(std::string_view name,
                                          const std::vector<std::size_t>& shape,
                                          std::size_t component_axis, Storage storage) const {
  const TensorInfo& tensor = file_.get(name);
  if (tensor.shape != shape) {
    reject(fmt::format("tensor \"{}\": shape {} instead of {}", name, shape_text(tensor.shape),
                       shape_text(shape)));
  }
  const DType stored = storage == Storage::f16 ? DType::f16 : DType::f32;
  if (tensor.dtype != stored) {
    reject(fmt::format("tensor \"{}\": dtype {} instead of {}", name, name_of(tensor.dtype),
                       name_of(stored)));
  }
  if (stored == DType::f32) return copy_of<float>(file_.data(tensor));

  const ComponentLayout layout = component_layout(shape, component_axis);
  const TensorInfo& scale = file_.get(scale_name(name));
  if (scale.shape != std::vector<std::size_t>{layout.components}) {
    reject(fmt::format("tensor \"{}\": shape {} instead of [{}]", scale.name,
                       shape_text(scale.shape), layout.components));
  }
  std::vector<float> values(tensor.elements());
  from_scaled_half(copy_of<std::uint16_t>(file_.data(tensor)), layout,
                   copy_of<float>(file_.data(scale)), values);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) {
      reject(
          fmt::format("tensor \"{}\": value at index {} times its scale is not finite", name, i));
    }
  }
  return values;
}

Storage ModelFile::storage_of(std::string_view name) const {
  return file_.get(name).dtype == DType::f16 ? Storage::f16 : Storage::f32;
}

std::vector<std::uint32_t> ModelFile::index_tensor(std::string_view name,
                                                   const std::vector<std::size_t>& shape,
                                                   std::size_t limit) const {
  const TensorInfo& tensor = file_.get(name);
  if (tensor.shape != shape) {
    reject(fmt::format("tensor \"{}\": shape {} instead of {}", name, shape_text(tensor.shape),
                       shape_text(shape)));
  }
  if (is_float(tensor.dtype)) {
    reject(fmt::format("tensor \"{}\": dtype {} is none of U8, U16, U32", name,
                       name_of(tensor.dtype)));
  }
  const std::span<const std::byte> bytes = file_.data(tensor);
  std::vector<std::uint32_t> indices(tensor.elements());
  for (std::size_t i = 0; i < indices.size(); ++i) {
    switch (tensor.dtype) {
      case DType::u8:
        indices[i] = element<std::uint8_t>(bytes, i);
        break;
      case DType::u16:
        indices[i] = element<std::uint16_t>(bytes, i);
        break;
      default:
        indices[i] = element<std::uint32_t>(bytes, i);
        break;
    }
    if (indices[i] >= limit) {
      reject(
          fmt::format("tensor \"{}\": {} at index {} is not below {}", name, indices[i], i, limit));
    }
  }
  return indices;
}

const std::vector<std::size_t>& ModelFile::shape_of(std::string_view name) const {
  return file_.get(name).shape;
}

void ModelFile::reject(const std::string& why) const {
  fail_input("{}: {}", file_.path().string(), why);
}

bool ModelFile::looks_like(const std::filesystem::path& path) {
  if (!SafetensorsFile::looks_like(path)) return false;
  // Metadata come first in our headers, the codec among the first of them.
  std::array<char, 65536> first{};
  std::ifstream stream(path, std::ios::binary);
  stream.read(first.data(), first.size());
  const std::string_view text(first.data(), static_cast<std::size_t>(stream.gcount()));
  return text.find("\"codec\":") != std::string_view::npos;
}

}  // namespace weft
