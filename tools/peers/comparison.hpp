// Contenders taking turns at one case.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "contender.hpp"

namespace weft::peers {

struct Standing {
  std::string name;
  std::vector<double> seconds;  // of every timed run
  double disagreement = 0;      // with the first contender's result, see cases.hpp
  std::string failure;          // why it has no times; empty if it has

  double best() const;
  double median() const;
};

struct ComparisonOptions {
  std::size_t rounds = 5;
  // Pause before each turn, in seconds: threads of a library spin for a while after their work and
  // would take the processor from the next.
  double pause = 0.1;
  // A contender this many times slower than the first one is timed once.
  double patience = 6;
};

std::vector<Standing> compare(const Case& c, const Matrices& matrices,
                              const std::vector<std::unique_ptr<Contender>>& contenders,
                              const ComparisonOptions& options);

}  // namespace weft::peers
