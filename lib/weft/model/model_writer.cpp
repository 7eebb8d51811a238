// Writing a model: its real-valued tensors as F32, as F16 beside their scales, or entropy-coded
// beside the steps of their quantisation.
#include "weft/model/model_writer.hpp"

#include <algorithm>
#include <functional>
#include <map>
#include <optional>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/btf_tensors.hpp"
#include "weft/model/coded_tensor.hpp"
#include "weft/model/component_scale.hpp"
#include "weft/model/file_sizer.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/model_metadata.hpp"
#include "weft/model/occlusion_metadata.hpp"
#include "weft/model/quantise.hpp"

namespace weft {
namespace {

// The tensors of the file. Values are not looked at, but where they are entropy-coded.
struct Plan {
  std::vector<TensorInfo> tensors;
  Metadata metadata;
  Checksums checksums;  // of the right length, to be filled in
  std::map<std::string, CodedBlob, std::less<>> coded;
};

// The values of a real-valued tensor. Throws if one is not finite: no reader would take it.
std::span<const float> checked_values(const ModelTensor& tensor, const std::string& where) {
  const std::span<const float> values(reinterpret_cast<const float*>(tensor.values.data()),
                                      tensor.values.size() / sizeof(float));
  for (std::size_t i = 0; i < values.size(); ++i) {
    // x - x is NaN for an infinity and for NaN.
    if (values[i] - values[i] != 0) {
      fail_runtime("{}: tensor \"{}\": value {} at index {} is not finite", where, tensor.name,
                   values[i], i);
    }
  }
  return values;
}

// What the metadata say of a blob: indices that get smaller by less stay as they are.
constexpr std::size_t entry_bytes = 96;

// A quantised tensor; of a model that has some, also indices that get smaller.
std::optional<CodedBlob> coded_blob(const ModelTensor& tensor, const ModelInfo& info,
                                    const std::string& where) {
  if (tensor.dtype == DType::f32) {
    const auto found = info.quantised.find(tensor.name);
    if (found == info.quantised.end()) return std::nullopt;
    const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
    const std::string name = fmt::format("{}: tensor \"{}\"", where, tensor.name);
    return encode_quantised(tensor, found->second.bits,
                            codes_of(checked_values(tensor, where), layout, found->second, name));
  }
  if (is_float(tensor.dtype) || info.quantised.empty()) return std::nullopt;
  CodedBlob blob = encode_indices(tensor);
  if (blob.bytes.size() + entry_bytes > tensor.values.size()) return std::nullopt;
  return blob;
}

// The mask as bits, where that is smaller.
std::optional<CodedBlob> coded_mask(const BtfInfo& info) {
  if (info.mask.size() <= entry_bytes) return std::nullopt;
  CodedBlob blob = encode_bits({"mask",
                                {info.shape.views, info.shape.height, info.shape.width},
                                DType::u8,
                                std::as_bytes(std::span(info.mask))});
  if (blob.bytes.size() + entry_bytes > info.mask.size()) return std::nullopt;
  return blob;
}

// The model itself, and that of its mask.
std::vector<FilePart> parts_of(const Model& model, const std::string& where) {
  std::vector<FilePart> parts{{&model, "", true, nullptr}};
  if (const Occlusion* occlusion = model.info.occlusion.get()) {
    const BtfShape wanted = occlusion_info(model.info.btf).shape;
    if (!model.info.btf.mask.empty() || occlusion->model->info.btf.shape != wanted) {
      fail_runtime("{}: the model of the mask is not one of what is written", where);
    }
    parts.push_back(
        {occlusion->model.get(), std::string(occlusion_prefix), false, model.info.occlusion});
  }
  return parts;
}

std::string name_in_file(const FilePart& part, const std::string& tensor) {
  return part.prefix + tensor;
}

bool stored_as_half(const ModelTensor& tensor, Storage storage) {
  return tensor.dtype == DType::f32 && tensor.storage.value_or(storage) == Storage::f16;
}

void plan_tensors(const FilePart& part, const std::string& where, Plan& plan) {
  const ModelInfo& info = part.model->info;
  for (const ModelTensor& tensor : part.model->tensors()) {
    const std::string name = name_in_file(part, tensor.name);
    TensorInfo planned{name, tensor.dtype, tensor.shape};
    if (tensor.values.size() != planned.bytes()) {
      fail_runtime("{}: tensor \"{}\": {} bytes for shape {}", where, name, tensor.values.size(),
                   shape_text(tensor.shape));
    }
    if (std::optional<CodedBlob> blob = coded_blob(tensor, info, where)) {
      planned.dtype = DType::u8;
      planned.shape = {blob->bytes.size()};
      if (tensor.dtype == DType::f32) {
        const std::size_t components = info.quantised.at(tensor.name).steps.size();
        plan.tensors.push_back({name + ".step", DType::f32, {components}});
      }
      plan.coded.emplace(name, std::move(*blob));
    } else if (stored_as_half(tensor, info.storage)) {
      planned.dtype = DType::f16;
      const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
      plan.tensors.push_back({name + ".scale", DType::f32, {layout.components}});
    }
    plan.tensors.push_back(std::move(planned));
  }
}

// The mask and the model of a mask that were met last, and what was made of them.
struct CodedMasks {
  std::vector<std::uint8_t> values;
  std::optional<CodedBlob> packed;
  std::shared_ptr<const Occlusion> occlusion;
  Plan of_occlusion;
  std::size_t coded = 0;

