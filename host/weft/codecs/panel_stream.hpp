// A matrix that is streamed through a device block of rows by block of rows, as the factorisations
// of streamed_svd.hpp take it.
#pragma once

#include <cstddef>
#include <functional>
#include <span>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"

namespace weft {

// X: K rows, m columns, in packed panels [ceil(m / NR)][rows of a block][NR], zero past the last
// column. The values are those of the data times scale(), a power of two that brings them near 1.
// Blocks have `granule` rows, the last may have fewer: a function of the shape alone.
class PanelStream {
 public:
  PanelStream(std::size_t rows, std::size_t columns, std::size_t granule, Arithmetic arithmetic)
      : rows_(rows), columns_(columns), granule_(granule), arithmetic_(arithmetic) {}
  virtual ~PanelStream() = default;
  PanelStream(const PanelStream&) = delete;
  PanelStream& operator=(const PanelStream&) = delete;

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }
  std::size_t granule() const { return granule_; }
  Arithmetic arithmetic() const { return arithmetic_; }
  virtual double scale() const = 0;

  // Bytes that one pass reads, for reports.
  virtual double bytes() const = 0;

  // Calls work(panels, first row, rows) for all blocks in order. `work` enqueues kernels, may
  // overwrite the panels, and need not wait. With `squares`, |X|^2 is added to it.
  using Work = std::function<void(Buffer& panels, std::size_t first, std::size_t count)>;
  virtual void for_each(const Work& work, double* squares = nullptr) = 0;

 private:
  std::size_t rows_;
  std::size_t columns_;
  std::size_t granule_;
  Arithmetic arithmetic_;
};

// A matrix in host memory, row-major; its arithmetic is that of its values. The values must outlive
// it and be finite.
class MatrixPanels final : public PanelStream {
 public:
  MatrixPanels(Device& device, std::size_t rows, std::size_t columns, std::span<const float> values,
               std::size_t granule);
  MatrixPanels(Device& device, std::size_t rows, std::size_t columns,
               std::span<const double> values, std::size_t granule);

  double scale() const override { return scale_; }
  double bytes() const override;
  void for_each(const Work& work, double* squares) override;

 private:
  template <typename T>
  void stream(std::span<const T> values, const Work& work, double* squares);

  Device& device_;
  std::span<const float> floats_;
  std::span<const double> doubles_;
  double scale_;
};

}  // namespace weft
