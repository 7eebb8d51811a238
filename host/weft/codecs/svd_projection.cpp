#include "weft/codecs/svd_projection.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "weft/codecs/svd_goal.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/gram.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/reals.hpp"
#include "weft/ops/sum_squares.hpp"
#include "weft/reference/factorise.hpp"

namespace weft {
namespace {

double tail_squares(std::span<const double> values, std::size_t k) {
  double sum = 0;
  for (std::size_t j = values.size(); j-- > k;) sum += values[j] * values[j];
  return sum;
}

// The first k columns of the m x m matrix of vectors, m x leading.
std::vector<double> leading_columns(const Spectrum& spectrum, std::size_t m, std::size_t k,
                                    std::size_t leading) {
  std::vector<double> V(m * leading, 0.0);
  for (std::size_t i = 0; i < m; ++i) {
    std::copy_n(spectrum.vectors.data() + i * m, k, V.data() + i * leading);
  }
  return V;
}

// Rows X - XV V^T of a block in place of its panels, and their squares.
class Remainder {
 public:
  // V: row-major m x k at `leading`.
  Remainder(Device& device, const PanelStream& stream, const Buffer& V, std::size_t k,
            std::size_t leading)
      : device_(device),
        arithmetic_(stream.arithmetic()),
        columns_(ops::round_up(stream.columns(), ops::panel_width(device, arithmetic_))),
        k_(k),
        leading_(leading),
        transposed_(device, k * columns_ * size_of(arithmetic_), "basis, transposed") {
    ops::pack_panels(device, ops::transposed(device, V, leading, 0, arithmetic_), k,
                     stream.columns(), transposed_);
  }

  double squares(Buffer& panels, const Buffer& XV, std::size_t first, std::size_t count) {
    ops::gemm_packed(device_, count, columns_, k_, -1.0,
                     ops::row_major(device_, XV, leading_, first * leading_, arithmetic_),
                     transposed_, 1.0, ops::to_panels(device_, panels, count, arithmetic_));
    return ops::sum_squares(device_, count * columns_, panels, arithmetic_);
  }

