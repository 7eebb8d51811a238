// Reading. Nothing is allocated before the container has shown that the bytes are there.
#include "weft/model/model_file.hpp"

#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <optional>

#include "weft/error.hpp"
#include "weft/io/btf_tensors.hpp"
#include "weft/io/json_text.hpp"
#include "weft/model/coded_tensor.hpp"
#include "weft/model/component_scale.hpp"
#include "weft/model/material_file.hpp"
#include "weft/model/model_metadata.hpp"
#include "weft/model/occlusion_metadata.hpp"
#include "weft/model/quantise.hpp"

namespace weft {
namespace {

constexpr std::string_view scale_suffix = ".scale";
constexpr std::string_view step_suffix = ".step";

std::string scale_name(std::string_view tensor) {
  return std::string(tensor) + std::string(scale_suffix);
}

std::string step_name(std::string_view tensor) {
  return std::string(tensor) + std::string(step_suffix);
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

using Quantisations = std::map<std::string, Quantisation, std::less<>>;

[[noreturn]] void reject(const SafetensorsFile& file, const std::string& why) {
  fail_input("{}: {}", file.path().string(), why);
}

CodedTensors coded_tensors(const SafetensorsFile& file) {
  const std::string_view format = file.value("weft.format");
  const bool required = format == coded_format_version;
  const bool may_have = format == mask_format_version || format == base_format_version;
  if (!required && (!may_have || file.metadata().count("coded") == 0)) return {};
  return read_coded(file.require("coded"),
                    fmt::format("{}: metadata \"coded\"", file.path().string()));
}

// Every blob is there and of U8, every quantised tensor has steps, and all steps are some tensor's.
Quantisations check_coded(const SafetensorsFile& file) {
  const CodedTensors coded = coded_tensors(file);
  Quantisations quantised;
  std::size_t values = 0;
  for (const auto& [name, tensor] : coded) {
    const TensorInfo& blob = file.get(name);
    if (blob.dtype != DType::u8 || blob.shape.size() != 1) {
      reject(file, fmt::format("tensor \"{}\": {} of shape {} instead of a list of U8", shown(name),
                               name_of(blob.dtype), shape_text(blob.shape)));
    }
    values += tensor.elements();  // at most 2^32 each, of fewer tensors than bytes in the header
    if (tensor.dtype != DType::f32) continue;
    const TensorInfo& steps = file.get(step_name(name));
    if (steps.dtype != DType::f32 || steps.shape.size() != 1) {
      reject(file, fmt::format("tensor \"{}\": {} of shape {} instead of a list of F32",
                               shown(steps.name), name_of(steps.dtype), shape_text(steps.shape)));
    }
    std::vector<float> list = copy_of<float>(file.data(steps));
    for (std::size_t i = 0; i < list.size(); ++i) {
      if (list[i] < 0) {
        reject(file, fmt::format("tensor \"{}\": value {} at index {} is negative",
                                 shown(steps.name), list[i], i));
      }
    }
    quantised[name] = {tensor.bits, std::move(list)};
  }
  const std::size_t bytes = file.file().bytes().size();
  // A blob of zeros holds thousands of values a byte; no model is made of those alone.
  const std::size_t most = (std::size_t{64} << 20) + 1024 * bytes;
  if (values > most) {
    reject(file, fmt::format("metadata \"coded\": {} values in a file of {} bytes are too many",
                             values, bytes));
  }
  for (const TensorInfo& tensor : file.tensors()) {
    if (!tensor.name.ends_with(step_suffix)) continue;
    if (!quantised.contains(
            std::string_view(tensor.name).substr(0, tensor.name.size() - step_suffix.size()))) {
      reject(file, fmt::format("tensor \"{}\": steps of no quantised tensor", shown(tensor.name)));
    }
  }
  return quantised;
}

// The numbers of a blob, after a check that the shape is what the codec wants.
std::vector<std::int32_t> decoded(const SafetensorsFile& file, std::string_view name,
                                  const CodedTensor& tensor, const std::vector<std::size_t>& shape,
                                  std::size_t component_axis) {
  if (tensor.shape != shape) {
    reject(file, fmt::format("tensor \"{}\": shape {} instead of {}", name,
                             shape_text(tensor.shape), shape_text(shape)));
  }
  return decode_numbers(tensor, component_axis, file.data(file.get(name)),
                        fmt::format("{}: tensor \"{}\"", file.path().string(), name));
}

// Every index is below the limit.
void check_limit(const SafetensorsFile& file, std::string_view name,
                 std::span<const std::uint32_t> indices, std::size_t limit) {
  for (std::size_t i = 0; i < indices.size(); ++i) {
    if (indices[i] >= limit) {
      reject(file, fmt::format("tensor \"{}\": {} at index {} is not below {}", name, indices[i], i,
                               limit));
    }
  }
}

// Those of a model whose tensors' names begin with a prefix, by the rest of their names.
Quantisations under_prefix(const Quantisations& all, std::string_view prefix) {
  Quantisations result;
  for (const auto& [name, quantisation] : all) {
    if (name.starts_with(prefix)) result[name.substr(prefix.size())] = quantisation;
  }
  return result;
}

}  // namespace

ModelFile::ModelFile(const std::filesystem::path& path)
    : file_(open_material(path)), info_(read_model_info(*file_)) {
  check_checksums(*file_);
  for (const TensorInfo& tensor : file_->tensors()) check_finite(*file_, tensor);
  check_scales(*file_);
  info_.quantised = check_coded(*file_);
  read_mask();
}

ModelFile::ModelFile(std::shared_ptr<const SafetensorsFile> file, ModelInfo info,
                     std::string_view prefix)
    : file_(std::move(file)), info_(std::move(info)), prefix_(prefix) {
  info_.quantised = under_prefix(check_coded(*file_), prefix_);
}

void ModelFile::read_mask() {
  if (coded_tensors(*file_).contains("mask")) {
    const BtfShape& shape = info_.btf.shape;
    const std::vector<std::uint32_t> bits =
        index_tensor("mask", {shape.views, shape.height, shape.width}, 2);
    info_.btf.mask.assign(bits.begin(), bits.end());
  } else {
    get_mask(*file_, info_.btf);
  }
  if (file_->metadata().count("occlusion") == 0) return;
  if (!info_.btf.mask.empty()) reject("tensor \"mask\": there is a model of the mask, too");
  const std::string where = fmt::format("{}: metadata \"occlusion\"", file_->path().string());
  occlusion_ = std::make_shared<Occlusion>(
      read_occlusion(file_->value("occlusion"), info_.btf, where).occlusion);
}

ModelFile ModelFile::occlusion_model() const {
  const std::string where = fmt::format("{}: metadata \"occlusion\"", file_->path().string());
  ModelInfo info = read_occlusion(file_->require("occlusion"), info_.btf, where).info;
  info.program_version = info_.program_version;
  return {file_, std::move(info), occlusion_prefix};
}

bool ModelFile::has(std::string_view name) const {
  return file_->find(prefix_ + std::string(name)) != nullptr;
}

std::vector<float> ModelFile::real_tensor(std::string_view tensor_name,
                                          const std::vector<std::size_t>& shape,
                                          std::size_t component_axis, Storage storage) const {
  const std::string name = prefix_ + std::string(tensor_name);
  const CodedTensors coded = coded_tensors(*file_);
  if (const auto found = coded.find(name); found != coded.end()) {
    const CodedTensor& blob = found->second;
    if (blob.dtype != DType::f32) {
      reject(fmt::format("tensor \"{}\": dtype {} instead of F32", name, name_of(blob.dtype)));
    }
    const ComponentLayout layout = component_layout(shape, component_axis);
    const std::vector<float>& steps = info_.quantised.find(tensor_name)->second.steps;
    if (blob.shape == shape && steps.size() != layout.components) {
      reject(fmt::format("tensor \"{}\": shape [{}] instead of [{}]", step_name(name), steps.size(),
                         layout.components));
    }
    std::vector<float> values =
        values_of(decoded(*file_, name, blob, shape, component_axis), layout, steps);
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (!std::isfinite(values[i])) {
        reject(
            fmt::format("tensor \"{}\": code at index {} times its step is not finite", name, i));
      }
    }
    return values;
  }
  const TensorInfo& tensor = file_->get(name);
  if (tensor.shape != shape) {
    reject(fmt::format("tensor \"{}\": shape {} instead of {}", name, shape_text(tensor.shape),
                       shape_text(shape)));
  }
  const DType stored = storage == Storage::f16 ? DType::f16 : DType::f32;
  if (tensor.dtype != stored) {
    reject(fmt::format("tensor \"{}\": dtype {} instead of {}", name, name_of(tensor.dtype),
                       name_of(stored)));
  }
  if (stored == DType::f32) return copy_of<float>(file_->data(tensor));

