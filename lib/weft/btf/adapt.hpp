// Sources that show another source otherwise: with other labels, or in another dtype.
#pragma once

#include <memory>
#include <optional>

#include "weft/btf/tile.hpp"

namespace weft {

// The same values said to be of another encoding or quantity.
std::shared_ptr<TileSource> relabelled(std::shared_ptr<TileSource> source,
                                       std::optional<Encoding> encoding,
                                       std::optional<Quantity> quantity);

// The same values with 0 in place of NaN and infinities.
std::shared_ptr<TileSource> with_finite_values(std::shared_ptr<TileSource> source);

// The same values in another dtype, as convert_values() makes them; the encoding stays.
std::shared_ptr<TileSource> converted(std::shared_ptr<TileSource> source, DType dtype);

}  // namespace weft
