#include "weft/ops/sum_squares.hpp"

#include <fmt/core.h>

#include <vector>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {
constexpr std::size_t chunk_values = 2048;

template <typename Sum>
double add_chunks(Device& device, const Buffer& sums, std::size_t chunks) {
  std::vector<Sum> host(chunks);
  device.read(sums, std::span<Sum>(host));
  double total = 0;
  for (const Sum sum : host) total += static_cast<double>(sum);
  return total;
}
}  // namespace

double sum_squares(Device& device, std::size_t count, const Buffer& values, Arithmetic arithmetic) {
  if (count == 0) return 0;
  const bool fp64 = device.limits().has_fp64;
  const std::size_t chunks = ceil_div(count, chunk_values);
  Buffer sums(device, chunks * (fp64 ? sizeof(double) : sizeof(float)), "sums of squares");
  const cl_kernel kernel =
      device.kernel(kernel_sources::sum_squares,
                    fmt::format("{} -DCHUNK={} -DDOUBLE={}", vector_option(device, arithmetic),
                                chunk_values, fp64 ? 1 : 0),
                    "sum_squares");
  set_arguments(kernel, values, ulong(count), sums);
  launch_items(device, kernel, chunks);
  return fp64 ? add_chunks<double>(device, sums, chunks) : add_chunks<float>(device, sums, chunks);
}

}  // namespace weft::ops
