// A kernel that takes its time, for tests of what happens meanwhile.
#pragma once

#include <array>
#include <cstdint>
#include <fstream>
#include <sstream>
#include <string>

#include "weft/device/device.hpp"

namespace weft::test {

// Enqueues a kernel that reads the first byte of `in` after `rounds` dependent steps (a few
// nanoseconds each), and writes one float to `out`.
inline void enqueue_spin(Device& device, const Buffer& in, std::uint64_t rounds, Buffer& out) {
  std::ifstream file(WEFT_SPIN_KERNEL_FILE);
  std::ostringstream text;
  text << file.rdbuf();
  const std::string source = text.str();
  cl_kernel kernel = device.kernel({"spin.cl", source.c_str()}, "", "spin");
  set_arguments(kernel, in, rounds, out);
  const std::array<std::size_t, 1> one{1};
  device.launch(kernel, one, one);
}

}  // namespace weft::test
