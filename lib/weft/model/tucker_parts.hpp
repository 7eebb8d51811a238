// Models made of a Tucker model: fewer ranks, factors multiplied out, directions between measured
// ones.
#pragma once

#include <memory>
#include <span>
#include <string_view>

#include "weft/btf/hemisphere.hpp"
#include "weft/model/tucker.hpp"

namespace weft {

// Strategic reduction (Vasilescu & Terzopoulos 2004, section 3): the ranks of some modes cut,
// "l=3,v=20", the other modes untouched; the factors' leading columns and the core's leading part.
// With factors of `hosvd` this is what `hosvd` of these ranks finds. Throws input errors that name
// --ranks and the value: a mode without a factor or named twice, a rank above the model's.
std::unique_ptr<TuckerModel> with_ranks(const TuckerModel& model, std::string_view ranks);

// After a cut: the ranks in what the model says of its encoder are those that it has, and errors of
// the factors, which were those of more ranks, are gone.
void restate_ranks(TuckerModel& model);

// The factors of some modes, "y,x", multiplied into the core: memory for speed (Ruiters & Klein
// 2009, section 5). Throws an input error that names --expand and lists the modes for others; modes
// without a factor are expanded as they are.
std::unique_ptr<TuckerModel> expanded(const TuckerModel& model, std::string_view modes);

// The model of images at directions between the measured ones: each new view and light is the
// barycentric combination of its neighbours' coefficient vectors (Vasilescu & Terzopoulos 2004,
// section 4), times its scale. `info` has the new directions.
std::unique_ptr<TuckerModel> at_directions(const TuckerModel& model, const BtfInfo& info,
                                           std::span<const DirectionWeights> views,
                                           std::span<const DirectionWeights> lights);

}  // namespace weft