  const std::optional<CodedBlob>& of(const BtfInfo& info) {
    if (info.mask != values) {
      packed = coded_mask(info);
      values = info.mask;
      ++coded;
    }
    return packed;
  }

  const Plan& of(const FilePart& part, const std::string& where) {
    if (part.occlusion != occlusion) {
      of_occlusion = Plan();
      plan_tensors(part, where, of_occlusion);
      occlusion = part.occlusion;
      ++coded;
    }
    return of_occlusion;
  }
};

Metadata metadata_of(const Model& model, const std::string& where) {
  Metadata metadata = model_metadata(model.info, where);
  if (const Occlusion* occlusion = model.info.occlusion.get()) {
    metadata["occlusion"] = occlusion_json(*occlusion, where);
    metadata["weft.format"] = mask_format_version;
  }
  return metadata;
}

Plan plan_of(std::span<const FilePart> parts, Metadata metadata, const std::string& where,
             CodedMasks& masks) {
  Plan plan;
  plan.metadata = std::move(metadata);
  // versions are single digits
  const auto at_least = [&](const char* version) {
    std::string& format = plan.metadata["weft.format"];
    format = std::max<std::string>(format, version);
  };
  for (const FilePart& part : parts) {
    if (!part.occlusion) {
      plan_tensors(part, where, plan);
      continue;
    }
    const Plan& of_mask = masks.of(part, where);
    plan.tensors.insert(plan.tensors.end(), of_mask.tensors.begin(), of_mask.tensors.end());
    plan.coded.insert(of_mask.coded.begin(), of_mask.coded.end());
  }
  if (!plan.coded.empty()) at_least(coded_format_version);
  for (const FilePart& part : parts) {
    if (!part.with_directions) continue;
    const BtfInfo& info = part.model->info.btf;
    std::optional<CodedBlob> mask = masks.of(info);
    for (TensorInfo& tensor : btf_side_tensors(info)) {
      if (tensor.name == "mask" && mask) tensor.shape = {mask->bytes.size()};
      tensor.name = name_in_file(part, tensor.name);
      plan.tensors.push_back(std::move(tensor));
    }
    if (!mask) continue;
    plan.coded.emplace(name_in_file(part, "mask"), std::move(*mask));
    at_least(mask_format_version);
  }
  for (const TensorInfo& tensor : plan.tensors) plan.checksums[tensor.name] = checksum_of({});
  plan.metadata["checksums"] = checksums_json(plan.checksums);
  if (!plan.coded.empty()) {
    CodedTensors coded;
    for (const auto& [name, blob] : plan.coded) coded[name] = blob.tensor;
    plan.metadata["coded"] = coded_json(coded);
  }
  return plan;
}

}  // namespace

std::size_t write_parts(const std::filesystem::path& path, std::span<const FilePart> parts,
                        Metadata metadata) {
  const std::string where = path.string();
  CodedMasks masks;
  Plan plan = plan_of(parts, std::move(metadata), where, masks);
  SafetensorsWriter writer(path, plan.tensors, plan.metadata);
  const auto write = [&](const std::string& name, std::span<const std::byte> bytes) {
    writer.write(name, 0, bytes);
    plan.checksums[name] = checksum_of(bytes);
  };
  // A tensor may be most of what memory holds: its halves are made a block at a time.
  const auto write_halves = [&](const ModelTensor& tensor, const std::string& name,
                                std::span<const float> values) {
    constexpr std::size_t block = std::size_t{1} << 20;
    const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
    const std::vector<float> scales = component_scales(values, layout);
    write(name + ".scale", std::as_bytes(std::span(scales)));
    std::vector<std::uint16_t> halves(std::min(block, values.size()));
    Checksum checksum;
    for (std::size_t first = 0; first < values.size(); first += block) {
      const std::size_t count = std::min(block, values.size() - first);
      to_scaled_half(values.subspan(first, count), layout, scales, halves, first);
      const auto bytes = std::as_bytes(std::span<const std::uint16_t>(halves).first(count));
      writer.write(name, first * sizeof(std::uint16_t), bytes);
      checksum.add(bytes);
    }
    plan.checksums[name] = checksum.text();
  };
  const auto write_tensor = [&](const FilePart& part, const ModelTensor& tensor) {
    const ModelInfo& info = part.model->info;
    const std::string name = name_in_file(part, tensor.name);
    if (const auto coded = plan.coded.find(name); coded != plan.coded.end()) {
      const auto quantised = info.quantised.find(tensor.name);
      if (quantised != info.quantised.end()) {
        write(name + ".step", std::as_bytes(std::span(quantised->second.steps)));
      }
      write(name, coded->second.bytes);
      return;
    }
    if (is_float(tensor.dtype)) {
      const std::span<const float> values = checked_values(tensor, where);
      if (stored_as_half(tensor, info.storage)) {
        write_halves(tensor, name, values);
        return;
      }
    }
    write(name, tensor.values);
  };

  for (const FilePart& part : parts) {
    for (const ModelTensor& tensor : part.model->tensors()) write_tensor(part, tensor);
    if (!part.with_directions) continue;
    const BtfInfo& info = part.model->info.btf;
    for (const TensorInfo& tensor : btf_side_tensors(info)) {
      const std::string name = name_in_file(part, tensor.name);
      const auto coded = plan.coded.find(name);
      write(name, coded != plan.coded.end() ? std::span<const std::byte>(coded->second.bytes)
                                            : btf_side_values(info, tensor.name));
    }
  }

  writer.set_metadata("checksums", checksums_json(plan.checksums));
  writer.finish();
  return writer.file_size();
}

std::size_t parts_size(std::span<const FilePart> parts, Metadata metadata) {
  CodedMasks masks;
  Plan plan = plan_of(parts, std::move(metadata), "model", masks);
  return safetensors_file_size(std::move(plan.tensors), std::move(plan.metadata));
}

std::size_t part_bytes(const FilePart& part) {
  CodedMasks masks;
  const Plan plan = plan_of({&part, 1}, {}, "model", masks);
  std::size_t bytes = 0;
  for (const TensorInfo& tensor : plan.tensors) bytes += tensor.bytes();
  return bytes;
}

std::size_t write_model(const std::filesystem::path& path, const Model& model) {
  const std::string where = path.string();
  validate(model.info.btf, where);
  return write_parts(path, parts_of(model, where), metadata_of(model, where));
}

std::size_t occlusion_tensor_bytes(const Occlusion& occlusion) {
  return part_bytes({occlusion.model.get(), std::string(occlusion_prefix), false, nullptr});
}

std::size_t model_file_size(const Model& model) {
  return FileSizer().size(model);
}

struct FileSizer::Masks : CodedMasks {};

FileSizer::FileSizer() : masks_(std::make_unique<Masks>()) {}
FileSizer::~FileSizer() = default;

std::size_t FileSizer::size(const Model& model) {
  Plan plan = plan_of(parts_of(model, "model"), metadata_of(model, "model"), "model", *masks_);
  return safetensors_file_size(std::move(plan.tensors), std::move(plan.metadata));
}

ErrorReport longest_errors(bool weighted) {
  constexpr double long_number = -1.7976931348623157e-300;
  ErrorReport longest;
  longest.rmse = longest.peak = longest.psnr = longest.snr = long_number;
  longest.relative = longest.max_error = long_number;
  longest.ssim = long_number;
  longest.log = LogErrorReport{long_number, long_number, long_number};
  if (weighted) {
    longest.weighted = WeightedErrorReport{long_number, long_number, long_number, long_number};
  }
  return longest;
}

std::size_t FileSizer::size_with_errors(Model& model) {
  const ErrorReport longest = longest_errors(!model.info.weights.empty());
  const std::optional<ErrorReport> kept = std::exchange(model.info.errors, longest);
  const std::size_t bytes = size(model);
  model.info.errors = kept;
  return bytes;
}

std::size_t FileSizer::coded_masks() const {
  return masks_->coded;
}

}  // namespace weft
