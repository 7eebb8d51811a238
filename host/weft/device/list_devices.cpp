// What devices there are and what they say of themselves.
#include "weft/device/list_devices.hpp"

#include <algorithm>
#include <cctype>

#include "weft/device/device.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

template <typename T>
T query(cl_device_id id, cl_device_info field) {
  T value{};
  check_cl(clGetDeviceInfo(id, field, sizeof(T), &value, nullptr), "clGetDeviceInfo");
  return value;
}

std::string query_text(cl_device_id id, cl_device_info field) {
  std::size_t size = 0;
  check_cl(clGetDeviceInfo(id, field, 0, nullptr, &size), "clGetDeviceInfo");
  std::string text(size, '\0');
  check_cl(clGetDeviceInfo(id, field, size, text.data(), nullptr), "clGetDeviceInfo");
  text.resize(std::min(text.find('\0'), text.size()));
  return text;
}

std::string platform_name(cl_platform_id platform) {
  std::size_t size = 0;
  check_cl(clGetPlatformInfo(platform, CL_PLATFORM_NAME, 0, nullptr, &size), "clGetPlatformInfo");
  std::string text(size, '\0');
  check_cl(clGetPlatformInfo(platform, CL_PLATFORM_NAME, size, text.data(), nullptr),
           "clGetPlatformInfo");
  text.resize(std::min(text.find('\0'), text.size()));
  return text;
}

DeviceLimits describe(cl_device_id id, const std::string& platform) {
  DeviceLimits limits;
  const std::string extensions = query_text(id, CL_DEVICE_EXTENSIONS);
  limits.platform = platform;
  limits.name = query_text(id, CL_DEVICE_NAME);
  limits.vendor = query_text(id, CL_DEVICE_VENDOR);
  limits.version = query_text(id, CL_DEVICE_VERSION);
  limits.driver = query_text(id, CL_DRIVER_VERSION);
  limits.is_cpu = (query<cl_device_type>(id, CL_DEVICE_TYPE) & CL_DEVICE_TYPE_CPU) != 0;
  limits.has_fp64 = extensions.find("cl_khr_fp64") != std::string::npos;
  limits.has_fp16 = extensions.find("cl_khr_fp16") != std::string::npos;
  limits.compute_units = query<cl_uint>(id, CL_DEVICE_MAX_COMPUTE_UNITS);
  limits.max_work_group = query<std::size_t>(id, CL_DEVICE_MAX_WORK_GROUP_SIZE);
  limits.global_memory = query<cl_ulong>(id, CL_DEVICE_GLOBAL_MEM_SIZE);
  limits.largest_allocation = query<cl_ulong>(id, CL_DEVICE_MAX_MEM_ALLOC_SIZE);
  limits.local_memory = query<cl_ulong>(id, CL_DEVICE_LOCAL_MEM_SIZE);
  limits.alignment = query<cl_uint>(id, CL_DEVICE_MEM_BASE_ADDR_ALIGN) / 8;
  limits.vector_width = query<cl_uint>(id, CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT);
  limits.unified_memory = query<cl_bool>(id, CL_DEVICE_HOST_UNIFIED_MEMORY) == CL_TRUE;
  return limits;
}

std::string lower(std::string_view text) {
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return result;
}

}  // namespace

std::vector<FoundDevice> find_devices() {
  cl_uint platform_count = 0;
  // Without an installed driver the loader answers with a status of its own.
  if (clGetPlatformIDs(0, nullptr, &platform_count) != CL_SUCCESS) return {};
  std::vector<cl_platform_id> platforms(platform_count);
  check_cl(clGetPlatformIDs(platform_count, platforms.data(), nullptr), "clGetPlatformIDs");
  std::vector<FoundDevice> found;
  for (cl_platform_id platform : platforms) {
    cl_uint count = 0;
    if (clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, 0, nullptr, &count) != CL_SUCCESS) continue;
    std::vector<cl_device_id> ids(count);
    check_cl(clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, count, ids.data(), nullptr),
             "clGetDeviceIDs");
    for (cl_device_id id : ids)
      found.push_back({id, platform, describe(id, platform_name(platform))});
  }
  return found;
}

std::vector<DeviceLimits> list_devices() {
  std::vector<DeviceLimits> all;
  for (FoundDevice& device : find_devices()) all.push_back(std::move(device.limits));
  return all;
}

FoundDevice choose_device(std::string_view choice) {
  std::vector<FoundDevice> found = find_devices();
  if (found.empty()) {
    fail(ErrorKind::no_device,
         "no OpenCL device: install a driver (on Debian `apt-get install pocl-opencl-icd` serves "
         "any "
         "CPU), or use --device reference");
  }
  // auto: the first GPU or accelerator, else the first device
  if (choice == "auto") {
    const auto gpu = std::find_if(found.begin(), found.end(),
                                  [](const FoundDevice& d) { return !d.limits.is_cpu; });
    return gpu != found.end() ? *gpu : found.front();
  }
  // an index
  if (!choice.empty() && std::all_of(choice.begin(), choice.end(),
                                     [](unsigned char c) { return std::isdigit(c) != 0; })) {
    const std::size_t index = choice.size() < 9 ? std::stoul(std::string(choice)) : found.size();
    if (index >= found.size()) {
      fail_input("--device {}: there are {} devices, 0 to {}", choice, found.size(),
                 found.size() - 1);
    }
    return found[index];
  }
  // a part of a name
  std::vector<std::size_t> matches;
  std::string names;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const std::string full = found[i].limits.platform + " " + found[i].limits.name;
    if (lower(full).find(lower(choice)) != std::string::npos) matches.push_back(i);
    names += fmt::format("{}{}: {}", i ? ", " : "", i, found[i].limits.name);
  }
  if (choice.empty() || matches.size() != 1) {
    fail_input("--device {}: fits {} of the devices ({})", choice, matches.size(), names);
  }
  return found[matches.front()];
}

}  // namespace weft
