// The program's version, as written into models and printed by `weft --version`.
#pragma once

namespace weft {

// "MAJOR.MINOR.PATCH".
const char* version();

}  // namespace weft
