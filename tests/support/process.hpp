// Runs a program as a user would: arguments in; standard output, standard error and exit status
// out.
#pragma once

#include <sys/types.h>

#include <map>
#include <string>
#include <vector>

#include "support/temporary_folder.hpp"

namespace weft::test {

struct ProcessResult {
  int status = -1;  // exit status, or 128 + the signal that ended it
  bool timed_out = false;
  std::string out;
  std::string err;
};

// A running program. Standard input is empty.
class Process {
 public:
  // `arguments` begins with the program's path; `environment` is added to this process's own.
  explicit Process(const std::vector<std::string>& arguments,
                   const std::map<std::string, std::string>& environment = {});
  // Kills it if it still runs.
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  bool running();
  pid_t id() const { return id_; }
  void send_signal(int signal);
  // Waits for its end; past `seconds` it is killed.
  ProcessResult wait(double seconds = 240);

 private:
  TemporaryFolder folder_;
  pid_t id_ = -1;
  bool ended_ = false;
  int wait_status_ = 0;
};

ProcessResult run_process(const std::vector<std::string>& arguments,
                          const std::map<std::string, std::string>& environment = {},
                          double seconds = 240);

}  // namespace weft::test
