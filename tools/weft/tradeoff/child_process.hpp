// Runs this very program as a child: a point of a trade-off that crashes or runs out of memory
// takes nothing else with it, and the system says how much memory it took.
#pragma once

#include <cstddef>
#include <span>
#include <string>

namespace weft {

struct ChildResult {
  int status = 0;  // exit status, or 128 + the signal that ended it
  bool timed_out = false;
  double seconds = 0;           // from start to end
  std::size_t peak_memory = 0;  // bytes resident at most, mapped pages of files included
  std::string out;
  std::string err;
};

// Runs the program with `arguments`; standard input is empty. Past `time_limit` seconds (0: none)
// it is killed. Where the user interrupts, the child is stopped and waited for, and the
// interruption thrown. Throws a run-time error if no process can be started.
ChildResult run_child(std::span<const std::string> arguments, double time_limit);

// Why a child failed, in one line: its own error message, without the program's name in front, or
// how it ended.
std::string failure_message(const ChildResult& result);

}  // namespace weft
