#include "weft/codecs/texel_factors.hpp"

#include <algorithm>
#include <span>

#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"

namespace weft {
namespace {

constexpr std::size_t widest_panel = 48;

// Slices on the way from one factor to the next: so few that they stay in a core's own caches.
std::size_t slices_at_once(const TuckerCore& core) {
  constexpr std::size_t most_values = std::size_t{1} << 18;
  const std::size_t values =
      core.channels * std::max(core.rows * ops::round_up(core.width, widest_panel),
                               core.columns * ops::round_up(core.height, widest_panel));
  return std::max<std::size_t>(1, most_values / values);
}

// Rows before columns: fewer flops, (a b A + A b B) against (a b B + a A B).
bool rows_first(const TuckerCore& core) {
  return core.rows * core.columns * core.height + core.height * core.columns * core.width <=
         core.rows * core.columns * core.width + core.rows * core.height * core.width;
}

// The transpose of a factor U [size][rank] in panels.
Buffer packed_factor(Device& device, const std::vector<float>& factor, std::size_t size,
                     std::size_t rank) {
  Buffer plain(device, factor.size() * sizeof(float), "factor");
  device.write(plain, std::span<const float>(factor));
  Buffer packed(device, ops::packed_elements(device, rank, size) * sizeof(float), "factor");
  ops::pack_panels(device, ops::transposed(device, plain, rank), rank, size, packed);
  device.finish();
  return packed;
}

}  // namespace

TuckerCore::TuckerCore(const TuckerModel& model) {
  const std::vector<ModeGroup>& groups = model.groups.groups();
  const auto factor = [&](std::size_t n) {
    return model.has_factor(n) ? &model.factors[n] : nullptr;
  };
  views_alone = groups[0].modes.size() == 1;
  light_group = views_alone ? 1 : 0;
  if (views_alone) views = model.ranks[0];
  lights = model.ranks[light_group];
  if (groups[light_group].has(Mode::channel)) light_channels = model.info.btf.shape.channels;
  std::size_t n = light_group + 1;
  channels_alone = groups[n].modes.size() == 1 && groups[n].has(Mode::channel);
  if (channels_alone) {
    channels = model.ranks[n];
    of_channels = factor(n++);
  }
  if (n + 1 < groups.size()) {
    rows = model.ranks[n];
    height = groups[n].size;
    of_rows = factor(n++);
  }
  columns = model.ranks[n];
  width = groups[n].size;
  of_columns = factor(n);
}

TexelFactors::TexelFactors(Device& device, const TuckerCore& core)
    : device_(device),
      channels_(core.channels),
      a_(core.rows),
      b_(core.columns),
      A_(core.height),
      B_(core.width),
      rows_first_(rows_first(core)) {
  if (core.of_columns) columns_ = packed_factor(device, *core.of_columns, B_, b_);
  if (!core.of_rows) return;
  if (columns_ && rows_first_) {
    rows_ = packed_factor(device, *core.of_rows, A_, a_);
  } else {
    rows_ = Buffer(device, core.of_rows->size() * sizeof(float), "factor");
    device.write(rows_, std::span<const float>(*core.of_rows));
  }
  const std::size_t columns = columns_ && rows_first_ ? A_ : columns_ ? B_ : b_;
  const std::size_t rows = columns_ && rows_first_ ? b_ : a_;
  between_ = Buffer(device,
                    slices_at_once(core) * channels_ * ops::packed_elements(device, rows, columns) *
                        sizeof(float),
                    "slices between factors");
}

void TexelFactors::expand(const Buffer& from, std::size_t offset, std::size_t count, Buffer& to,
                          std::size_t to_offset) {
  const auto rows_of = [&](const Buffer& buffer, std::size_t leading, std::size_t first,
                           std::size_t batch) {
    ops::Operand operand = ops::row_major(device_, buffer, leading, first);
    operand.batch = batch;
    return operand;
  };
  if (!rows_) {
    ops::gemm_packed(device_, count * channels_ * a_, B_, b_, 1, rows_of(from, b_, offset, 0),
                     columns_, 0, ops::to_row_major(device_, to, B_, to_offset));
    return;
  }
  const std::size_t columns = columns_ ? B_ : b_;  // of the result
  const std::size_t between =
      columns_ && rows_first_ ? b_ * A_ : ops::packed_elements(device_, a_, columns);
  const std::size_t at_once = between_.size() / sizeof(float) / (channels_ * between);
  for (std::size_t first = 0; first < count; first += at_once) {
    const std::size_t batch = std::min(at_once, count - first) * channels_;
    const std::size_t begin = offset + first * channels_ * a_ * b_;
    ops::Result result =
        ops::to_row_major(device_, to, columns, to_offset + first * channels_ * A_ * columns);
    result.batch = A_ * columns;
    if (columns_ && rows_first_) {
      // (T^T U_rows^T)^T U_columns^T
      ops::Operand T = ops::transposed(device_, from, b_, begin);
      T.batch = a_ * b_;
      ops::Result turned = ops::to_row_major(device_, between_, A_);
      turned.batch = b_ * A_;
      ops::gemm_packed(device_, b_, A_, a_, 1, T, {rows_, 0, true}, 0, turned, batch);
      ops::Operand half = ops::transposed(device_, between_, A_);
      half.batch = b_ * A_;
      ops::gemm_packed(device_, A_, B_, b_, 1, half, {columns_, 0, true}, 0, result, batch);
      continue;
    }
    if (columns_) {
      // U_rows (T U_columns^T), the product in brackets in panels
      ops::Result panels = ops::to_panels(device_, between_, a_);
      panels.batch = between;
      ops::gemm_packed(device_, a_, ops::round_up(B_, ops::panel_width(device_)), b_, 1,
                       rows_of(from, b_, begin, a_ * b_), {columns_, 0, true}, 0, panels, batch);
    } else {
      ops::pack_panels(device_, rows_of(from, b_, begin, a_ * b_), a_, b_, between_, batch);
    }
    ops::gemm_packed(device_, A_, columns, a_, 1, rows_of(rows_, a_, 0, 0), between_, 0, result,
                     batch);
  }
}

double TexelFactors::flops(const TuckerCore& core) {
  const double a = static_cast<double>(core.rows), b = static_cast<double>(core.columns);
  const double A = static_cast<double>(core.height), B = static_cast<double>(core.width);
  const double channels = static_cast<double>(core.channels);
  if (core.of_rows && core.of_columns) {
    return 2 * channels * (rows_first(core) ? a * b * A + A * b * B : a * b * B + a * A * B);
  }
  return core.of_rows ? 2 * channels * a * A * b : core.of_columns ? 2 * channels * a * b * B : 0;
}

double TexelFactors::traffic(const TuckerCore& core) {
  if (!core.of_rows && !core.of_columns) return 0;
  return static_cast<double>(core.slice() + core.expanded());
}

std::size_t TexelFactors::bytes(const TuckerCore& core) {
  std::size_t values = 0;
  if (core.of_rows) {
    values += core.rows * ops::round_up(core.height, widest_panel) +
              slices_at_once(core) * core.channels *
                  std::max(core.rows * ops::round_up(core.width, widest_panel),
                           core.columns * ops::round_up(core.height, widest_panel));
  }
  if (core.of_columns) values += core.columns * ops::round_up(core.width, widest_panel);
  return values * sizeof(float);
}

}  // namespace weft
