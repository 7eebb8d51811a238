#include "selection_options.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <utility>

#include "report.hpp"
#include "weft/btf/adapt.hpp"
#include "weft/btf/btf.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

std::string shape_text(const BtfShape& shape) {
  return fmt::format("[{},{},{},{},{}]", shape.views, shape.lights, shape.height, shape.width,
                     shape.channels);
}

}  // namespace

void add_selection_options(CLI::App& command, SelectionOptions& options) {
  command
      .add_option("--views", options.views,
                  "View directions: indices 0,3,8-11 or 0-80:4, conditions 'theta<=60', "
                  "theta=20..60, phi=30..120, cone=THETA/PHI/HALFANGLE (degrees), 'A&B' for what "
                  "both select, A,B for what either does")
      ->type_name("LIST")
      ->default_str("all")
      ->group("Selection");
  command.add_option("--lights", options.lights, "Light directions, in the same way")
      ->type_name("LIST")
      ->default_str("all")
      ->group("Selection");
  command
      .add_option("--region", options.region,
                  "Texel rectangle X,Y,WIDTHxHEIGHT of the full image, for example 64,0,128x128 "
                  "(row 0 is the top), or center:64x64")
      ->type_name("RECT")
      ->group("Selection");
  command
      .add_option("--channels", options.channels, "Colour channels by index or name: 0,2, or R,B")
      ->type_name("LIST")
      ->default_str("all")
      ->group("Selection");
  command
      .add_option("--level", options.level,
                  "Mip level: each level averages 2 x 2 texels in linear light; the finest there "
                  "is if not given")
      ->check(CLI::Range(0, 64))
      ->type_name("N")
      ->group("Selection");
}

std::vector<std::string> selection_arguments(const SelectionOptions& options) {
  std::vector<std::string> arguments;
  const auto add = [&](const char* option, const std::string& text) {
    if (text.empty()) return;
    arguments.emplace_back(option);
    arguments.push_back(text);
  };
  add("--views", options.views);
  add("--lights", options.lights);
  add("--region", options.region);
  add("--channels", options.channels);
  if (options.level) add("--level", fmt::format("{}", *options.level));
  return arguments;
}

RecordedSelection make_selection(const SelectionOptions& options, const BtfInfo& info) {
  return {parse_selection(options, info), info.shape};
}

ModelSelection make_selection(const SelectionOptions& options, const ModelInfo& model,
                              const std::string& file) {
  const std::string where = fmt::format("{}: metadata \"selection\"", file);
  const RecordedSelection recorded = recorded_from_json(model.selection, where);
  ModelSelection selection;
  selection.part = parse_selection(options, model.btf, held_part(model.btf, recorded, where), file);
  selection.whole = composed(model.btf, recorded, selection.part, where);
  return selection;
}

std::shared_ptr<TileSource> selected_part(std::shared_ptr<TileSource> input,
                                          const Selection& selection, bool nan_zero) {
  if (nan_zero && selection.level > 0) input = with_finite_values(std::move(input));
  return select(std::move(input), selection);
}

std::shared_ptr<const Model> at_held_level(std::shared_ptr<const Model> model, std::size_t& level) {
  const Codec& codec = find_codec(model->info.codec);
  for (; level > 0 && codec.holds_mip_level(*model); --level) model = codec.next_mip_level(*model);
  return model;
}

std::shared_ptr<const Model> selected_model(std::shared_ptr<const Model> model,
                                            const Selection& part, const std::string& file) {
  const Codec& codec = find_codec(model->info.codec);
  Selection stored = part;
  stored.level = 0;
  if (!stored.selects_all()) model = codec.select(*model, stored);
  for (std::size_t level = 0; level < part.level; ++level) {
    model = codec.next_mip_level(*model);
    if (!model) {
      fail_input(
          "--level: {}: mip levels of this model, of codec {}, are averages of decoded images: "
          "'weft decompress --level' makes them",
          file, codec.name());
    }
  }
  return model;
}

std::shared_ptr<TileSource> part_of_original(std::shared_ptr<TileSource> original,
                                             const std::string& file,
                                             const RecordedSelection& whole, const BtfShape& wanted,
                                             bool nan_zero) {
  const BtfShape& shape = original->info().shape;
  if (whole.of && *whole.of != shape) {
    fail_input("{}: [V,L,Y,X,C] of the BTF that the model was made of is {}, this one's is {}",
               file, shape_text(*whole.of), shape_text(shape));
  }
  const std::shared_ptr<TileSource> part = selected_part(std::move(original), whole, nan_zero);
  if (part->info().shape != wanted) {
    fail_input("{}: [V,L,Y,X,C] of the part that the model holds is {}, the model's is {}", file,
               shape_text(part->info().shape), shape_text(wanted));
  }
  return part;
}

std::string selected_source(const std::string& source, const RecordedSelection& selection) {
  if (selection.selects_all()) return source;
  return fmt::format("{}{}({})", source, source.empty() ? "" : " ", to_text(selection));
}

Cell selection_cell(const RecordedSelection& selection) {
  return {to_text(selection), to_json(selection)};
}

}  // namespace weft
