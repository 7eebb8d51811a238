#include "tradeoff/child_process.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <memory>
#include <thread>
#include <vector>

#ifdef __linux__
#include <sys/prctl.h>
#endif

#include "weft/error.hpp"

namespace weft {
namespace {

constexpr int first_signal_status = 128;
constexpr int cannot_execute = 127;
constexpr auto poll_interval = std::chrono::milliseconds(4);
// What a child that was asked to stop may take for it.
constexpr double stop_seconds = 10;

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

// A nameless file: it takes any amount of output without being read meanwhile.
File make_capture() {
  File file(std::tmpfile());
  if (!file) fail_runtime("no temporary file for a process's output: {}", std::strerror(errno));
  return file;
}

std::string contents(const File& file) {
  std::rewind(file.get());
  std::string text;
  char block[4096];
  while (const std::size_t count = std::fread(block, 1, sizeof block, file.get())) {
    text.append(block, count);
  }
  return text;
}

// In the child, between fork and exec: nothing that allocates.
[[noreturn]] void become(char* const* arguments, int out, int err, pid_t parent) {
#ifdef __linux__
  // A child does not outlive the run that it is a part of.
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) _exit(cannot_execute);
#else
  static_cast<void>(parent);
#endif
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
  const int nothing = ::open("/dev/null", O_RDONLY);
  if (nothing < 0 || dup2(nothing, STDIN_FILENO) < 0 || dup2(out, STDOUT_FILENO) < 0 ||
      dup2(err, STDERR_FILENO) < 0) {
    _exit(cannot_execute);
  }
  // this very file, even where another has taken its name since
  execv("/proc/self/exe", arguments);
  _exit(cannot_execute);
}

class Child {
 public:
  explicit Child(std::span<const std::string> arguments)
      : out_(make_capture()), err_(make_capture()) {
    std::vector<std::string> words{"weft"};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> pointers;
    for (std::string& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    const pid_t parent = getpid();
    id_ = fork();
    if (id_ < 0) fail_runtime("no process can be started: {}", std::strerror(errno));
    if (id_ == 0) become(pointers.data(), fileno(out_.get()), fileno(err_.get()), parent);
  }
  ~Child() {
    if (ended_) return;
    send(SIGKILL);
    wait4(id_, &status_, 0, &usage_);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  void send(int signal) const { ::kill(id_, signal); }

  // Whether it ended within `seconds`.
  bool wait(double seconds) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (!poll()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(poll_interval);
    }
    return true;
  }
  bool poll() {
    if (!ended_ && wait4(id_, &status_, WNOHANG, &usage_) == id_) ended_ = true;
    return ended_;
  }

  int status() const {
    return WIFEXITED(status_) ? WEXITSTATUS(status_) : first_signal_status + WTERMSIG(status_);
  }
  std::size_t peak_memory() const {
#ifdef __APPLE__
    return static_cast<std::size_t>(usage_.ru_maxrss);
#else
    return static_cast<std::size_t>(usage_.ru_maxrss) * 1024;
#endif
  }
  std::string out() const {
    return contents(out_);
  }
  std::string err() const {
    return contents(err_);
  }

 private:
  File out_, err_;
  pid_t id_ = -1;
  bool ended_ = false;
  int status_ = 0;
  rusage usage_ = {};
};

}  // namespace

ChildResult run_child(std::span<const std::string> arguments, double time_limit) {
  check_interrupt();
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  const auto elapsed = [start] {
    return std::chrono::duration<double>(Clock::now() - start).count();
  };
  Child child(arguments);
  ChildResult result;
  while (!child.poll()) {
    try {
      check_interrupt();
    } catch (const Error&) {
      child.send(SIGTERM);
      child.wait(stop_seconds);
      throw;
    }
    if (time_limit > 0 && elapsed() > time_limit) {
      result.timed_out = true;
      child.send(SIGKILL);
      child.wait(stop_seconds);
      break;
    }
    std::this_thread::sleep_for(poll_interval);
  }
  // A terminal interrupts both: what the child says about it is no result.
  check_interrupt();
  result.status = child.status();
  result.seconds = elapsed();
  result.peak_memory = child.peak_memory();
  result.out = child.out();
  result.err = child.err();
  return result;
}

std::string failure_message(const ChildResult& result) {
  if (result.timed_out)
    return fmt::format("stopped after {:.3g} s, the time limit", result.seconds);
  constexpr std::string_view mark = ": error: ";
  const std::size_t at = result.err.rfind(mark);
  if (at != std::string::npos) {
    const std::size_t first = at + mark.size();
    return result.err.substr(first, result.err.find('\n', first) - first);
  }
  if (result.status > first_signal_status) {
    const int signal = result.status - first_signal_status;
    const char* const name = strsignal(signal);
    return fmt::format("ended by signal {} ({})", signal, name ? name : "unknown");
  }
  return fmt::format("ended with status {} and no message", result.status);
}

}  // namespace weft
