#include "weft/codecs/slice_rows.hpp"

#include <algorithm>
#include <array>
#include <functional>
#include <numeric>
#include <optional>

#include "weft/error.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

// Values of a block: few enough to stay in a large cache.
constexpr std::size_t block_values = std::size_t{1} << 20;
// Columns that are summed in float: a batch of such products keeps all compute units busy.
constexpr std::size_t summed_columns = 2048;

std::size_t block_width(std::size_t rows, std::size_t length) {
  const std::size_t width = std::max(summed_columns, block_values / std::max<std::size_t>(1, rows));
  return std::min(length, width / summed_columns * summed_columns);
}

std::size_t rows_at_once(std::size_t rows, std::size_t longest) {
  constexpr std::size_t most_values = std::size_t{4} << 20;
  return std::clamp<std::size_t>(most_values / std::max<std::size_t>(1, longest), 1, rows);
}

// Whether rows lie one behind the other.
bool are_neighbours(const RowList& rows, std::size_t length) {
  for (std::size_t i = 1; i < rows.size(); ++i) {
    if (rows[i] != rows[i - 1] + length) return false;
  }
  return !rows.empty();
}

// Columns of rows on the device: where they lie if it can read them there, else one row behind the
// other in a buffer.
class Block {
 public:
  Block(Device& device, const RowList& rows, std::size_t length, std::size_t most)
      : device_(device), unified_(device.limits().unified_memory), rows_(rows) {
    const std::size_t values = rows.size() * length;
    if (unified_ && are_neighbours(rows, length) &&
        values <= device.limits().largest_allocation / sizeof(float)) {
      stride_ = length;
      buffer_ = Buffer::wrap(device, std::as_bytes(std::span(rows[0], values)), "rows");
      return;
    }
    values_.resize(std::max<std::size_t>(1, most));
    if (!unified_) buffer_ = Buffer(device, values_.size() * sizeof(float), "block of rows");
  }

  // Columns [first, first + width) of all rows.
  ops::ConstMatrix columns(std::size_t first, std::size_t width) {
    if (stride_ > 0) return {buffer_, stride_, first};
    float* to = values_.data();
    for (const float* row : rows_) to = std::copy_n(row + first, width, to);
    const auto block = std::span<const float>(values_).first(rows_.size() * width);
    if (unified_) {
      buffer_ = Buffer::wrap(device_, std::as_bytes(block), "block of rows");
    } else {
      device_.write(buffer_, block);
    }
    return {buffer_, width, 0};
  }

 private:
  Device& device_;
  bool unified_;
  const RowList& rows_;
  std::size_t stride_ = 0;  // of rows that are read where they lie
  std::vector<float> values_;
  Buffer buffer_;
};

double sum_of_squares(std::span<const float> a) {
  constexpr std::size_t lanes = 8;
  std::array<double, lanes> sums{};
  std::size_t i = 0;
  for (; i + lanes <= a.size(); i += lanes) {
    for (std::size_t k = 0; k < lanes; ++k) sums[k] += double{a[i + k]} * double{a[i + k]};
  }
  for (; i < a.size(); ++i) sums[0] += double{a[i]} * double{a[i]};
  return std::accumulate(sums.begin(), sums.end(), 0.0);
}

Buffer matrix_buffer(Device& device, std::span<const float> M) {
  Buffer buffer(device, std::max<std::size_t>(1, M.size()) * sizeof(float), "matrix of rows");
  if (!M.empty()) device.write(buffer, M);
  return buffer;
}

// Rows where they lie, if the device reads them there: the memory from the first to the last.
struct RowsInPlace {
  Buffer values;
  std::vector<cl_ulong> at;
};