  const ComponentLayout layout = component_layout(shape, component_axis);
  const TensorInfo& scale = file_->get(scale_name(name));
  if (scale.shape != std::vector<std::size_t>{layout.components}) {
    reject(fmt::format("tensor \"{}\": shape {} instead of [{}]", scale.name,
                       shape_text(scale.shape), layout.components));
  }
  std::vector<float> values(tensor.elements());
  from_scaled_half(copy_of<std::uint16_t>(file_->data(tensor)), layout,
                   copy_of<float>(file_->data(scale)), values);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) {
      reject(
          fmt::format("tensor \"{}\": value at index {} times its scale is not finite", name, i));
    }
  }
  return values;
}

Storage ModelFile::storage_of(std::string_view tensor_name) const {
  const std::string name = prefix_ + std::string(tensor_name);
  if (coded_tensors(*file_).contains(name)) return info_.storage;
  return file_->get(name).dtype == DType::f16 ? Storage::f16 : Storage::f32;
}

std::vector<std::uint32_t> ModelFile::index_tensor(std::string_view tensor_name,
                                                   const std::vector<std::size_t>& shape,
                                                   std::size_t limit) const {
  const std::string name = prefix_ + std::string(tensor_name);
  const CodedTensors coded = coded_tensors(*file_);
  if (const auto found = coded.find(name); found != coded.end()) {
    const CodedTensor& blob = found->second;
    if (blob.dtype == DType::f32) {
      reject(fmt::format("tensor \"{}\": dtype F32 is none of U8, U16, U32", name));
    }
    const std::vector<std::int32_t> numbers =
        decoded(*file_, name, blob, shape, ModelTensor::no_component_axis);
    std::vector<std::uint32_t> indices(numbers.begin(), numbers.end());
    check_limit(*file_, name, indices, limit);
    return indices;
  }
  const TensorInfo& tensor = file_->get(name);
  if (tensor.shape != shape) {
    reject(fmt::format("tensor \"{}\": shape {} instead of {}", name, shape_text(tensor.shape),
                       shape_text(shape)));
  }
  if (is_float(tensor.dtype)) {
    reject(fmt::format("tensor \"{}\": dtype {} is none of U8, U16, U32", name,
                       name_of(tensor.dtype)));
  }
  const std::span<const std::byte> bytes = file_->data(tensor);
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
  }
  check_limit(*file_, name, indices, limit);
  return indices;
}

std::vector<std::size_t> ModelFile::shape_of(std::string_view tensor_name) const {
  const std::string name = prefix_ + std::string(tensor_name);
  const CodedTensors coded = coded_tensors(*file_);
  const auto found = coded.find(name);
  return found != coded.end() ? found->second.shape : file_->get(name).shape;
}

std::vector<std::size_t> tensor_shape(const ModelFile& file, std::string_view name) {
  return file.shape_of(name);
}

void ModelFile::reject(const std::string& why) const {
  fail_input("{}: {}", file_->path().string(), why);
}

bool ModelFile::looks_like(const std::filesystem::path& model) {
  const std::filesystem::path path = material_path(model).file;
  if (!SafetensorsFile::looks_like(path)) return false;
  // Metadata come first in our headers, the codec among the first of them: behind the checksums,
  // which are many in data bases.
  std::string first(std::size_t{1} << 20, '\0');
  std::ifstream stream(path, std::ios::binary);
  stream.read(first.data(), static_cast<std::streamsize>(first.size()));
  const std::string_view text(first.data(), static_cast<std::size_t>(stream.gcount()));
  return text.find("\"codec\":") != std::string_view::npos;
}

}  // namespace weft
