// One OpenCL device with its context, its in-order queue and its built programs. Everything on the
// device goes through it; there are no globals. One thread owns a Device.
#pragma once

#include <CL/cl.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "weft/device/buffer.hpp"
#include "weft/device/handle.hpp"
#include "weft/device/kernel_sources.hpp"
#include "weft/device/tuning.hpp"

namespace weft {

// What a device says of itself.
struct DeviceLimits {
  std::string platform;
  std::string name;
  std::string vendor;
  std::string version;  // "OpenCL 3.0 PoCL ..."
  std::string driver;
  bool is_cpu = false;
  bool has_fp64 = false;
  bool has_fp16 = false;
  std::size_t compute_units = 0;
  std::size_t max_work_group = 0;
  std::size_t global_memory = 0;       // bytes
  std::size_t largest_allocation = 0;  // bytes
  std::size_t local_memory = 0;        // bytes
  std::size_t alignment = 0;           // bytes, of sub-buffers
  std::size_t vector_width = 0;        // native float lanes
  bool unified_memory = false;
};

// All devices of all platforms, in the order in which indices count them. Empty if there is none.
std::vector<DeviceLimits> list_devices();

// Time spent in one kernel, summed.
struct KernelTime {
  std::size_t launches = 0;
  double seconds = 0;
};

class Device {
 public:
  // `choice`: "auto" (the first GPU, else the first device), an index of list_devices(), or a part
  // of a name, whatever the case. Throws a no-device error that says how to get one if there is
  // none, an input error naming the choice if it fits none or several. `profile` keeps a time per
  // kernel. Values of tunable macros come from the tuning databases.
  explicit Device(std::string_view choice, bool profile = false);
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  const DeviceLimits& limits() const { return limits_; }
  cl_context context() const { return context_.get(); }
  cl_command_queue queue() const { return queue_.get(); }
  cl_device_id id() const { return id_; }

  // The value of a tunable macro on this device; "-DNAME=VALUE ..." for all macros of a kernel.
  std::size_t parameter(const TunableKernel& kernel, std::string_view macro) const {
    return tuning_.value(kernel, macro);
  }
  std::string tuned_options(const TunableKernel& kernel) const { return tuning_.options(kernel); }
  const Tuning& tuning() const { return tuning_; }
  // Sets all values of a kernel, in the order of its table. Throws an input error if they are not
  // legal or can't go together on this device.
  void tune(const TunableKernel& kernel, std::vector<std::size_t> values, std::string source);

  // A kernel of a source built with `options` (macros as "-DNAME=VALUE"), from the program cache of
  // this Device. A failed build is a run-time error with the build log.
  cl_kernel kernel(const KernelSource& source, const std::string& options, const char* name);

  // Blocking copies. On a device with unified memory they map.
  void read(const Buffer& from, std::size_t offset, std::span<std::byte> to);
  void write(Buffer& to, std::size_t offset, std::span<const std::byte> from);
  // Enqueues a copy to host memory, which must stay until the event is complete.
  Handle<cl_event> read_later(const Buffer& from, std::size_t offset, std::span<std::byte> to);
  void fill_zero(Buffer& buffer, std::size_t offset, std::size_t bytes);

  template <typename T>
  void read(const Buffer& from, std::span<T> to, std::size_t first_element = 0) {
    read(from, first_element * sizeof(T), std::as_writable_bytes(to));
  }
  template <typename T>
  void write(Buffer& to, std::span<const T> from, std::size_t first_element = 0) {
    write(to, first_element * sizeof(T), std::as_bytes(from));
  }

  // Enqueues a kernel over `global` work-items in groups of `local` (one to three sizes; every
  // global size is a multiple of the local one). Arguments must be set. Throws a run-time error
  // that names the kernel.
  void launch(cl_kernel kernel, std::span<const std::size_t> global,
              std::span<const std::size_t> local);
  // Starts the work that was enqueued without waiting.
  void flush();
  // Waits until the queue is empty, and collects profiling times.
  void finish();

  // Per kernel name, after finish(); empty unless profiling.
  const std::map<std::string, KernelTime>& profile() const { return profile_; }

  // Bytes of our buffers that are alive, and the most that ever were.
  std::size_t allocated() const { return allocated_; }
  std::size_t peak_allocated() const { return peak_allocated_; }

 private:
  friend class Buffer;
  void account(std::ptrdiff_t bytes);
  cl_program program(const KernelSource& source, const std::string& options);

  struct Launch {
    Handle<cl_event> event;
    std::string kernel;
  };

  cl_device_id id_ = nullptr;
  DeviceLimits limits_;
  Tuning tuning_;
  Handle<cl_context> context_;
  Handle<cl_command_queue> queue_;
  std::map<std::string, Handle<cl_program>> programs_;
  std::map<std::string, Handle<cl_kernel>> kernels_;
  bool profiling_ = false;
  std::vector<Launch> launches_;
  std::map<std::string, KernelTime> profile_;
  std::size_t allocated_ = 0;
  std::size_t peak_allocated_ = 0;
};

// Throws a run-time error with `what` and the name of the status unless it is CL_SUCCESS. A failed
// allocation says how much was allocated.
void check_cl(cl_int status, const char* what);

// Waits for an event; throws a run-time error if its command failed.
void wait_for(const Handle<cl_event>& event);

// Sets all arguments of a kernel from the first on: Buffers, and scalars of OpenCL C's own sizes
// (std::uint64_t for ulong, std::int32_t for int, float ...).
template <typename... Args>
void set_arguments(cl_kernel kernel, const Args&... args);

namespace detail {
void set_argument(cl_kernel kernel, cl_uint index, std::size_t size, const void* value);
inline void set_argument(cl_kernel kernel, cl_uint index, const Buffer& buffer) {
  cl_mem handle = buffer.get();
  set_argument(kernel, index, sizeof(cl_mem), &handle);
}
template <typename T>
requires std::is_arithmetic_v<T>
void set_argument(cl_kernel kernel, cl_uint index, const T& value) {
  set_argument(kernel, index, sizeof(T), &value);
}
}  // namespace detail

template <typename... Args>
void set_arguments(cl_kernel kernel, const Args&... args) {
  cl_uint index = 0;
  (detail::set_argument(kernel, index++, args), ...);
}

}  // namespace weft
