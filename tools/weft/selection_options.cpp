#include "selection_options.hpp"

#include <CLI/CLI.hpp>
#include <utility>

#include "weft/btf/adapt.hpp"
#include "weft/btf/btf.hpp"

namespace weft {

void add_selection_options(CLI::App& command, SelectionOptions& options) {
  command.add_option("--views", options.views, "View directions by index: 0,3,8-11, or all")
      ->type_name("LIST")
      ->default_str("all")
      ->group("Selection");
  command.add_option("--lights", options.lights, "Light directions by index: 0,3,8-11, or all")
      ->type_name("LIST")
      ->default_str("all")
      ->group("Selection");
  command
      .add_option("--region", options.region,
                  "Texel rectangle X,Y,WIDTHxHEIGHT of the full image, for example 64,0,128x128; "
                  "row 0 is the top")
      ->type_name("RECT")
      ->group("Selection");
  command.add_option("--channels", options.channels, "Colour channels by index: 0,2, or all")
      ->type_name("LIST")
      ->default_str("all")
      ->group("Selection");
  command
      .add_option("--level", options.level,
                  "Mip level: each level averages 2 x 2 texels in linear light")
      ->check(CLI::Range(0, 64))
      ->type_name("N")
      ->group("Selection");
}

Selection make_selection(const SelectionOptions& options, const BtfInfo& info) {
  const auto chosen = [](const std::string& text) { return !text.empty() && text != "all"; };
  Selection selection;
  if (chosen(options.views)) {
    selection.views = parse_indices(options.views, info.shape.views, "--views");
  }
  if (chosen(options.lights)) {
    selection.lights = parse_indices(options.lights, info.shape.lights, "--lights");
  }
  if (!options.region.empty()) selection.region = parse_region(options.region, "--region");
  if (chosen(options.channels)) {
    selection.channels = parse_indices(options.channels, info.shape.channels, "--channels");
  }
  selection.level = options.level;
  return selection;
}

std::shared_ptr<TileSource> selected_part(std::shared_ptr<TileSource> input,
                                          const Selection& selection, bool nan_zero) {
  if (nan_zero && selection.level > 0) input = with_finite_values(std::move(input));
  return select(std::move(input), selection);
}

}  // namespace weft
