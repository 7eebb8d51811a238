// A larger texture of the same material: the planar index of nested code-books, synthesised by
// patches of itself (Havran et al., section 5.1). Code-books stay as they are.
#pragma once

#include <memory>

#include "weft/model/vq.hpp"
#include "weft/reference/patch_synthesis.hpp"

namespace weft::reference {

// Of request.height x request.width texels. Texels are compared by what they look like in up to
// nine pairs of directions, which are spread over those of the model. Masks follow the texels; the
// record of a selection and measured errors, which are of the original, do not.
std::unique_ptr<VqModel> enlarge(const VqModel& model, const PatchRequest& request);

}  // namespace weft::reference
