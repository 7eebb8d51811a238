// Models of masks (lib/weft/model/occlusion.hpp): fitted, measured and decoded, on a device or by
// the reference.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "weft/codecs/codec.hpp"
#include "weft/model/occlusion.hpp"
#include "weft/model/storage.hpp"

namespace weft {

struct OcclusionRequest {
  const Codec* codec = nullptr;
  Parameters parameters;
  StorageRequest storage;
  std::string target;  // a goal of the fit, as parse_goal takes it, or empty
  OcclusionKind kind = OcclusionKind::distance;
  VisibilityMapping mapping;
  // Distances are clipped to [-band, band]: where holes are small, texels far from any outline, and
  // views without one, would take most of what a model can spend.
  double band = 1;
  // Error texels that there may be: the goal is then a relative error, as large as they allow.
  std::optional<std::size_t> most_errors;
};

// The images [V][1][Y][X][1] that a model of a mask is fitted to: 0 and 1, or the signed distances,
// those of `info`, or the mask's own where it has none, clipped. Throws an input error without a
// mask.
std::shared_ptr<TileSource> occlusion_source(const BtfInfo& info, OcclusionKind kind,
                                             double band = 1);

// The model of the mask of `info`, by the reference if the device is null, with the error texels
// that were counted of it as it is stored. Throws what the codec throws, an input error where
// it takes no goals and most_errors is given, and an unmet goal.
std::shared_ptr<const Occlusion> compress_occlusion(Device* device, const BtfInfo& info,
                                                    const OcclusionRequest& request, Job& job);

// What a model of a mask decodes to, [V][Y][X].
std::vector<float> decode_occlusion(Device* device, const Occlusion& occlusion, Job& job);

// `info` with the mask that decoded values say, and with these, within [-1, 1], as its distances if
// they are such.
BtfInfo with_mask(BtfInfo info, OcclusionKind kind, std::vector<float> decoded);
// That of a model, with what the model of its mask decodes to, if it has one; else as it is.
BtfInfo with_decoded_mask(Device* device, const ModelInfo& info, Job& job);

// Memory that this takes on the device and the host, with what is made of the mask.
std::size_t decoded_mask_bytes(const ModelInfo& info);

// Bytes of the file that a model of a mask takes, at most.
std::size_t occlusion_file_size(const Occlusion& occlusion);

}  // namespace weft
