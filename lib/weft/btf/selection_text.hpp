// How a selection is written in options.
//
//   LIST      := PART { "," PART }      what any part selects, in the order of the parts
//   PART      := TERM { "&" TERM }      what all of its terms select, in the order of the first
//   TERM      := "all" | N | N-M | N-M:STEP | NAME (of a channel) | CONDITION (of directions)
//   CONDITION := theta<=T | theta<T | theta>=T | theta>T | theta=T | theta=A..B
//              | phi=A..B | cone=THETA/PHI/HALFANGLE
//   REGION    := X,Y,WIDTHxHEIGHT | center:WIDTHxHEIGHT
//
// Numbers count in the BTF that was measured, also where a model holds only a part of it. An index
// named twice by number is a slip; what a condition selects again is selected once. Degrees; bounds
// belong to what they bound, and reach 0.01 degrees further, more than what directions lose when
// they are written as float or with four decimals ("<" and ">" end as much before). phi=330..30
// goes by way of 0, and the zenith, which has no azimuth, is in every range of phi. A cone is what
// lies within HALFANGLE of a direction.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/recorded_selection.hpp"
#include "weft/btf/selection.hpp"

namespace weft {

// As given in options; what is empty or "all" selects everything, and no level is the finest held.
struct SelectionText {
  std::string views, lights, region, channels;
  std::optional<std::size_t> level;
};

// The selection of what `info` holds, counted in `info`, that the text means in the numbers of the
// BTF that it was made of: `held` says which these are, and `holder` who holds it ("cloth.weft"),
// for messages. Throws input errors that name the option, the part and the value: what is no list,
// is out of range, is not held, is repeated, selects nothing, or cuts texels of a mip level.
Selection parse_selection(const SelectionText& text, const BtfInfo& info, const HeldPart& held,
                          std::string_view holder);

// The same of a raw BTF, whose numbers are its own.
Selection parse_selection(const SelectionText& text, const BtfInfo& info);

}  // namespace weft
