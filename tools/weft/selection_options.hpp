// The options that choose which part of a BTF a job reads.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "weft/btf/selection.hpp"

namespace CLI {
class App;
}

namespace weft {

// --views --lights --region --channels --level, as given; their limits are known only once the
// input is open.
struct SelectionOptions {
  std::string views, lights, region, channels;
  std::size_t level = 0;
};
void add_selection_options(CLI::App& command, SelectionOptions& options);
// The selection that the options mean for an input. Throws an input error that names the option.
Selection make_selection(const SelectionOptions& options, const BtfInfo& info);

// The selected part of an input. With `nan_zero`, values that a mip level averages are made finite
// before; without a level, that is left to the reader of the values, so that mapped input stays so.
std::shared_ptr<TileSource> selected_part(std::shared_ptr<TileSource> input,
                                          const Selection& selection, bool nan_zero);

}  // namespace weft
