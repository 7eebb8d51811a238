// Shaders of raw BTFs and of models, on a device or by the reference: see weft/scene/shader.hpp.
#pragma once

#include <memory>
#include <optional>

#include "weft/device/device.hpp"
#include "weft/model/model.hpp"
#include "weft/scene/shader.hpp"

namespace weft {

// On the device, which must outlive it, or by the reference if `device` is null. A raw material,
// and the mip levels of a model whose codec has none of its own, lie in device memory as far as
// job.memory allows; the rest is streamed through it, once for each batch of points. Plans its
// memory first (job.plan). Throws the input errors of validate_material().
//
// Opacities are the interpolated mask; of a model whose mask a model stands for, they are found
// from what that decodes to, by its mapping. `mapping` takes that one's place, and finds the
// opacities of a raw material that has signed distances from these.
std::unique_ptr<Shader> make_shader(Device* device, std::shared_ptr<TileSource> raw, Job& job,
                                    std::optional<VisibilityMapping> mapping = {});
std::unique_ptr<Shader> make_shader(Device* device, std::shared_ptr<const Model> model, Job& job,
                                    std::optional<VisibilityMapping> mapping = {});

}  // namespace weft
