#include "weft/device/buffer.hpp"

#include <algorithm>
#include <utility>

#include "weft/device/cl_status.hpp"
#include "weft/device/device.hpp"
#include "weft/error.hpp"

namespace weft {

Buffer::Buffer(Device& device, std::size_t bytes, const char* what)
    : device_(&device), size_(bytes) {
  const DeviceLimits& limits = device.limits();
  if (bytes > limits.largest_allocation) {
    fail_runtime("{}: {} bytes exceed the largest allocation of {}, {} bytes", what, bytes,
                 limits.name, limits.largest_allocation);
  }
  // A driver may let us allocate more than there is: our own account is the limit.
  if (device.allocated() + bytes > limits.global_memory) {
    fail_runtime("{}: {} bytes, beside {} in use, exceed the memory of {}, {} bytes", what, bytes,
                 device.allocated(), limits.name, limits.global_memory);
  }
  cl_int status = CL_SUCCESS;
  handle_ = Handle<cl_mem>(clCreateBuffer(device.context(), CL_MEM_READ_WRITE,
                                          std::max<std::size_t>(bytes, 1), nullptr, &status));
  check_cl(status, what);
  device.account(static_cast<std::ptrdiff_t>(bytes));
  counted_ = true;
}

Buffer Buffer::of_host(Device& device, cl_mem_flags flags, void* host, std::size_t bytes,
                       const char* what) {
  Buffer buffer;
  buffer.device_ = &device;
  buffer.size_ = bytes;
  cl_int status = CL_SUCCESS;
  buffer.handle_ = Handle<cl_mem>(
      clCreateBuffer(device.context(), flags | CL_MEM_USE_HOST_PTR, bytes, host, &status));
  check_cl(status, what);
  return buffer;
}

Buffer Buffer::wrap(Device& device, std::span<const std::byte> host, const char* what) {
  // The flag promises that no kernel writes here; the C API has no const form of host_ptr.
  return of_host(device, CL_MEM_READ_ONLY, const_cast<std::byte*>(host.data()), host.size(), what);
}

Buffer Buffer::wrap_writable(Device& device, std::span<std::byte> host, const char* what) {
  return of_host(device, CL_MEM_READ_WRITE, host.data(), host.size(), what);
}

Buffer Buffer::part(Device& device, const Buffer& whole, std::size_t offset, std::size_t bytes,
                    const char* what) {
  Buffer buffer;
  buffer.device_ = &device;
  buffer.size_ = bytes;
  const cl_buffer_region region{offset, bytes};
  cl_int status = CL_SUCCESS;
  buffer.handle_ = Handle<cl_mem>(clCreateSubBuffer(
      whole.get(), CL_MEM_READ_WRITE, CL_BUFFER_CREATE_TYPE_REGION, &region, &status));
  check_cl(status, what);
  return buffer;
}

Buffer::~Buffer() {
  if (counted_) device_->account(-static_cast<std::ptrdiff_t>(size_));
}

Buffer::Buffer(Buffer&& other) noexcept
    : device_(other.device_),
      handle_(std::move(other.handle_)),
      size_(std::exchange(other.size_, 0)),
      counted_(std::exchange(other.counted_, false)) {}

Buffer& Buffer::operator=(Buffer&& other) noexcept {
  if (this != &other) {
    if (counted_) device_->account(-static_cast<std::ptrdiff_t>(size_));
    device_ = other.device_;
    handle_ = std::move(other.handle_);
    size_ = std::exchange(other.size_, 0);
    counted_ = std::exchange(other.counted_, false);
  }
  return *this;
}

}  // namespace weft
