// The options that choose what a codec fits instead of the stored values, and what reports say of
// it.
#pragma once

#include <string>

#include "report.hpp"
#include "weft/codecs/colour_source.hpp"

namespace CLI {
class App;
}

namespace weft {

// --transform --channel-weights, as given.
struct TransformOptions {
  std::string transform;  // empty: the codec's own
  std::string channel_weights;
};
void add_transform_options(CLI::App& command, TransformOptions& options);
// What the options ask for; `own` is the codec's where they do not name a transform. Throws an
// input error that names the option.
ColourRequest make_colour_request(const TransformOptions& options, ColourTransform::Kind own);

// Field `colour_transform`: "none", or an object with its numbers.
void add_transform_field(Report& report, const ColourTransform& transform);

}  // namespace weft
