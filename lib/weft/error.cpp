#include "weft/error.hpp"

#include <atomic>

namespace weft {
namespace {
// A stop concerns the whole process, as the signal behind it does.
std::atomic<bool> interrupt_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free, "written from a signal handler");
}  // namespace

void request_interrupt() noexcept {
  interrupt_requested.store(true, std::memory_order_relaxed);
}

void check_interrupt() {
  if (interrupt_requested.load(std::memory_order_relaxed)) {
    throw Error(ErrorKind::interrupted, "interrupted");
  }
}

}  // namespace weft
