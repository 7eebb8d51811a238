// Writing a model: its real-valued tensors as F32, or as F16 beside their scales.
#include <algorithm>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/btf_tensors.hpp"
#include "weft/model/component_scale.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/model_metadata.hpp"

namespace weft {
namespace {

// The tensors of the file, as planned before a value is looked at.
struct Plan {
  std::vector<TensorInfo> tensors;
  Metadata metadata;
  Checksums checksums;  // of the right length, to be filled in
};

bool stored_as_half(const ModelTensor& tensor, Storage storage) {
  return tensor.dtype == DType::f32 && tensor.storage.value_or(storage) == Storage::f16;
}

Plan plan_of(const Model& model, const std::string& where) {
  Plan plan;
  plan.metadata = model_metadata(model.info, where);
  for (const ModelTensor& tensor : model.tensors()) {
    TensorInfo info{tensor.name, tensor.dtype, tensor.shape};
    if (tensor.values.size() != info.bytes()) {
      fail_runtime("{}: tensor \"{}\": {} bytes for shape {}", where, tensor.name,
                   tensor.values.size(), shape_text(tensor.shape));
    }
    if (stored_as_half(tensor, model.info.storage)) {
      info.dtype = DType::f16;
      const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
      plan.tensors.push_back({tensor.name + ".scale", DType::f32, {layout.components}});
    }
    plan.tensors.push_back(std::move(info));
  }
  for (TensorInfo& tensor : btf_side_tensors(model.info.btf)) {
    plan.tensors.push_back(std::move(tensor));
  }
  for (const TensorInfo& tensor : plan.tensors) plan.checksums[tensor.name] = checksum_of({});
  plan.metadata["checksums"] = checksums_json(plan.checksums);
  return plan;
}

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

}  // namespace

std::size_t write_model(const std::filesystem::path& path, const Model& model) {
  const std::string where = path.string();
  validate(model.info.btf, where);
  Plan plan = plan_of(model, where);
  SafetensorsWriter writer(path, plan.tensors, plan.metadata);
  const auto write = [&](const std::string& name, std::span<const std::byte> bytes) {
    writer.write(name, 0, bytes);
    plan.checksums[name] = checksum_of(bytes);
  };
  // A tensor may be most of what memory holds: its halves are made a block at a time.
  const auto write_halves = [&](const ModelTensor& tensor, std::span<const float> values) {
    constexpr std::size_t block = std::size_t{1} << 20;
    const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
    const std::vector<float> scales = component_scales(values, layout);
    write(tensor.name + ".scale", std::as_bytes(std::span(scales)));
    std::vector<std::uint16_t> halves(std::min(block, values.size()));
    Checksum checksum;
    for (std::size_t first = 0; first < values.size(); first += block) {
      const std::size_t count = std::min(block, values.size() - first);
      to_scaled_half(values.subspan(first, count), layout, scales, halves, first);
      const auto bytes = std::as_bytes(std::span<const std::uint16_t>(halves).first(count));
      writer.write(tensor.name, first * sizeof(std::uint16_t), bytes);
      checksum.add(bytes);
    }
    plan.checksums[tensor.name] = checksum.text();
  };

  for (const ModelTensor& tensor : model.tensors()) {
    if (is_float(tensor.dtype)) {
      const std::span<const float> values = checked_values(tensor, where);
      if (stored_as_half(tensor, model.info.storage)) {
        write_halves(tensor, values);
        continue;
      }
    }
    write(tensor.name, tensor.values);
  }
  for (const TensorInfo& tensor : btf_side_tensors(model.info.btf)) {
    write(tensor.name, btf_side_values(model.info.btf, tensor.name));
  }

  writer.set_metadata("checksums", checksums_json(plan.checksums));
  writer.finish();
  return writer.file_size();
}

std::size_t model_file_size(const Model& model) {
  Plan plan = plan_of(model, "model");
  return safetensors_file_size(std::move(plan.tensors), std::move(plan.metadata));
}

}  // namespace weft