RowsInPlace in_place(Device& device, const RowList& rows, std::size_t length) {
  RowsInPlace found;
  if (!device.limits().unified_memory || !device.limits().is_cpu || rows.empty()) return found;
  const auto [first, last] = std::minmax_element(rows.begin(), rows.end(), std::less<>());
  const auto span = static_cast<std::size_t>(*last - *first) + length;
  if (span > device.limits().largest_allocation / sizeof(float)) return found;
  found.values = Buffer::wrap(device, std::as_bytes(std::span(*first, span)), "rows");
  for (const float* row : rows) found.at.push_back(static_cast<cl_ulong>(row - *first));
  return found;
}

// base + M rows, of rows that the device reads where they lie.
class PlacedSum {
 public:
  PlacedSum(Device& device, std::size_t length, std::size_t count, const RowList& base,
            std::span<const float> M, const RowList& rows)
      : terms_(in_place(device, rows, length)), base_(in_place(device, base, length)) {
    if (terms_.at.empty() || (!base.empty() && base_.at.empty())) return;
    sums_.emplace(device, terms_.values, terms_.at, base.empty() ? nullptr : &base_.values,
                  base_.at, M, count);
  }
  explicit operator bool() const { return sums_.has_value(); }
  void columns(std::size_t first, std::size_t width, Buffer& out) {
    sums_->columns(first, width, out);
  }

 private:
  RowsInPlace terms_, base_;
  std::optional<ops::RowSums> sums_;
};

// Calls use(first, width, block) with blocks of base + M rows, `count` of them.
template <typename Use>
void for_each_sum(Device& device, std::size_t length, std::size_t count, const RowList& base,
                  std::span<const float> M, const RowList& rows, const Use& use) {
  const std::size_t most = block_width(rows.size() + count, length);
  std::vector<float> values(count * most, 0.0f);
  Buffer out =
      device.limits().unified_memory
          ? Buffer::wrap_writable(device, std::as_writable_bytes(std::span(values)), "sums of rows")
          : Buffer(device, count * most * sizeof(float), "sums of rows");
  PlacedSum placed(device, length, count, base, M, rows);
  std::optional<Block> in;
  Buffer matrix;
  if (!placed && !rows.empty()) {
    in.emplace(device, rows, length, rows.size() * most);
    matrix = matrix_buffer(device, M);
  }
  for (std::size_t first = 0; first < length; first += most) {
    check_interrupt();
    const std::size_t width = std::min(most, length - first);
    const auto block = std::span(values).first(count * width);
    if (placed) {
      placed.columns(first, width, out);
      device.read(out, block);
    } else {
      std::fill(block.begin(), block.end(), 0.0f);
      if (in) {
        ops::gemm(device, ops::Transpose::no, ops::Transpose::no, count, width, rows.size(), 1.0,
                  {matrix, rows.size()}, in->columns(first, width), 0.0, {out, width});
        device.read(out, block);
      }
      for (std::size_t i = 0; i < base.size(); ++i) {
        for (std::size_t p = 0; p < width; ++p) block[i * width + p] += base[i][first + p];
      }
    }
    use(first, width, std::span<const float>(block));
  }
}

// A A^T, [a][a].
std::vector<double> row_gram(Device& device, std::size_t length, const RowList& A) {
  const std::size_t a = A.size();
  const std::size_t most = block_width(a, length);
  Block block(device, A, length, a * most);
  Buffer product(device, a * a * sizeof(float), "products of rows");
  std::vector<float> part(a * a);
  std::vector<double> sums(a * a, 0.0);
  for (std::size_t first = 0; first < length; first += most) {
    check_interrupt();
    const std::size_t width = std::min(most, length - first);
    ops::syrk(device, ops::Triangle::lower, ops::Transpose::no, a, width, 1.0,
              block.columns(first, width), 0.0, {product, a});
    device.read(product, std::span(part));
    for (std::size_t i = 0; i < a; ++i) {
      for (std::size_t j = 0; j <= i; ++j) sums[i * a + j] += double{part[i * a + j]};
    }
  }
  for (std::size_t i = 0; i < a; ++i) {
    for (std::size_t j = i + 1; j < a; ++j) sums[i * a + j] = sums[j * a + i];
  }
  return sums;
}

}  // namespace

