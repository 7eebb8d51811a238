// The three ways of streamed_svd.hpp, each of the same promise.
#pragma once

#include <cstddef>

#include "weft/codecs/streamed_svd.hpp"

namespace weft {

StreamedSvd svd_gram(Device& device, PanelStream& stream, const SvdTarget& target, Job& job);
StreamedSvd svd_qr(Device& device, PanelStream& stream, const SvdTarget& target, Job& job);
StreamedSvd svd_randomized(Device& device, PanelStream& stream, const SvdTarget& target, Job& job);

// Columns of the first block of svd_randomized.
std::size_t randomized_block(const Device& device, const StreamShape& shape,
                             const SvdTarget& target);

}  // namespace weft
