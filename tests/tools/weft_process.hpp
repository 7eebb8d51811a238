// Runs the program `weft` as a process.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "support/process.hpp"

namespace weft::test {

// The command line with the path of the program in front.
std::vector<std::string> weft_command(std::vector<std::string> arguments);

ProcessResult run_weft(std::vector<std::string> arguments,
                       const std::map<std::string, std::string>& environment = {});

}  // namespace weft::test
