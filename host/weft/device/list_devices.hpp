// Finding and choosing devices; Device's constructor builds on it.
#pragma once

#include <CL/cl.h>

#include <string_view>
#include <vector>

#include "weft/device/device.hpp"

namespace weft {

struct FoundDevice {
  cl_device_id id = nullptr;
  cl_platform_id platform = nullptr;
  DeviceLimits limits;
};

// In the order of list_devices().
std::vector<FoundDevice> find_devices();

// By the rules of Device's constructor.
FoundDevice choose_device(std::string_view choice);

}  // namespace weft
