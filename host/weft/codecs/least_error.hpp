// Of nested models, the one that errs least where each is stored in the same number of bytes. With
// more components an error falls at first, and rises again when too few bits are left for each.
#pragma once

#include <cstddef>
#include <functional>

#include "weft/codecs/nested_models.hpp"

namespace weft {

// The last model of at most so many numbers, or the first.
std::size_t last_within(const NestedModels& models, double values);

// The error of model i, as measured; infinite where it takes more bytes than there are.
using ErrorOfModel = std::function<double(std::size_t i)>;

// From model `start` on outwards, by ever more numbers or by ever fewer while the error falls, and
// then between those beside the least. No model is asked for twice. Model 0 where none is small
// enough.
std::size_t least_error(const NestedModels& models, std::size_t start, const ErrorOfModel& error);

}  // namespace weft
