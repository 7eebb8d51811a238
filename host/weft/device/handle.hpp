// Owning handles of OpenCL objects, counted, so that a test can see that all were released.
#pragma once

#include <CL/cl.h>

#include <atomic>
#include <cstddef>
#include <utility>

namespace weft {

// OpenCL objects of ours that are alive in this process.
std::size_t live_cl_handles();

namespace detail {
void count_handle(int change);
template <typename T>
struct Release;
template <>
struct Release<cl_context> {
  static void call(cl_context h) { clReleaseContext(h); }
};
template <>
struct Release<cl_command_queue> {
  static void call(cl_command_queue h) { clReleaseCommandQueue(h); }
};
template <>
struct Release<cl_mem> {
  static void call(cl_mem h) { clReleaseMemObject(h); }
};
template <>
struct Release<cl_program> {
  static void call(cl_program h) { clReleaseProgram(h); }
};
template <>
struct Release<cl_kernel> {
  static void call(cl_kernel h) { clReleaseKernel(h); }
};
template <>
struct Release<cl_event> {
  static void call(cl_event h) { clReleaseEvent(h); }
};
}  // namespace detail

template <typename T>
class Handle {
 public:
  Handle() = default;
  explicit Handle(T handle) : handle_(handle) {
    if (handle_) detail::count_handle(1);
  }
  ~Handle() { reset(); }
  Handle(Handle&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Handle& operator=(Handle&& other) noexcept {
    if (this != &other) {
      reset();
      handle_ = std::exchange(other.handle_, nullptr);
    }
    return *this;
  }

  T get() const { return handle_; }
  explicit operator bool() const { return handle_ != nullptr; }

  void reset() {
    if (!handle_) return;
    detail::Release<T>::call(handle_);
    detail::count_handle(-1);
    handle_ = nullptr;
  }

 private:
  T handle_ = nullptr;
};

}  // namespace weft
