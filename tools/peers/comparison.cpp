#include "comparison.hpp"

#include <algorithm>
#include <chrono>
#include <thread>

#include "bench/measure.hpp"
#include "weft/error.hpp"

namespace weft::peers {
namespace {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

// A run shorter than this is preceded by one that is not timed, which wakes threads and fills
// caches.
constexpr double short_run = 0.25;

double timed_run(Contender& contender) {
  check_interrupt();
  const Clock::time_point start = Clock::now();
  contender.run();
  return Seconds(Clock::now() - start).count();
}

}  // namespace

double Standing::best() const {
  return *std::ranges::min_element(seconds);
}

double Standing::median() const {
  return weft::median(seconds);
}

std::vector<Standing> compare(const Case& c, const Matrices& matrices,
                              const std::vector<std::unique_ptr<Contender>>& contenders,
                              const ComparisonOptions& options) {
  std::vector<Standing> standings(contenders.size());
  std::vector<double> last(contenders.size(), 0.0);
  std::vector<bool> waits(contenders.size(), false);
  // The first runs build kernels; their results are compared.
  Elements first;
  for (std::size_t i = 0; i < contenders.size(); ++i) {
    Standing& standing = standings[i];
    standing.name = contenders[i]->name();
    try {
      last[i] = timed_run(*contenders[i]);
      const Elements result = contenders[i]->result();
      if (i == 0) first = result;
      standing.disagreement = disagreement(c, matrices, first, result);
    } catch (const Error& error) {
      if (error.kind() == ErrorKind::interrupted || i == 0) throw;
      standing.failure = error.what();
      waits[i] = true;
    }
  }
  for (std::size_t round = 0; round < options.rounds; ++round) {
    for (std::size_t i = 0; i < contenders.size(); ++i) {
      if (waits[i]) continue;
      std::this_thread::sleep_for(Seconds(options.pause));
      if (last[i] < short_run) timed_run(*contenders[i]);
      last[i] = timed_run(*contenders[i]);
      standings[i].seconds.push_back(last[i]);
      waits[i] = last[i] > options.patience * standings[0].best();
    }
  }
  return standings;
}

}  // namespace weft::peers
