// The options that choose which part of a BTF a job reads, or which part of a model it decodes.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "weft/btf/selection_text.hpp"
#include "weft/btf/tile.hpp"
#include "weft/model/model.hpp"

namespace CLI {
class App;
}

namespace weft {

struct Cell;

// --views --lights --region --channels --level, as given; their limits are known only once the
// input is open.
using SelectionOptions = SelectionText;
void add_selection_options(CLI::App& command, SelectionOptions& options);
// The same as arguments of a command line: of a process that selects as this one does.
std::vector<std::string> selection_arguments(const SelectionOptions& options);

// The selection that the options mean for a raw BTF. Throws an input error that names the option.
RecordedSelection make_selection(const SelectionOptions& options, const BtfInfo& info);

// Of a model, whose views, lights, channels and texels have the numbers of the BTF that it was made
// of. `part` counts in the model and selects of what it decodes to; `whole` is the same of that
// BTF. Throws an input error that names the option, or `file` where its record doesn't fit.
struct ModelSelection {
  Selection part;
  RecordedSelection whole;
};
ModelSelection make_selection(const SelectionOptions& options, const ModelInfo& model,
                              const std::string& file);

// The selected part of an input. With `nan_zero`, values that a mip level averages are made finite
// before; without a level, that is left to the reader of the values, so that mapped input stays so.
std::shared_ptr<TileSource> selected_part(std::shared_ptr<TileSource> input,
                                          const Selection& selection, bool nan_zero);

// The model of the level, as far as a model holds its levels; `level` becomes how many are left, to
// be averaged of decoded images.
std::shared_ptr<const Model> at_held_level(std::shared_ptr<const Model> model, std::size_t& level);

// The part of a model, whose levels beyond its own are averaged in the model itself. Throws an
// input error that names `file` where its codec averages decoded images instead.
std::shared_ptr<const Model> selected_model(std::shared_ptr<const Model> model,
                                            const Selection& part, const std::string& file);

// The part of a raw BTF that a model of it holds, of which `wanted` is the shape: `whole` is as of
// make_selection. Throws an input error that names `file`, the raw BTF's, if it is not what the
// model was made of.
std::shared_ptr<TileSource> part_of_original(std::shared_ptr<TileSource> original,
                                             const std::string& file,
                                             const RecordedSelection& whole, const BtfShape& wanted,
                                             bool nan_zero);

// What a raw BTF says of where its data came from, once only this selection of it is written.
std::string selected_source(const std::string& source, const RecordedSelection& selection);

// For a report: to_text for people, to_json for programs.
Cell selection_cell(const RecordedSelection& selection);

}  // namespace weft
