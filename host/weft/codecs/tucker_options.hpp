// What the codec `tucker` is asked: its parameters as a request.
#pragma once

#include <array>

#include "weft/codecs/codec.hpp"
#include "weft/codecs/fit_goal.hpp"
#include "weft/codecs/fit_tucker.hpp"

namespace weft {

inline constexpr std::array<ParameterSpec, 7> tucker_parameters{{
    {"merge", "", "modes merged into one, as yxc (TensorTextures), lc or vl,yx"},
    {"ranks", "", "ranks by mode, as v=61,l=27; others stay whole. With a goal, the most"},
    {"rank", "", "rank of every mode that --ranks does not name; 32 if nothing else is asked"},
    {"method", "sthosvd", "hosvd, sthosvd or hooi"},
    {"start", "sthosvd", "of hooi: hosvd or sthosvd"},
    {"iterations", "3", "of hooi"},
    {"arithmetic", "", "of Gram matrices: f32, or f64, which finer goals than 0.01 take"},
}};

// Throws input errors that name the option and the value, and the unmet goal where float factors do
// not hold it. `on_device` is null for the reference.
TuckerOptions tucker_options(const Codec& codec, const Parameters& parameters,
                             const BtfInfo& source, const FitGoal& goal, Storage storage,
                             const Device* on_device);

}  // namespace weft
