// Device memory between two guard zones (canaries) that no kernel may write to:
//
//   [ guard, a multiple of the device's alignment | contents, `bytes` | guard ]
//
// The contents begin as 0xFF bytes, which are NaN as float or half, so that what a kernel forgets
// to write is seen. On the simulator, which watches bounds and uninitialised memory itself, there
// are no guards, and the contents are left as they are: it would take guards for legal and a fill
// for values.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "weft/device/device.hpp"

namespace weft::test {

// Whether a device is the Oclgrind simulator.
bool is_simulator(const Device& device);

class GuardedBuffer {
 public:
  GuardedBuffer(Device& device, std::size_t bytes, std::string what);

  // With these values as contents.
  template <typename T>
  GuardedBuffer(Device& device, std::span<const T> values, std::string what)
      : GuardedBuffer(device, values.size_bytes(), std::move(what)) {
    device.write(buffer(), values);
  }

  Buffer& buffer() { return guarded_ ? contents_ : whole_; }
  const Buffer& buffer() const { return guarded_ ? contents_ : whole_; }

  // The contents after all work that was enqueued.
  template <typename T>
  std::vector<T> values() {
    std::vector<T> out(buffer().size() / sizeof(T));
    device_->read(buffer(), std::span<T>(out));
    return out;
  }

  // Whether both guards are as they were made; names the first byte that is not.
  testing::AssertionResult intact();

 private:
  Device* device_;
  std::string what_;
  bool guarded_ = true;
  std::size_t front_ = 0;
  Buffer whole_;
  Buffer contents_;
};

}  // namespace weft::test
