// The light of a small studio, for pictures that nobody has lit: dim walls that brighten upwards, a
// wide soft lamp at the right front and a narrower one at the back, all neutral and without edges,
// so that few samples suffice. The camera is taken to be at -y.
#pragma once

#include "weft/scene/environment_map.hpp"

namespace weft {

EnvironmentMap make_studio_map();

}  // namespace weft
