// Ranks of modes as options say them.
#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

#include "weft/btf/mode_groups.hpp"
#include "weft/codecs/codec.hpp"

namespace weft {

// A parameter's value as text, its default where it is not given.
std::string_view value_of(const Codec& codec, const Parameters& parameters, std::string_view name);

// "v=61,l=27": the ranks that are named; 0 for other modes. Throws input errors that name --ranks
// and the value.
std::vector<std::size_t> named_ranks(const ModeGroups& groups, std::string_view text);

// "v":61,"l":27
std::string ranks_json(const ModeGroups& groups, std::span<const std::size_t> ranks);

}  // namespace weft
