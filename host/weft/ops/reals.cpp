#include "weft/ops/reals.hpp"

#include <algorithm>
#include <vector>

namespace weft::ops {
namespace {

constexpr std::size_t chunk = std::size_t{1} << 18;  // values converted at a time

template <typename From, typename To>
void read_as(Device& device, const Buffer& from, std::size_t rows, std::size_t columns,
             std::size_t leading, double factor, std::span<To> to) {
  const std::size_t run = std::clamp<std::size_t>(chunk / leading, 1, rows);
  std::vector<From> part(run * leading);
  for (std::size_t first = 0; first < rows; first += run) {
    const std::size_t count = std::min(run, rows - first);
    device.read(from, std::span(part).first(count * leading), first * leading);
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t j = 0; j < columns; ++j) {
        to[(first + i) * columns + j] =
            static_cast<To>(static_cast<double>(part[i * leading + j]) * factor);
      }
    }
  }
}

template <typename To>
void read_any(Device& device, const Buffer& from, Arithmetic arithmetic, std::size_t rows,
              std::size_t columns, std::size_t leading, double factor, std::span<To> to) {
  if (rows == 0 || columns == 0) return;
  if (arithmetic == Arithmetic::f32) {
    read_as<float>(device, from, rows, columns, leading, factor, to);
  } else {
    read_as<double>(device, from, rows, columns, leading, factor, to);
  }
}

}  // namespace

Buffer real_buffer(Device& device, std::span<const double> values, Arithmetic arithmetic,
                   const char* what) {
  Buffer buffer(device, std::max<std::size_t>(values.size(), 1) * size_of(arithmetic), what);
  if (arithmetic == Arithmetic::f64) {
    device.write(buffer, values);
    return buffer;
  }
  std::vector<float> part(std::min(chunk, values.size()));
  for (std::size_t first = 0; first < values.size(); first += chunk) {
    const std::size_t count = std::min(chunk, values.size() - first);
    std::transform(values.begin() + static_cast<std::ptrdiff_t>(first),
                   values.begin() + static_cast<std::ptrdiff_t>(first + count), part.begin(),
                   [](double x) { return static_cast<float>(x); });
    device.write(buffer, std::span<const float>(part).first(count), first);
  }
  return buffer;
}

void read_reals(Device& device, const Buffer& from, Arithmetic arithmetic, std::size_t rows,
                std::size_t columns, std::size_t leading, double factor, std::span<float> to) {
  read_any(device, from, arithmetic, rows, columns, leading, factor, to);
}

void read_reals(Device& device, const Buffer& from, Arithmetic arithmetic, std::size_t rows,
                std::size_t columns, std::size_t leading, double factor, std::span<double> to) {
  read_any(device, from, arithmetic, rows, columns, leading, factor, to);
}

}  // namespace weft::ops
