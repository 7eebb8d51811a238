// Descriptions of BTFs in JSON, as they stand beside .npy files and in manifests of image folders.
//
//   {"encoding": "linear", "quantity": "radiance", "layout": "grid", "source": "...",
//    "channel_names": ["R", "G", "B"], "views": [{"theta": 0, "phi": 0}, ...],
//    "lights": [{"dir": [0, 0, 1]}, ...], "mask_runs": [...]}
//
// A direction is {"dir": [x, y, z]}, {"theta": t, "phi": p} in degrees, [x, y, z] or [t, p]. A mask
// is the lengths of its runs, beginning with a run of zeros. `where` names the file in messages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "weft/btf/btf.hpp"

namespace weft {

Direction read_direction(const nlohmann::json& value, const std::string& where);
std::vector<Direction> read_directions(const nlohmann::json& root, const char* key,
                                       const std::string& where);
// A string; `absent` where there is none.
std::string read_string(const nlohmann::json& root, const char* key, const std::string& absent,
                        const std::string& where);
// Empty where there are none.
std::vector<std::string> read_channel_names(const nlohmann::json& root, const std::string& where);
// `size` values of 0 or 1; empty where there is no mask.
std::vector<std::uint8_t> read_mask(const nlohmann::json& root, std::size_t size,
                                    const std::string& where);

// Adds every field of `info` but its shape and dtype.
void describe(const BtfInfo& info, nlohmann::ordered_json& root);
// As text, with a newline at its end. Throws an input error for strings that are not valid UTF-8.
std::string dump(const nlohmann::ordered_json& root, const std::string& where);

}  // namespace weft
