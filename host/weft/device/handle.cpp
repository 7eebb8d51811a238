#include "weft/device/handle.hpp"

namespace weft {
namespace {
// The one count of the process: a test compares it with zero at the end.
std::atomic<std::size_t> live_handles{0};
}  // namespace

std::size_t live_cl_handles() {
  return live_handles.load();
}

void detail::count_handle(int change) {
  if (change > 0) {
    ++live_handles;
  } else {
    --live_handles;
  }
}

}  // namespace weft
