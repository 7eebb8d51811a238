// The three ways of streamed_svd.hpp, each of the same promise.
#pragma once

#include <cstddef>

#include "weft/codecs/streamed_svd.hpp"
#include "weft/codecs/svd_projection.hpp"
#include "weft/ops/tsqr.hpp"

namespace weft {

// All of X's directions, without a product with them: from X^T X in one pass, and from R.
Spectrum gram_spectrum(Device& device, PanelStream& stream, Job& job);
Spectrum qr_spectrum(Device& device, PanelStream& stream, ops::Tsqr::Workspace workspace, Job& job);

StreamedSvd svd_gram(Device& device, PanelStream& stream, const SvdTarget& target, Job& job);
StreamedSvd svd_qr(Device& device, PanelStream& stream, const SvdTarget& target, Job& job);
StreamedSvd svd_randomized(Device& device, PanelStream& stream, const SvdTarget& target, Job& job);

// Columns of the first block of svd_randomized.
std::size_t randomized_block(const Device& device, const StreamShape& shape,
                             const SvdTarget& target);

}  // namespace weft
