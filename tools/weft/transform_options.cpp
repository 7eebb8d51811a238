#include "transform_options.hpp"

#include <CLI/CLI.hpp>

#include "weft/error.hpp"
#include "weft/number_list.hpp"

namespace weft {
namespace {

// "1,0.5,0.5"
std::vector<double> parse_weights(const std::string& text) {
  const auto weights = parse_number_list(text, 1e-6, 1e6);
  if (!weights) {
    fail_input(
        "--channel-weights {}: a number from 1e-6 to 1e6 for each channel is needed, as "
        "1,0.5,0.5",
        text);
  }
  return *weights;
}

}  // namespace

void add_transform_options(CLI::App& command, TransformOptions& options) {
  command
      .add_option(
          "--transform", options.transform,
          "What is fitted instead of the values: none; log, sgn(x) ln(1 + |x| / s) with s "
          "the data's mean magnitude; ycrcb (BT.601), for 8-bit data; logluv, for "
          "high-dynamic-range data; decorrelated, along the channels' principal axes. Without "
          "it, the codec's own, which is none where its help does not say otherwise")
      ->type_name("NAME");
  command
      .add_option("--channel-weights", options.channel_weights,
                  "Budgets of the transformed channels, as 1,0.5,0.5: what their errors count in "
                  "the fit")
      ->type_name("NUMBERS");
}

ColourRequest make_colour_request(const TransformOptions& options, ColourTransform::Kind own) {
  ColourRequest request;
  request.kind = options.transform.empty()
                     ? own
                     : colour_transform_from_name(options.transform, "--transform");
  if (!options.channel_weights.empty()) request.weights = parse_weights(options.channel_weights);
  return request;
}

void add_transform_field(Report& report, const ColourTransform& transform) {
  const std::string text = to_text(transform);
  report.add("colour_transform", transform.is_identity() ? text_cell(text) : json_cell(text));
}

}  // namespace weft
