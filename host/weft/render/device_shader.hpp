// Shading on a device; make_shader() of weft/render/shade.hpp is the way to it.
#pragma once

#include <memory>

#include "weft/device/device.hpp"
#include "weft/model/model.hpp"
#include "weft/scene/shader.hpp"

namespace weft {

// Materials that validate_material() accepts, with opacities if they are not null. `info`: of the
// model, with its mask decoded.
std::unique_ptr<Shader> make_device_shader(Device& device, std::shared_ptr<TileSource> raw,
                                           const Opacity* opacity, Job& job);
std::unique_ptr<Shader> make_device_shader(Device& device, std::shared_ptr<const Model> model,
                                           const BtfInfo& info, const Opacity* opacity, Job& job);

}  // namespace weft
