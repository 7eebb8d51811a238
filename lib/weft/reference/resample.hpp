// A BTF in other directions, in double: the reference of host/weft/codecs/resampled_source.cpp. See
// weft/btf/resampling.hpp for the formulas.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/btf/resampling.hpp"

namespace weft::reference {

// T'[v', l', i] of `view_count` new views from `first_view` on, [view_count][L'][n], of
// T[v, l, i] = values, [V][L][n].
std::vector<double> resample(const Resampling& resampling, std::size_t n,
                             std::span<const double> values, std::size_t first_view,
                             std::size_t view_count);

}  // namespace weft::reference
