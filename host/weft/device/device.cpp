#include "weft/device/device.hpp"

#include <cstring>

#include "weft/device/cl_status.hpp"
#include "weft/device/list_devices.hpp"
#include "weft/device/tuning_file.hpp"
#include "weft/error.hpp"

namespace weft {

void check_cl(cl_int status, const char* what) {
  if (status != CL_SUCCESS) fail_runtime("{}: {} ({})", what, cl_status_name(status), status);
}

void wait_for(const Handle<cl_event>& event) {
  const cl_event raw = event.get();
  check_cl(clWaitForEvents(1, &raw), "clWaitForEvents");
}

void detail::set_argument(cl_kernel kernel, cl_uint index, std::size_t size, const void* value) {
  const cl_int status = clSetKernelArg(kernel, index, size, value);
  if (status == CL_SUCCESS) return;
  char name[128] = "";
  clGetKernelInfo(kernel, CL_KERNEL_FUNCTION_NAME, sizeof name, name, nullptr);
  fail_runtime("argument {} of kernel {}: {}", index, name, cl_status_name(status));
}

namespace {

Tuning load_tuning(const DeviceLimits& limits) {
  std::vector<DeviceFingerprint> present;
  for (const DeviceLimits& device : list_devices()) present.push_back(fingerprint(device));
  std::vector<std::string> warnings;
  const TuningDatabase user = read_user_tuning(warnings);
  return Tuning(limits, present, shipped_tuning(), user, std::move(warnings));
}

}  // namespace

Device::Device(std::string_view choice, bool profile) : profiling_(profile) {
  FoundDevice found = choose_device(choice);
  id_ = found.id;
  limits_ = std::move(found.limits);
  tuning_ = load_tuning(limits_);
  const cl_context_properties properties[] = {
      CL_CONTEXT_PLATFORM, reinterpret_cast<cl_context_properties>(found.platform), 0};
  cl_int status = CL_SUCCESS;
  context_ = Handle<cl_context>(clCreateContext(properties, 1, &id_, nullptr, nullptr, &status));
  check_cl(status, "clCreateContext");
  queue_ = Handle<cl_command_queue>(
      clCreateCommandQueue(context_.get(), id_, profile ? CL_QUEUE_PROFILING_ENABLE : 0, &status));
  check_cl(status, "clCreateCommandQueue");
}

Device::~Device() {
  if (queue_) clFinish(queue_.get());
}

void Device::tune(const TunableKernel& kernel, std::vector<std::size_t> values,
                  std::string source) {
  const std::string reason = refusal(kernel, values, limits_);
  if (!reason.empty()) fail_input("values for kernel {}: {}", kernel.name, reason);
  tuning_.set(kernel, std::move(values), std::move(source));
}

cl_program Device::program(const KernelSource& source, const std::string& options) {
  const std::string key = std::string(source.name) + '\n' + options;
  const auto known = programs_.find(key);
  if (known != programs_.end()) return known->second.get();

  const char* text = source.text;
  cl_int status = CL_SUCCESS;
  Handle<cl_program> built(clCreateProgramWithSource(context_.get(), 1, &text, nullptr, &status));
  check_cl(status, source.name);
  const std::string all_options = "-cl-std=CL1.2 " + options;
  status = clBuildProgram(built.get(), 1, &id_, all_options.c_str(), nullptr, nullptr);
  if (status != CL_SUCCESS) {
    std::size_t size = 0;
    clGetProgramBuildInfo(built.get(), id_, CL_PROGRAM_BUILD_LOG, 0, nullptr, &size);
    std::string log(size, '\0');
    clGetProgramBuildInfo(built.get(), id_, CL_PROGRAM_BUILD_LOG, size, log.data(), nullptr);
    fail_runtime("{} does not build on {} with \"{}\": {}\n{}", source.name, limits_.name,
                 all_options, cl_status_name(status), log.c_str());
  }
  return programs_.emplace(key, std::move(built)).first->second.get();
}

cl_kernel Device::kernel(const KernelSource& source, const std::string& options, const char* name) {
  const std::string key = std::string(name) + '\n' + source.name + '\n' + options;
  const auto known = kernels_.find(key);
  if (known != kernels_.end()) return known->second.get();
  cl_int status = CL_SUCCESS;
  Handle<cl_kernel> made(clCreateKernel(program(source, options), name, &status));
  check_cl(status, name);
  return kernels_.emplace(key, std::move(made)).first->second.get();
}

void Device::read(const Buffer& from, std::size_t offset, std::span<std::byte> to) {
  if (to.empty()) return;
  check_cl(clEnqueueReadBuffer(queue(), from.get(), CL_TRUE, offset, to.size(), to.data(), 0,
                               nullptr, nullptr),
           "clEnqueueReadBuffer");
}

Handle<cl_event> Device::read_later(const Buffer& from, std::size_t offset,
                                    std::span<std::byte> to) {
  cl_event event = nullptr;
  check_cl(clEnqueueReadBuffer(queue(), from.get(), CL_FALSE, offset, to.size(), to.data(), 0,
                               nullptr, &event),
           "clEnqueueReadBuffer");
  flush();
  return Handle<cl_event>(event);
}

void Device::write(Buffer& to, std::size_t offset, std::span<const std::byte> from) {
  if (from.empty()) return;
  if (!limits_.unified_memory) {
    check_cl(clEnqueueWriteBuffer(queue(), to.get(), CL_TRUE, offset, from.size(), from.data(), 0,
                                  nullptr, nullptr),
             "clEnqueueWriteBuffer");
    return;
  }
  // Host and device share memory: mapping was three times as fast as a write command.
  cl_int status = CL_SUCCESS;
  void* pointer = clEnqueueMapBuffer(queue(), to.get(), CL_TRUE, CL_MAP_WRITE_INVALIDATE_REGION,
                                     offset, from.size(), 0, nullptr, nullptr, &status);
  check_cl(status, "clEnqueueMapBuffer");
  std::memcpy(pointer, from.data(), from.size());
  check_cl(clEnqueueUnmapMemObject(queue(), to.get(), pointer, 0, nullptr, nullptr),
           "clEnqueueUnmapMemObject");
}

void Device::fill_zero(Buffer& buffer, std::size_t offset, std::size_t bytes) {
  if (bytes == 0) return;
  const cl_uchar zero = 0;
  check_cl(clEnqueueFillBuffer(queue(), buffer.get(), &zero, 1, offset, bytes, 0, nullptr, nullptr),
           "clEnqueueFillBuffer");
}

void Device::launch(cl_kernel kernel, std::span<const std::size_t> global,
                    std::span<const std::size_t> local) {
  cl_event event = nullptr;
  const cl_int status = clEnqueueNDRangeKernel(queue(), kernel, static_cast<cl_uint>(global.size()),
                                               nullptr, global.data(), local.data(), 0, nullptr,
                                               profiling_ ? &event : nullptr);
  if (status == CL_SUCCESS && !profiling_) return;
  Handle<cl_event> owned(event);
  char name[128] = "";
  clGetKernelInfo(kernel, CL_KERNEL_FUNCTION_NAME, sizeof name, name, nullptr);
  if (status != CL_SUCCESS)
    fail_runtime("kernel {}: {} ({})", name, cl_status_name(status), status);
  launches_.push_back({std::move(owned), name});
}

void Device::flush() {
  check_cl(clFlush(queue()), "clFlush");
}

void Device::finish() {
  check_cl(clFinish(queue()), "clFinish");
  for (const Launch& launch : launches_) {
    cl_ulong start = 0;
    cl_ulong end = 0;
    check_cl(clGetEventProfilingInfo(launch.event.get(), CL_PROFILING_COMMAND_START, sizeof start,
                                     &start, nullptr),
             "clGetEventProfilingInfo");
    check_cl(clGetEventProfilingInfo(launch.event.get(), CL_PROFILING_COMMAND_END, sizeof end, &end,
                                     nullptr),
             "clGetEventProfilingInfo");
    KernelTime& time = profile_[launch.kernel];
    ++time.launches;
    time.seconds += 1e-9 * static_cast<double>(end - start);
  }
  launches_.clear();
}

void Device::account(std::ptrdiff_t bytes) {
  allocated_ = static_cast<std::size_t>(static_cast<std::ptrdiff_t>(allocated_) + bytes);
  peak_allocated_ = std::max(peak_allocated_, allocated_);
}

}  // namespace weft
