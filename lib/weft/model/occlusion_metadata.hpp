// What the metadata `occlusion` of a model file say of the model of its mask, a JSON object:
//
//   {"codec":"tt","of":"distance","parameters":{...},"storage":"f16","texels":1327104,
//    "error_texels":71,"threshold":0.05,"weight":12}
//
// Its tensors stand beside those of the model itself, with `occlusion.` in front of their names.
#pragma once

#include <string>
#include <string_view>

#include "weft/model/model.hpp"
#include "weft/model/occlusion.hpp"

namespace weft {

inline constexpr std::string_view occlusion_prefix = "occlusion.";

// Throws an input error that names `where` if a field can't be written.
std::string occlusion_json(const Occlusion& occlusion, const std::string& where);

// Bytes of its tensors as a file holds them; see model_writer.cpp.
std::size_t occlusion_tensor_bytes(const Occlusion& occlusion);

struct StoredOcclusion {
  Occlusion occlusion;  // without its model
  ModelInfo info;       // of its model, whose tensors are not looked at
};

// Of a model that decodes to `whole`. Throws input errors that name `where` and the field.
StoredOcclusion read_occlusion(std::string_view text, const BtfInfo& whole,
                               const std::string& where);

}  // namespace weft
