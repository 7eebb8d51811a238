#include "weft/model/storage.hpp"

#include "weft/model/component_scale.hpp"

namespace weft {

void round_to_storage(Model& model) {
  const std::vector<std::span<float>> values = model.real_values();
  std::size_t n = 0;
  for (const ModelTensor& tensor : model.tensors()) {
    if (tensor.dtype != DType::f32) continue;
    if (tensor.storage.value_or(model.info.storage) == Storage::f16) {
      round_to_scaled_half(values[n], component_layout(tensor.shape, tensor.component_axis));
    }
    ++n;
  }
}

}  // namespace weft
