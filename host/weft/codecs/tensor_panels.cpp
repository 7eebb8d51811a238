#include "weft/codecs/tensor_panels.hpp"

#include <algorithm>
#include <utility>

#include "weft/btf/slab.hpp"
#include "weft/device/read_ahead.hpp"
#include "weft/error.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/mode_product.hpp"
#include "weft/ops/sum_squares.hpp"
#include "weft/ops/unfold_tile.hpp"

namespace weft {
namespace {

std::size_t product_of(const BtfShape& shape, const std::vector<Mode>& modes) {
  std::size_t product = 1;
  for (const Mode mode : modes) product *= mode_size(shape, mode);
  return product;
}

// What a slab of `count` indices is on its way: [column free][column bound][rows free][rows bound].
struct SlabSizes {
  std::size_t column_free = 1, column_bound = 1, column_rank = 1;
  std::size_t row_free = 1, row_bound = 1, row_rank = 1;

  std::size_t raw() const { return column_free * column_bound * row_free * row_bound; }
  std::size_t columns_projected() const { return column_free * column_rank * row_free * row_bound; }
  std::size_t projected() const { return column_free * column_rank * row_free * row_rank; }
};

SlabSizes slab_sizes(const BtfShape& shape, const ModeSide& rows, const ModeSide& columns,
                     const SlabShape& slab, std::size_t count) {
  return {columns.free_size(shape),
          columns.bound_size(shape),
          columns.rank,
          rows.free_size(shape) / mode_size(shape, slab.cut) * count,
          rows.bound_size(shape),
          rows.rank};
}

class TensorPanels final : public PanelStream {
 public:
  TensorPanels(Device& device, TileSource& source, ModeSide rows, ModeSide columns, float scale,
               const Job& job)
      : PanelStream(rows.size(source.info().shape), columns.size(source.info().shape),
                    granule_of(source.info().shape, rows), Arithmetic::f32),
        device_(device),
        source_(source),
        rows_(std::move(rows)),
        columns_(std::move(columns)),
        slab_(slab_shape(source.info().shape, rows_)),
        scale_(scale),
        nan_zero_(job.nan_zero) {
    std::size_t n = 0;
    for (const std::vector<Mode>& group :
         {columns_.free, columns_.bound, row_modes(source.info().shape, rows_), rows_.bound}) {
      for (const Mode mode : group) order_[n++] = mode;
    }
    if (n != mode_count) fail_runtime("an unfolding of {} modes instead of {}", n, mode_count);
  }

  double scale() const override { return static_cast<double>(scale_); }
  double bytes() const override { return static_cast<double>(source_.info().bytes()); }

  void for_each(const Work& work, double* squares) override {
    const BtfInfo& info = source_.info();
    const SlabSizes largest = sizes(std::min(slab_.count, mode_size(info.shape, slab_.cut)));
    Buffer values(device_, largest.raw() * sizeof(float), "slab");
    const Buffer row_basis = basis_buffer(rows_);
    const Buffer column_basis = basis_buffer(columns_);
    Buffer half, full;
    if (column_basis) half = Buffer(device_, largest.columns_projected() * sizeof(float), "slab");
    if (row_basis) full = Buffer(device_, largest.projected() * sizeof(float), "slab");
    Buffer panels(device_,
                  ops::packed_elements(device_, largest.row_free * largest.row_rank, columns()) *
                      sizeof(float),
                  "panels of a slab");
    const std::size_t whole = mode_size(info.shape, slab_.cut);
    const auto count = [&](std::size_t run) {
      return std::min(slab_.count, whole - run * slab_.count);
    };
    for_each_run(
        device_, ops::ceil_div(whole, slab_.count), largest.raw() * size_of(info.dtype),
        [&](std::size_t run, std::span<std::byte> slot) {
          const std::size_t bytes = sizes(count(run)).raw() * size_of(info.dtype);
          read_slab(source_, {slab_.cut, run * slab_.count, count(run)}, order_, slot.first(bytes));
          return bytes;
        },
        [&](std::size_t run, const Buffer& raw) {
          const SlabSizes slab = sizes(count(run));
          ops::unfold_tile(device_, {1, slab.raw(), 0, slab.raw(), 1, info.dtype, nan_zero_, false},
                           raw, scale_, values);
          const Buffer* tensor = &values;
          if (column_basis) {
            ops::mode_product(
                device_, {slab.column_free, slab.column_bound, slab.row_free * slab.row_bound},
                *tensor, ops::ModeProduct::project, column_basis, slab.column_rank, half);
            tensor = &half;
          }
          if (row_basis) {
            ops::mode_product(
                device_, {slab.column_free * slab.column_rank * slab.row_free, slab.row_bound, 1},
                *tensor, ops::ModeProduct::project, row_basis, slab.row_rank, full);
            tensor = &full;
          }
          const std::size_t rows = slab.row_free * slab.row_rank;
          ops::pack_panels(device_, ops::transposed(device_, *tensor, rows), rows, columns(),
                           panels);
          if (squares) {
            *squares += ops::sum_squares(device_, ops::packed_elements(device_, rows, columns()),
                                         panels, Arithmetic::f32);
          }
          work(panels, run * granule(), rows);
        });
    device_.finish();
  }

