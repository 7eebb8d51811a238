// Progress of a long job on standard error: one line that is rewritten, with rate and time left,
// when it is a terminal; plain lines at most every five seconds otherwise; nothing under --quiet.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>

#include "common.hpp"

namespace weft {

class Progress {
 public:
  // `what` is done ("compress", "writing"), over `total` of `unit` ("images"), or of a unit that
  // needs no name ("").
  Progress(const OutputOptions& options, std::string what, std::size_t total,
           std::string unit = "images");
  // Removes a half-way line from the terminal, so that an error message begins on a clean one.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // `done` of `total` so far. Cheap: may be called for every granule.
  void update(std::size_t done);
  // The job is done: says how long it took.
  void finish();

  // "compress 1234/6561 images, 812 images/s, 6.56 s left" after `elapsed` seconds.
  static std::string line(const std::string& what, std::size_t done, std::size_t total,
                          const std::string& unit, double elapsed);

 private:
  using Clock = std::chrono::steady_clock;
  void show(const std::string& line, bool last);

  std::string what_;
  std::size_t total_;
  std::string unit_;
  bool enabled_;
  bool terminal_;
  bool line_open_ = false;
  Clock::time_point start_;
  Clock::time_point shown_;
};

}  // namespace weft
