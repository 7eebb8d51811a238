#include "weft/codecs/panel_stream.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "weft/error.hpp"
#include "weft/ops/gemm.hpp"

namespace weft {
namespace {

// The power of two that brings the largest magnitude into [0.5, 1), as far as T allows.
template <typename T>
double matrix_scale(std::span<const T> values, int most) {
  T largest = 0;
  for (const T value : values) largest = std::max(largest, std::abs(value));
  int exponent = 0;
  std::frexp(largest, &exponent);
  return std::ldexp(1.0, std::clamp(-exponent, -most, most));
}

}  // namespace

MatrixPanels::MatrixPanels(Device& device, std::size_t rows, std::size_t columns,
                           std::span<const float> values, std::size_t granule)
    : PanelStream(rows, columns, granule, Arithmetic::f32),
      device_(device),
      floats_(values),
      scale_(matrix_scale(values, 127)) {
  if (values.size() != rows * columns)
    fail_input("{} values of {} x {}", values.size(), rows, columns);
}

MatrixPanels::MatrixPanels(Device& device, std::size_t rows, std::size_t columns,
                           std::span<const double> values, std::size_t granule)
    : PanelStream(rows, columns, granule, Arithmetic::f64),
      device_(device),
      doubles_(values),
      scale_(matrix_scale(values, 1022)) {
  if (values.size() != rows * columns)
    fail_input("{} values of {} x {}", values.size(), rows, columns);
}

double MatrixPanels::bytes() const {
  return static_cast<double>(rows() * columns() * size_of(arithmetic()));
}

void MatrixPanels::for_each(const Work& work, double* squares) {
  if (arithmetic() == Arithmetic::f32) {
    stream(floats_, work, squares);
  } else {
    stream(doubles_, work, squares);
  }
}

template <typename T>
void MatrixPanels::stream(std::span<const T> values, const Work& work, double* squares) {
  const std::size_t largest = std::min(granule(), rows());
  std::vector<T> scaled(largest * columns());
  Buffer block(device_, scaled.size() * sizeof(T), "block of rows");
  Buffer panels(device_,
                ops::packed_elements(device_, largest, columns(), arithmetic()) * sizeof(T),
                "panels of rows");
  for (std::size_t first = 0; first < rows(); first += largest) {
    check_interrupt();
    const std::size_t count = std::min(largest, rows() - first);
    const std::span<T> part = std::span(scaled).first(count * columns());
    for (std::size_t i = 0; i < part.size(); ++i) {
      part[i] = static_cast<T>(static_cast<double>(values[first * columns() + i]) * scale_);
      if (squares) *squares += static_cast<double>(part[i]) * static_cast<double>(part[i]);
    }
    device_.finish();
    device_.write(block, std::span<const T>(part));
    ops::pack_panels(device_, ops::row_major(device_, block, columns(), 0, arithmetic()), count,
                     columns(), panels);
    work(panels, first, count);
  }
  device_.finish();
}

}  // namespace weft