 private:
  static std::size_t granule_of(const BtfShape& shape, const ModeSide& rows) {
    const SlabShape slab = slab_shape(shape, rows);
    return rows.size(shape) / mode_size(shape, slab.cut) * slab.count;
  }
  SlabSizes sizes(std::size_t count) const {
    return slab_sizes(source_.info().shape, rows_, columns_, slab_, count);
  }
  Buffer basis_buffer(const ModeSide& side) {
    if (side.basis.empty()) return {};
    Buffer buffer(device_, side.basis.size() * sizeof(float), "basis");
    device_.write(buffer, std::span<const float>(side.basis));
    return buffer;
  }

  Device& device_;
  TileSource& source_;
  ModeSide rows_;
  ModeSide columns_;
  SlabShape slab_;
  ModeOrder order_{};
  float scale_;
  bool nan_zero_;
};

}  // namespace

std::size_t ModeSide::free_size(const BtfShape& shape) const {
  return product_of(shape, free);
}

std::size_t ModeSide::bound_size(const BtfShape& shape) const {
  return product_of(shape, bound);
}

void sort_modes(std::vector<Mode>& modes) {
  std::sort(modes.begin(), modes.end());
}

SlabShape slab_shape(const BtfShape& shape, const ModeSide& rows) {
  constexpr std::size_t most_values = std::size_t{8} << 20;
  // The slowest mode in storage, unless a slab of one of its indices is too large.
  SlabShape slab{rows.free.front(), 1};
  const auto values = [&](Mode mode) { return shape.values() / mode_size(shape, mode); };
  for (const Mode mode : rows.free) {
    if (values(slab.cut) <= 4 * most_values) break;
    if (values(mode) < values(slab.cut)) slab.cut = mode;
  }
  slab.count =
      std::clamp<std::size_t>(most_values / values(slab.cut), 1, mode_size(shape, slab.cut));
  return slab;
}

std::vector<Mode> row_modes(const BtfShape& shape, const ModeSide& rows) {
  std::vector<Mode> modes{slab_shape(shape, rows).cut};
  for (const Mode mode : rows.free) {
    if (mode != modes.front()) modes.push_back(mode);
  }
  return modes;
}

std::unique_ptr<PanelStream> tensor_panels(Device& device, TileSource& source, ModeSide rows,
                                           ModeSide columns, float scale, const Job& job) {
  return std::make_unique<TensorPanels>(device, source, std::move(rows), std::move(columns), scale,
                                        job);
}

std::size_t tensor_panels_bytes(const Device& device, const BtfInfo& info, const ModeSide& rows,
                                const ModeSide& columns) {
  const SlabShape slab = slab_shape(info.shape, rows);
  const SlabSizes sizes = slab_sizes(info.shape, rows, columns, slab, slab.count);
  std::size_t floats = sizes.raw() + ops::packed_elements(device, sizes.row_free * sizes.row_rank,
                                                          columns.size(info.shape));
  if (!columns.basis.empty()) floats += columns.basis.size() + sizes.columns_projected();
  if (!rows.basis.empty()) floats += rows.basis.size() + sizes.projected();
  return floats * sizeof(float) + info.image_bytes() +
         read_ahead_bytes(device, sizes.raw() * size_of(info.dtype));
}

}  // namespace weft
