// Errors of a decoded tile on a logarithmic scale: log_error_sums.cl.
#pragma once

#include "weft/metrics/log_errors.hpp"
#include "weft/ops/tile.hpp"

namespace weft::ops {

// Log errors of a decoded tile (float, [images][P][C]) against the raw one; `scale` is s. Waits for
// the device.
LogErrorSums log_error_sums(Device& device, const TileShape& tile, const Buffer& raw,
                            const Buffer& decoded, double scale);

}  // namespace weft::ops
