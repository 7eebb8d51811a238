// Watches operator new: the largest single allocation since the last reset. A program that uses it
// replaces its global operator new by the one of largest_allocation.cpp.
#pragma once

#include <cstddef>

namespace weft::test {

void reset_largest_allocation();
std::size_t largest_allocation();

}  // namespace weft::test
