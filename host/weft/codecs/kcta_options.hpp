// What the codecs `kcta` and `cta` are asked: their parameters as a request.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "weft/codecs/codec.hpp"
#include "weft/codecs/nested_models.hpp"
#include "weft/reference/kcta.hpp"

namespace weft {

// `cta` has all but the last.
inline constexpr std::array<ParameterSpec, 12> kcta_parameters{{
    {"merge", "lc", "modes merged into one, as yxc (TensorTextures), lc or vl,yx; or none"},
    {"mode", "v", "mode along which slices are clustered"},
    {"clusters", "", "clusters; 8, or the slices if they are fewer"},
    {"ranks", "",
     "ranks by mode, as v=4,lc=20,y=80,x=80; that of the clustered mode is each cluster's. With a "
     "goal, the most"},
    {"rank", "", "rank of every mode that --ranks does not name; 4 for the clustered one and 32"},
    {"global", "",
     "modes with one basis for all clusters, as lc or lc,y; or none. That of the lights"},
    {"threshold", "",
     "relative error that each mode may lose by itself: chooses ranks that are not given, and "
     "clusters by that of their mode"},
    {"align", "1", "chosen ranks are multiples of it"},
    {"init", "directions", "first clusters: of directions, of slices or random"},
    {"iterations", "10", "most iterations of clustering and update"},
    {"resample-views", "0",
     "side N of a grid of N x N views beside the measured ones, interpolated for renderers; 0: "
     "none. Of clusters of views"},
    {"mixtures", "", "mixture clusters of each slice; 3, or the clusters if they are fewer"},
}};

// The modes whose ranks are to be chosen from their spectra: none without a threshold, those that
// a goal may choose with one.
std::vector<std::size_t> modes_to_choose(const Codec& codec, const Parameters& parameters,
                                         const BtfInfo& source);
std::vector<std::size_t> modes_of_goal(const Codec& codec, const Parameters& parameters,
                                       const BtfInfo& source);

// Throws input errors that name the option and the value. Ranks are chosen as the paper does
// (section 6): each from its own mode, the others whole, and so many clusters that their ranks are
// together that of the clustered mode.
KctaRequest kcta_options(const Codec& codec, const Parameters& parameters, const BtfInfo& source,
                         const ModeSpectra& spectra = {});

// The same for a goal, by a threshold of its own; ranks that are given are the most.
struct KctaGoal {
  double threshold = 0;  // 0: all that there is
  double growth = 1;     // by how much more clusters there are than make that rank
};
KctaRequest kcta_options(const Codec& codec, const Parameters& parameters, const BtfInfo& source,
                         const ModeSpectra& spectra, const KctaGoal& goal);

// What forbids a larger fit than the largest of a goal, for messages.
std::string kcta_bounds(const Codec& codec, const Parameters& parameters,
                        const KctaRequest& largest);

}  // namespace weft
