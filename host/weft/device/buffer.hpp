// Device memory.
#pragma once

#include <CL/cl.h>

#include <cstddef>
#include <span>

#include "weft/device/handle.hpp"

namespace weft {

class Device;

// Untyped bytes on a device. Contents are undefined until written. Accounted for by its Device.
class Buffer {
 public:
  Buffer() = default;
  // Throws a run-time error that names `what`, the size and the limit if it exceeds the device's
  // largest allocation or can't be had.
  Buffer(Device& device, std::size_t bytes, const char* what);
  // Read-only view of host memory, which must outlive it (CL_MEM_USE_HOST_PTR). Kernels read it
  // with vloadN only, since it may be unaligned.
  static Buffer wrap(Device& device, std::span<const std::byte> host, const char* what);
  // The same for kernels to write. What they wrote is there once Device::read() has read it into
  // the same place, which copies nothing.
  static Buffer wrap_writable(Device& device, std::span<std::byte> host, const char* what);
  // Bytes [offset, offset + bytes) of another buffer as a buffer of their own (a sub-buffer);
  // `whole` must outlive it, and the offset must be a multiple of limits().alignment.
  static Buffer part(Device& device, const Buffer& whole, std::size_t offset, std::size_t bytes,
                     const char* what);
  ~Buffer();
  Buffer(Buffer&& other) noexcept;
  Buffer& operator=(Buffer&& other) noexcept;

  cl_mem get() const { return handle_.get(); }
  std::size_t size() const { return size_; }
  explicit operator bool() const { return static_cast<bool>(handle_); }

 private:
  static Buffer of_host(Device& device, cl_mem_flags flags, void* host, std::size_t bytes,
                        const char* what);

  Device* device_ = nullptr;
  Handle<cl_mem> handle_;
  std::size_t size_ = 0;
  bool counted_ = false;
};

}  // namespace weft
