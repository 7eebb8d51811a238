#include "tools/weft_process.hpp"

#include <utility>

namespace weft::test {

std::vector<std::string> weft_command(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), WEFT_PROGRAM);
  return arguments;
}

ProcessResult run_weft(std::vector<std::string> arguments,
                       const std::map<std::string, std::string>& environment) {
  return run_process(weft_command(std::move(arguments)), environment);
}

}  // namespace weft::test
