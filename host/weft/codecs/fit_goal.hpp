// What a codec's own search is asked to reach, a parameter `target` = rel=EPS | size=BYTES |
// ratio=R that is no option of the program's: see goal.hpp for those, which come to these.
#pragma once

#include <cstddef>
#include <string>

#include "weft/btf/btf.hpp"
#include "weft/codecs/codec.hpp"

namespace weft {

struct FitGoal {
  enum class Kind { none, relative, size };
  Kind kind = Kind::none;
  double relative = 0;    // wanted |T - T'| / |T|, of the model as stored
  std::size_t bytes = 0;  // most bytes of the model file
  std::string text;       // as it was given: "rel=0.02"

  explicit operator bool() const { return kind != Kind::none; }
};

// The parameter `target` of a codec; no goal if it is absent or empty. A ratio becomes bytes of the
// source that is to be compressed. Throws input errors that name the option and the value: an
// unknown goal, EPS outside (0, 1), a ratio below 1 or no number, a size that is none.
FitGoal fit_goal(const Parameters& parameters, const BtfInfo& source);

}  // namespace weft
