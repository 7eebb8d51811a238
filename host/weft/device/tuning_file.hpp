// The files that values of tunable macros come from; see device/tuning.hpp for what is in them.
#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "weft/device/tuning.hpp"

namespace weft {

// A larger file is not read.
inline constexpr std::size_t largest_tuning_file = std::size_t{1} << 20;

// The database that comes with the program: kernels/tuning.json.
TuningDatabase shipped_tuning();

// $WEFT_TUNING, else $XDG_CONFIG_HOME/weft/tuning.json, else ~/.config/weft/tuning.json. Empty if
// $WEFT_TUNING is set to nothing, or no folder is known: there is no file of the user's then.
std::filesystem::path user_tuning_file();

// The file's text. No text, and a warning unless the file is merely absent, if it can't be read or
// is too large.
TuningDatabase read_tuning(const std::filesystem::path& file, std::vector<std::string>& warnings);

// That of user_tuning_file(); a file that $WEFT_TUNING names has to be there, or it is a warning.
TuningDatabase read_user_tuning(std::vector<std::string>& warnings);

// The database as JSON: an object with an array "entries", the format and its version checked.
// Throws an input error that names the database.
nlohmann::json parse_tuning(const TuningDatabase& database);

// What a search found for one kernel on one device.
struct TuningResult {
  DeviceFingerprint device;
  std::string kernel;
  std::map<std::string, std::size_t> values;
  std::string shape;  // that was timed
  double default_seconds = 0;
  double seconds = 0;
};

// Puts entries into a file, each in place of the one for the same device and kernel; other entries
// stay. Makes the file and its folder where they are missing; the file is replaced in one step. A
// file that can't be read as a database is an input error: it might hold something else.
//
// check_tuning_file() throws what save_tuning() would, as far as that can be known before, and
// changes nothing.
void check_tuning_file(const std::filesystem::path& file);
void save_tuning(const std::filesystem::path& file, const std::vector<TuningResult>& results);

}  // namespace weft
