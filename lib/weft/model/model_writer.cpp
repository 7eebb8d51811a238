// Writing a model: its real-valued tensors as F32, or as F16 beside their scales.
#include <cstring>
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
std::vector<float> checked_values(const ModelTensor& tensor, const std::string& where) {
  std::vector<float> values(tensor.values.size() / sizeof(float));
  if (!values.empty()) std::memcpy(values.data(), tensor.values.data(), tensor.values.size());
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

  for (const ModelTensor& tensor : model.tensors()) {
    if (is_float(tensor.dtype)) {
      const std::vector<float> values = checked_values(tensor, where);
      if (stored_as_half(tensor, model.info.storage)) {
        const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
        const std::vector<float> scales = component_scales(values, layout);
        std::vector<std::uint16_t> halves(values.size());
        to_scaled_half(values, layout, scales, halves);
        write(tensor.name + ".scale", std::as_bytes(std::span(scales)));
        write(tensor.name, std::as_bytes(std::span(halves)));
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