RowList row_list(std::span<const float> values, std::size_t rows, std::size_t length) {
  RowList list;
  for (std::size_t i = 0; i < rows; ++i) list.push_back(values.data() + i * length);
  return list;
}

RowList picked(const RowList& rows, std::span<const std::size_t> numbers) {
  RowList list;
  for (const std::size_t number : numbers) list.push_back(rows[number]);
  return list;
}

std::vector<double> row_products(Device& device, std::size_t length, const RowList& A,
                                 const RowList& B) {
  const std::size_t a = A.size();
  const std::size_t b = B.size();
  std::vector<double> sums(a * b, 0.0);
  if (sums.empty()) return sums;
  if (A == B) return row_gram(device, length, A);
  const std::size_t most = block_width(a + b, length);
  const std::size_t parts = ops::ceil_div(most, summed_columns);
  Block left(device, A, length, a * most);
  Block right(device, B, length, b * most);
  Buffer product(device, parts * a * b * sizeof(float), "products of rows");
  std::vector<float> part(parts * a * b);
  for (std::size_t first = 0; first < length; first += most) {
    check_interrupt();
    const std::size_t width = std::min(most, length - first);
    const ops::ConstMatrix mine = left.columns(first, width);
    const ops::ConstMatrix others = right.columns(first, width);
    // `count` products of so many columns each, the first of them the `to`-th
    const auto multiply = [&](std::size_t offset, std::size_t columns, std::size_t count,
                              std::size_t to) {
      ops::ProductOptions options;
      options.batch = count;
      ops::gemm(device, ops::Transpose::no, ops::Transpose::yes, a, b, columns, 1.0,
                {mine.buffer, mine.leading, mine.offset + offset, columns},
                {others.buffer, others.leading, others.offset + offset, columns}, 0.0,
                {product, b, to * a * b, a * b}, options);
    };
    const std::size_t whole = width / summed_columns;
    const std::size_t rest = width - whole * summed_columns;
    if (whole > 0) multiply(0, summed_columns, whole, 0);
    if (rest > 0) multiply(whole * summed_columns, rest, 1, whole);
    const std::size_t count = whole + (rest > 0 ? 1 : 0);
    device.read(product, std::span(part).first(count * a * b));
    for (std::size_t p = 0; p < count; ++p) {
      for (std::size_t i = 0; i < a * b; ++i) sums[i] += double{part[p * a * b + i]};
    }
  }
  return sums;
}

void combine_rows(Device& device, std::size_t length, const RowList& base, std::span<const float> M,
                  const RowList& rows, float* out) {
  const std::size_t count = rows.empty() ? base.size() : M.size() / rows.size();
  if (count * length <= device.limits().largest_allocation / sizeof(float)) {
    if (PlacedSum placed(device, length, count, base, M, rows); placed) {
      const std::span<float> to(out, count * length);
      Buffer result = Buffer::wrap_writable(device, std::as_writable_bytes(to), "sums of rows");
      placed.columns(0, length, result);
      device.read(result, to);
      return;
    }
  }
  for_each_sum(device, length, count, base, M, rows,
               [&](std::size_t first, std::size_t width, std::span<const float> block) {
                 for (std::size_t i = 0; i < count; ++i) {
                   std::copy_n(block.data() + i * width, width, out + i * length + first);
                 }
               });
}

std::vector<double> combined_squares(Device& device, std::size_t length, const RowList& base,
                                     std::span<const float> M, const RowList& rows) {
  std::vector<double> sums(base.size(), 0.0);
  for_each_sum(device, length, base.size(), base, M, rows,
               [&](std::size_t, std::size_t width, std::span<const float> block) {
                 for (std::size_t i = 0; i < base.size(); ++i) {
                   sums[i] += sum_of_squares(block.subspan(i * width, width));
                 }
               });
  return sums;
}

