// The one family of errors. A message carries the file, the field and the value; `main` maps the
// kind to the exit status. Nothing in the library ends the process.
#pragma once

#include <fmt/core.h>

#include <stdexcept>
#include <string>

namespace weft {

// What went wrong, with the exit status that the program gives for it.
enum class ErrorKind : int {
  unmet_goal = 1,    // the request could not be met: a target was missed, a check failed
  input = 2,         // bad usage or bad input
  no_device = 3,     // no usable OpenCL device
  runtime = 4,       // a run-time failure: disk full, a kernel failed
  interrupted = 130  // stopped by the user
};

class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

// Throws an Error of the given kind with a message formatted as by fmt::format.
template <typename... Args>
[[noreturn]] void fail(ErrorKind kind, fmt::format_string<Args...> format, Args&&... args) {
  throw Error(kind, fmt::format(format, std::forward<Args>(args)...));
}

template <typename... Args>
[[noreturn]] void fail_input(fmt::format_string<Args...> format, Args&&... args) {
  fail(ErrorKind::input, format, std::forward<Args>(args)...);
}

template <typename... Args>
[[noreturn]] void fail_runtime(fmt::format_string<Args...> format, Args&&... args) {
  fail(ErrorKind::runtime, format, std::forward<Args>(args)...);
}

// Asks every running job to stop at its next granule. Safe to call from a signal handler.
void request_interrupt() noexcept;

// Throws an Error of kind `interrupted` if a stop was asked for. Long loops call it per granule.
void check_interrupt();

}  // namespace weft
