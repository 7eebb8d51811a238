// Runs of values that are read by a thread of their own while the device works on the run before.
#pragma once

#include <cstddef>
#include <functional>
#include <span>

#include "weft/device/device.hpp"

namespace weft {

// Fills `slot` with run `index` and returns how many bytes that are. Called on the reading thread.
using FillRun = std::function<std::size_t(std::size_t index, std::span<std::byte> slot)>;
// Enqueues kernels that read `raw`, run `index`; need not wait for them.
using UseRun = std::function<void(std::size_t index, const Buffer& raw)>;

// Calls use() for `runs` runs in order, each of at most `slot_bytes` bytes, read one ahead. Throws
// what either function throws, and `interrupted` if a stop was asked for; the device is done with
// every run when it returns or throws.
void for_each_run(Device& device, std::size_t runs, std::size_t slot_bytes, const FillRun& fill,
                  const UseRun& use);

// Bytes of device and host memory that it takes.
std::size_t read_ahead_bytes(const Device& device, std::size_t slot_bytes);

// However a pass ends, the device must have stopped reading host memory before that goes.
class FinishAtEnd {
 public:
  explicit FinishAtEnd(Device& device) : device_(device) {}
  ~FinishAtEnd() { clFinish(device_.queue()); }
  FinishAtEnd(const FinishAtEnd&) = delete;
  FinishAtEnd& operator=(const FinishAtEnd&) = delete;

 private:
  Device& device_;
};

// An event behind all work that was enqueued so far.
Handle<cl_event> mark(Device& device);

}  // namespace weft