void multiply_modes(Device& device, std::vector<std::size_t> sizes, const RowList& rows,
                    std::span<const RowProduct> products, float* out) {
  const std::size_t length = product(sizes);
  std::size_t longest = length;
  std::vector<Buffer> factors;
  std::vector<std::size_t> after = sizes;
  for (const RowProduct& step : products) {
    factors.push_back(matrix_buffer(device, step.factor));
    after[step.axis] = step.other_size;
    longest = std::max(longest, product(after));
  }
  const std::size_t result = product(after);
  if (products.empty()) {
    for (std::size_t i = 0; i < rows.size(); ++i) std::copy_n(rows[i], length, out + i * length);
    return;
  }
  const std::size_t at_once = rows_at_once(rows.size(), longest);
  // the last product is written where it is to be if the device can do that
  const bool unified = device.limits().unified_memory;
  Buffer between[2];
  for (std::size_t i = 0; i < std::min<std::size_t>(2, products.size() - (unified ? 1 : 0)); ++i) {
    between[i] = Buffer(device, at_once * longest * sizeof(float), "rows on the way");
  }
  for (std::size_t first = 0; first < rows.size(); first += at_once) {
    check_interrupt();
    const std::size_t count = std::min(at_once, rows.size() - first);
    // mode products take tensors one behind the other
    const RowList part(rows.begin() + static_cast<std::ptrdiff_t>(first),
                       rows.begin() + static_cast<std::ptrdiff_t>(first + count));
    Block in(device, part, length, count * length);
    const Buffer* from = &in.columns(0, length).buffer;
    std::vector<std::size_t> block = sizes;
    block.insert(block.begin(), count);
    const std::span<float> to(out + first * result, count * result);
    Buffer last;
    if (unified) last = Buffer::wrap_writable(device, std::as_writable_bytes(to), "rows");
    for (std::size_t s = 0; s < products.size(); ++s) {
      const RowProduct& step = products[s];
      Buffer& into = unified && s + 1 == products.size() ? last : between[s % 2];
      ops::mode_product(device, ops::mode_view(block, step.axis + 1), *from, step.kind, factors[s],
                        step.other_size, into);
      block[step.axis + 1] = step.other_size;
      from = &into;
    }
    device.read(*from, to);
  }
}

void count_products(Stage& stage, std::size_t a, std::size_t b, std::size_t length) {
  stage.flops += 2 * static_cast<double>(a * b) * static_cast<double>(length);
  stage.bytes += static_cast<double>((a + b) * length * sizeof(float));
}

void count_sums(Stage& stage, std::size_t base, std::size_t out, std::size_t rows,
                std::size_t length) {
  stage.flops += 2 * static_cast<double>(out * rows) * static_cast<double>(length);
  stage.bytes += static_cast<double>((base + out + rows) * length * sizeof(float));
}

void count_modes(Stage& stage, std::size_t rows, std::vector<std::size_t> sizes,
                 std::span<const RowProduct> products) {
  for (const RowProduct& step : products) {
    const std::size_t before = rows * product(sizes);
    const std::size_t terms = sizes[step.axis];
    sizes[step.axis] = step.other_size;
    const std::size_t after = rows * product(sizes);
    stage.flops += 2 * static_cast<double>(after) * static_cast<double>(terms);
    stage.bytes += static_cast<double>((before + after) * sizeof(float));
  }
}

std::size_t row_products_bytes(const Device& device, std::size_t rows, std::size_t longest) {
  const std::size_t blocks = std::max(block_values, rows * summed_columns);
  const std::size_t columns =
      3 * std::min(blocks, rows * longest) +
      2 * rows * rows * ops::ceil_div(blocks / std::max<std::size_t>(1, rows), summed_columns);
  const std::size_t modes = 4 * longest * rows_at_once(rows, longest);
  // products pack up to 8 MiB of either operand, or one panel
  const std::size_t packed =
      std::max(ops::product_bytes(device, std::min(longest, block_values), rows),
               ops::product_bytes(device, rows, summed_columns));
  return std::max(columns, modes) * sizeof(float) + packed + (std::size_t{16} << 20);
}

}  // namespace weft
