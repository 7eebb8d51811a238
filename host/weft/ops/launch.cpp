#include "weft/ops/launch.hpp"

#include <array>

#include "weft/error.hpp"

namespace weft::ops {

void launch_items(Device& device, cl_kernel kernel, std::size_t x, std::size_t y, std::size_t z) {
  if (x == 0 || y == 0 || z == 0) return;
  const std::array<std::size_t, 3> global{x, y, z};
  const std::array<std::size_t, 3> local{1, 1, 1};
  device.launch(kernel, global, local);
}

std::size_t vector_width(const Device& device, Arithmetic arithmetic) {
  const std::size_t floats = device.limits().vector_width >= 16 ? 16 : 8;
  return arithmetic == Arithmetic::f32 ? floats : floats / 2;
}

std::size_t panel_width(const Device& device, Arithmetic arithmetic) {
  return 3 * vector_width(device, arithmetic);
}

std::string vector_option(const Device& device, Arithmetic arithmetic) {
  const std::size_t lanes = vector_width(device, arithmetic);
  return fmt::format("-DARITHMETIC={} -DVW={} -DMR={}", 8 * size_of(arithmetic), lanes,
                     lanes * size_of(arithmetic) == 64 ? 8 : 4);
}

void require_arithmetic(const Device& device, Arithmetic arithmetic) {
  if (arithmetic == Arithmetic::f32 || device.limits().has_fp64) return;
  fail_input("device '{}' has no double precision: choose arithmetic f32", device.limits().name);
}

std::string value_options(DType dtype, bool nan_zero) {
  if (dtype != DType::u8 && dtype != DType::f16 && dtype != DType::f32) {
    fail_input("values of type {} can't be read by a device", name_of(dtype));
  }
  const int value = dtype == DType::u8 ? 0 : dtype == DType::f16 ? 1 : 2;
  return fmt::format("-DVALUE={} -DNAN_ZERO={}", value, nan_zero ? 1 : 0);
}

}  // namespace weft::ops
