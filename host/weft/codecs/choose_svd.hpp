// Which way of factorising serves a request: by goal and shape.
#pragma once

#include <string>

#include "weft/btf/tile.hpp"
#include "weft/codecs/btf_panels.hpp"
#include "weft/codecs/svd_options.hpp"
#include "weft/device/device.hpp"

namespace weft {

struct SvdChoice {
  SvdMethod method = SvdMethod::randomized;
  StreamedRows rows = StreamedRows::images;
  std::string reason;
  // Whether a small residual is to be met by qr instead: gram was taken before it was known.
  bool verify = false;
};

// Throws an input error for gram and qr beyond 4096 on the short side.
SvdChoice choose_svd(const Device& device, TileSource& source, const SvdOptions& options);

// Relative residual below which the Gram matrix may have lost directions: far above sqrt(eps).
double gram_safe_error(Arithmetic arithmetic);

}  // namespace weft
