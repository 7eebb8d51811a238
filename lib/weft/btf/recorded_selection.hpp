// Models of a part of a BTF keep the numbers of the whole: a view, a light, a channel or a texel is
// called the same whether the BTF or a model of a part of it is asked.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/selection.hpp"

namespace weft {

// A selection as a model records it: with the sizes of what it selects from, where they are known.
struct RecordedSelection : Selection {
  std::optional<BtfShape> of;
};

// As metadata of a model: a JSON object with the parts that are set.
std::string to_json(const RecordedSelection& selection);
// The inverse. Throws an input error that names `where` for text that to_json did not make.
RecordedSelection recorded_from_json(std::string_view text, std::string_view where);

// For people: "views 0-48 of 81; lights 3,7; region 64,0,128x128 of 256 x 256; level 1", or "all".
std::string to_text(const RecordedSelection& selection);
// "0-4,8,10": runs of numbers that follow each other; of more than `runs` runs only the first.
std::string ranges_text(std::span<const std::size_t> numbers, std::size_t runs = 8);

// What is held of a BTF, in its numbers: entry i of a list is the number of index i.
struct HeldPart {
  std::optional<BtfShape> whole;  // the BTF's sizes, where they are known
  std::vector<std::size_t> views;
  std::vector<std::size_t> lights;
  std::vector<std::size_t> channels;
  Region region;          // in the BTF's texels
  std::size_t level = 0;  // of which the texels held are this mip level
};

// What `info` holds where `recorded` of a BTF gave it. Throws an input error that names `where` if
// the two do not fit.
HeldPart held_part(const BtfInfo& info, const RecordedSelection& recorded, std::string_view where);

// The selection of the BTF that gives the same as `recorded` and then `part`, which counts in what
// `info` holds and fits it. Throws as held_part.
RecordedSelection composed(const BtfInfo& info, const RecordedSelection& recorded,
                           const Selection& part, std::string_view where);

}  // namespace weft
