// Captures whose images are named by their directions: UBO2003 and ATRIUM folders and zips, UTIA's
// underscored form, and the image folders that this library writes.
#pragma once

#include <memory>

#include "weft/io/image_source.hpp"

namespace weft {

// Whether any image is named by its directions.
bool has_ubo_names(const ImageCollection& collection);

// Directions come from the names (see ubo_names.hpp) and are sorted by theta, then phi. Every view
// has every light exactly once; missing and repeated pairs are input errors that name them, as are
// angles beyond [0, 90] x [0, 360]. 8-bit images are taken as gamma 2.2, EXR as linear; images
// without directions in their names are returned as ignored.
Capture open_ubo2003(std::shared_ptr<ImageCollection> collection);

}  // namespace weft