 private:
  Device& device_;
  Arithmetic arithmetic_;
  std::size_t columns_;
  std::size_t k_;
  std::size_t leading_;
  Buffer transposed_;
};

// X on k directions: V and XV row-major at `leading`; the squares of what is left, if measured.
struct Projection {
  Buffer V;
  Buffer XV;
  std::size_t leading = 0;
  double rest = 0;
};

Projection project_once(Device& device, PanelStream& stream, const Spectrum& spectrum,
                        std::size_t k, bool measure, std::size_t pass, Job& job) {
  const Arithmetic arithmetic = stream.arithmetic();
  const std::size_t m = stream.columns();
  Projection result;
  result.leading = leading_of(k);
  const double flops = (measure ? 4.0 : 2.0) * static_cast<double>(stream.rows()) *
                       static_cast<double>(m) * static_cast<double>(k);
  const StageTimer timer(job, "projection", flops, stream.bytes());
  result.V = ops::real_buffer(device, leading_columns(spectrum, m, k, result.leading), arithmetic,
                              "basis");
  result.XV = Buffer(device, row_major_bytes(device, stream.rows(), k, arithmetic), "projection");
  Buffer packed(device, ops::packed_elements(device, m, k, arithmetic) * size_of(arithmetic),
                "basis, packed");
  ops::pack_panels(device, ops::row_major(device, result.V, result.leading, 0, arithmetic), m, k,
                   packed);
  Remainder remainder(device, stream, result.V, k, result.leading);
  stream.for_each([&](Buffer& panels, std::size_t first, std::size_t count) {
    ops::gemm_packed(
        device, count, result.leading, m, 1.0, ops::panelled(device, panels, count, arithmetic),
        packed, 0.0,
        ops::to_row_major(device, result.XV, result.leading, first * result.leading, arithmetic));
    if (measure) result.rest += remainder.squares(panels, result.XV, first, count);
    job.advance(fmt::format("pass {}", pass), first + count, stream.rows());
  });
  return result;
}

}  // namespace

ScaledCholesky scaled_cholesky(std::size_t k, const std::vector<double>& gram) {
  ScaledCholesky result{std::vector<double>(k), std::vector<double>(k * k, 0.0)};
  std::vector<double> inverse(k, 0.0);
  for (std::size_t j = 0; j < k; ++j) {
    result.lengths[j] = std::sqrt(std::max(gram[j * k + j], 0.0));
    if (result.lengths[j] > 0) inverse[j] = 1 / result.lengths[j];
  }
  // row by row, each taken out of what is below it
  std::vector<double> left(k * k);
  for (std::size_t i = 0; i < k; ++i) {
    for (std::size_t j = i; j < k; ++j) left[i * k + j] = gram[i * k + j] * inverse[i] * inverse[j];
  }
  const double least = 1e-13 * static_cast<double>(k);
  for (std::size_t i = 0; i < k; ++i) {
    const double pivot = left[i * k + i];
    if (!(pivot > least)) continue;
    const double root = std::sqrt(pivot);
    double* row = result.R.data() + i * k;
    for (std::size_t j = i; j < k; ++j) row[j] = left[i * k + j] / root;
    for (std::size_t r = i + 1; r < k; ++r) {
      const double factor = row[r];
      if (factor == 0) continue;
      for (std::size_t j = r; j < k; ++j) left[r * k + j] -= factor * row[j];
    }
  }
  return result;
}

std::size_t row_major_bytes(const Device& device, std::size_t rows, std::size_t k,
                            Arithmetic arithmetic) {
  return (rows * leading_of(k) + ops::panel_width(device, arithmetic)) * size_of(arithmetic);
}

Buffer times_small(Device& device, std::size_t rows, std::size_t k, const ProductOf& A,
                   std::span<const double> S, std::size_t columns, Arithmetic arithmetic,
                   const char* what) {
  const std::size_t leading = leading_of(columns);
  Buffer C(device, row_major_bytes(device, rows, columns, arithmetic), what);
  const Buffer small = ops::real_buffer(device, S, arithmetic, "basis change");
  Buffer packed(device, ops::packed_elements(device, k, columns, arithmetic) * size_of(arithmetic),
                "basis change");
  ops::pack_panels(device, ops::row_major(device, small, columns, 0, arithmetic), k, columns,
                   packed);
  ops::gemm_packed(device, rows, columns, k, 1.0,
                   A.panelled ? ops::panelled(device, *A.buffer, rows, arithmetic)
                              : ops::row_major(device, *A.buffer, A.leading, 0, arithmetic),
                   packed, 0.0, ops::to_row_major(device, C, leading, 0, arithmetic));
  device.finish();
  return C;
}

double measured_residual(Device& device, PanelStream& stream, const Buffer& V, const Buffer& XV,
                         std::size_t k, std::size_t leading, Job& job) {
  const double flops = 2.0 * static_cast<double>(stream.rows()) *
                       static_cast<double>(stream.columns()) * static_cast<double>(k);
  const StageTimer timer(job, "convergence check", flops, stream.bytes());
  Remainder remainder(device, stream, V, k, leading);
  double squares = 0;
  stream.for_each([&](Buffer& panels, std::size_t first, std::size_t count) {
    squares += remainder.squares(panels, XV, first, count);
  });
  return std::sqrt(squares);
}

StreamedSvd project(Device& device, PanelStream& stream, const SvdTarget& target,
                    const Spectrum& spectrum, std::size_t margin, Job& job) {
  const Arithmetic arithmetic = stream.arithmetic();
  const std::size_t m = stream.columns();
  const std::size_t K = stream.rows();
  const std::size_t most = std::min({target.rank > 0 ? target.rank : m, m, K, target.most_columns});
  const double wanted = wanted_squares(target, spectrum.squares);
  const double floor = noise_floor(arithmetic, spectrum.squares, target);
  const double resolved = std::pow(resolved_error(arithmetic), 2) * spectrum.squares;
  StreamedSvd svd;
  svd.squares = spectrum.squares;
  if (spectrum.squares == 0) return svd;

  // as many directions as seem to be needed
  std::size_t k = most;
  if (target.has_goal()) {
    k = std::min(most, smallest_rank(spectrum.values, 0, wanted) + margin);
  }
  k = std::max<std::size_t>(k, 1);
  while (true) {
    const bool measure = wanted < 4 * resolved ||
                         (!target.has_goal() && tail_squares(spectrum.values, k) < 4 * resolved);
    Projection projection = project_once(device, stream, spectrum, k, measure, svd.passes + 2, job);
    ++svd.passes;
    const StageTimer timer(job, "basis");
    // Rayleigh-Ritz on the span: XV = (orthonormal) R D, R D = (orthogonal) diag(values) X^T
    const ops::Columns columns =
        ops::row_major_columns(device, projection.XV, projection.leading, k, arithmetic);
    const ScaledCholesky factor = scaled_cholesky(k, ops::gram(device, K, columns, columns));
    std::vector<double> R = factor.R;
    double projected = 0;
    for (std::size_t j = 0; j < k; ++j) {
      projected += factor.lengths[j] * factor.lengths[j];
      for (std::size_t i = 0; i <= j; ++i) R[i * k + j] *= factor.lengths[j];
    }
    const reference::ThinSvd ritz = reference::thin_svd(k, k, R);
    double rest = measure ? projection.rest : std::max(spectrum.squares - projected, 0.0);
    // what is only noise is left
    std::size_t kept = 0;
    while (kept < k && ritz.values[kept] > floor) ++kept;
    rest += tail_squares(ritz.values, kept);
    const std::span<const double> values = std::span(ritz.values).first(kept);
    if (target.has_goal()) {
      const std::size_t enough = smallest_rank(values, rest, wanted);
      if (enough > kept) {
        if (k < most) {
          k = std::min(most, 2 * k);
          continue;
        }
        fail_unmet(
            target, spectrum.squares, rest, kept,
            most == target.rank ? "the most that --rank allows"
            : most < std::min(m, K)
                ? memory_binds(most, static_cast<double>(smallest_rank(spectrum.values, 0, wanted)),
                               job.memory)
                : "all that this arithmetic resolves");
      }
      rest += tail_squares(values, enough);
      kept = enough;
    }
    svd.residual = std::sqrt(rest);
    svd.rank = kept;
    svd.values.assign(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(kept));
    if (kept == 0) return svd;
    std::vector<double> turn(k * kept);
    for (std::size_t i = 0; i < k; ++i) {
      std::copy_n(ritz.V.data() + i * k, kept, turn.data() + i * kept);
    }
    svd.leading = leading_of(kept);
    svd.V = times_small(device, m, k, {&projection.V, false, projection.leading}, turn, kept,
                        arithmetic, "right vectors");
    svd.XV = times_small(device, K, k, {&projection.XV, false, projection.leading}, turn, kept,
                         arithmetic, "projection");
    return svd;
  }
}

}  // namespace weft
