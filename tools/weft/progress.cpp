#include "progress.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <utility>

#include "report.hpp"

namespace weft {
namespace {
// Often enough to look alive, seldom enough to cost nothing.
constexpr std::chrono::milliseconds terminal_interval{100};
constexpr std::chrono::milliseconds plain_interval{5000};

std::string spaced(const std::string& unit) {
  return unit.empty() ? "" : " " + unit;
}
}  // namespace

Progress::Progress(const OutputOptions& options, std::string what, std::size_t total,
                   std::string unit)
    : what_(std::move(what)),
      total_(total),
      unit_(std::move(unit)),
      enabled_(!options.quiet),
      terminal_(isatty(STDERR_FILENO) == 1),
      start_(Clock::now()),
      shown_(start_) {}

Progress::~Progress() {
  if (line_open_) std::fputs("\r\033[K", stderr);
}

void Progress::update(std::size_t done) {
  if (!enabled_) return;
  const Clock::time_point now = Clock::now();
  if (now - shown_ < (terminal_ ? terminal_interval : plain_interval)) return;
  shown_ = now;
  const double elapsed = std::chrono::duration<double>(now - start_).count();
  show(line(what_, done, total_, unit_, elapsed), false);
}

void Progress::finish() {
  if (!enabled_) return;
  enabled_ = false;
  const double elapsed = std::chrono::duration<double>(Clock::now() - start_).count();
  std::string text =
      fmt::format("{} {}{} in {}", what_, total_, spaced(unit_), format_seconds(elapsed));
  if (elapsed > 0 && total_ > 0) {
    text += fmt::format(", {:.4g}{}/s", static_cast<double>(total_) / elapsed, spaced(unit_));
  }
  show(text, true);
}

void Progress::show(const std::string& line, bool last) {
  if (terminal_) {
    fmt::print(stderr, "\r\033[K{}{}", line, last ? "\n" : "");
    line_open_ = !last;
  } else {
    fmt::print(stderr, "{}\n", line);
  }
  std::fflush(stderr);
}

std::string Progress::line(const std::string& what, std::size_t done, std::size_t total,
                           const std::string& unit, double elapsed) {
  std::string text = fmt::format("{} {}/{}{}", what, done, total, spaced(unit));
  if (done == 0 || elapsed <= 0) return text;
  const double rate = static_cast<double>(done) / elapsed;
  text += fmt::format(", {:.4g}{}/s", rate, spaced(unit));
  if (done < total) {
    text += fmt::format(", {} left", format_seconds(static_cast<double>(total - done) / rate));
  }
  return text;
}

}  // namespace weft
