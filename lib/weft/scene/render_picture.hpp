// A picture of a scene: camera rays, and what the material reflects where they meet it.
#pragma once

#include "weft/job.hpp"
#include "weft/scene/picture.hpp"
#include "weft/scene/ray_caster.hpp"
#include "weft/scene/shader.hpp"

namespace weft {

// Renders batches of pixels as large as the shader asks for and job.memory allows; the picture does
// not depend on it. Adds the stage "rays" to those of the shader, and advances "render" by pixels.
// Throws an input error where the plan exceeds job.memory, and `interrupted` if a stop was asked
// for.
Picture render_picture(const RayCaster& caster, Shader& shader, Job& job);

}  // namespace weft
