// JSON that comes from files of others: parsed strictly, and shown in messages safely.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace weft {

// Parses one JSON value. Throws an input error that names `where` for anything that is not valid
// JSON in valid UTF-8, for an object that has a key twice, and for nesting deeper than 32.
nlohmann::json parse_json(std::string_view text, std::string_view where);

// Text of a file as it may stand in a message: at most `limit` bytes, control characters and
// whatever is not ASCII as \xNN.
std::string shown(std::string_view text, std::size_t limit = 80);

}  // namespace weft
