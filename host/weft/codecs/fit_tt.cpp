#include "weft/codecs/fit_tt.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "weft/btf/slab.hpp"
#include "weft/codecs/choose_svd.hpp"
#include "weft/codecs/scan_source.hpp"
#include "weft/codecs/streamed_svd.hpp"
#include "weft/codecs/svd_goal.hpp"
#include "weft/codecs/svd_methods.hpp"
#include "weft/codecs/tensor_panels.hpp"
#include "weft/error.hpp"
#include "weft/ops/reals.hpp"
#include "weft/reference/tile.hpp"
#include "weft/tensor/permute.hpp"

namespace weft {
namespace {

constexpr std::size_t last_mode = mode_count - 1;

// The columns of a goal's basis that memory holds beside the slabs, with what a cut leaves: two
// copies here and one on the device.
std::size_t goal_columns(const Device& device, const StreamShape& shape, const SvdTarget& target,
                         const Job& job) {
  return columns_within(device, shape, target, 3 * (shape.rows + shape.columns) * sizeof(float),
                        job.memory / 4 * 3);
}

enum class End { left, right };

// Rows of blocks of a matrix in memory.
std::size_t matrix_granule(std::size_t columns) {
  constexpr std::size_t values = std::size_t{4} << 20;
  return std::max<std::size_t>(values / columns, 64);
}

// Which way to factorise a matrix with so many columns, the short side.
SvdMethod method_for(std::size_t columns, double tolerance, std::size_t rank) {
  constexpr std::size_t small_side = 2560;  // for which the host's part is a matter of seconds
  constexpr std::size_t least_side = 256;
  if (columns > most_dense_columns) return SvdMethod::randomized;
  if (tolerance > 0) {
    if (columns > small_side && tolerance >= 1e-5) return SvdMethod::randomized;
    return tolerance >= gram_safe_error(Arithmetic::f32) ? SvdMethod::gram : SvdMethod::qr;
  }
  // for few of many directions some passes cost less than one for all
  if (columns > small_side && columns > 4 * rank) return SvdMethod::randomized;
  return columns > least_side ? SvdMethod::gram : SvdMethod::qr;
}

// The end that the input is cut at.
End streamed_end(const std::array<std::size_t, mode_count>& sizes) {
  return sizes[0] * sizes[1] < sizes[last_mode - 1] * sizes[last_mode] ? End::left : End::right;
}

// X ~ XV V^T on the host; the values are those of the tensor, not of the scaled stream.
struct Factors {
  std::size_t rank = 0;
  std::vector<float> V;   // [columns][rank], orthonormal
  std::vector<float> XV;  // [rows][rank]; empty where the input was too large for it
  std::vector<double> values;
};

std::vector<float> transposed(std::span<const float> matrix, std::size_t rows) {
  const std::size_t sizes[]{rows, matrix.size() / rows};
  constexpr std::size_t axes[]{1, 0};
  return permuted(matrix, sizes, axes);
}

// The singular values from XV to V: XV becomes orthonormal.
void move_values(Factors& factors) {
  const std::size_t k = factors.rank;
  for (std::size_t i = 0; i < factors.XV.size(); ++i) {
    factors.XV[i] = static_cast<float>(static_cast<double>(factors.XV[i]) / factors.values[i % k]);
  }
  for (std::size_t i = 0; i < factors.V.size(); ++i) {
    factors.V[i] = static_cast<float>(static_cast<double>(factors.V[i]) * factors.values[i % k]);
  }
}

class Sweep {
 public:
  Sweep(Device& device, const reference::TrainRequest& request, Job& job)
      : device_(device), request_(request), job_(job) {}

  TrainFit run(TileSource& source, const TtFitOptions& options);

 private:
  // Bond n is between cores n and n + 1.
  std::size_t bond(End end) const { return end == End::left ? first_ : last_ - 1; }
  std::size_t cut_mode(End end) const { return end == End::left ? first_ : last_; }
  std::size_t left_rank() const { return train_.ranks[first_]; }
  std::size_t right_rank() const { return train_.ranks[last_ + 1]; }

  // The part of what is left of a tensor that the next cut may leave, as a relative error.
  double step_tolerance() const {
    if (request_.tolerance == 0) return 0;
    const double cuts = static_cast<double>(last_ - first_);
    const double allowed = request_.tolerance * request_.tolerance - lost_;
    return std::min(std::sqrt(std::max(allowed, 0.0) / cuts / (1 - lost_)), 0.999);
  }

  // `unit`: what the tensor that is cut was multiplied by to give the stream.
  Factors truncated(PanelStream& stream, std::size_t bond, double unit);
  Factors spectral(PanelStream& stream, std::size_t bond);
  void count_loss(double residual_squares, double squares, double unit);
  void note(End end, const Factors& factors, const char* method, std::size_t columns);

  // Cuts of a tensor in memory, W [R_first][modes first .. last][R_last].
  void cut_resident(End end);
  End cheaper_end() const;
  void finish(double scale);
  void zero_train();

  // Cuts of the input.
  void cut_streamed(TileSource& source, const TtFitOptions& options, double scale);
  void take_core(End end, std::span<const float> Q, std::size_t rank);
  void extend_basis(const BtfShape& shape, End end, const ModeOrder& order, ModeSide& own,
                    std::span<const float> Q, std::size_t rank);
  void take_rest(const BtfShape& shape, End end, const ModeOrder& order,
                 const std::vector<Mode>& modes, std::span<const float> rest, std::size_t rank);

  Device& device_;
  const reference::TrainRequest& request_;
  Job& job_;
  TensorTrain train_;
  std::size_t first_ = 0;  // modes that are not cut off
  std::size_t last_ = last_mode;
  std::vector<float> W_;
  double squares_ = 0;  // |T|^2 of the scaled tensor
  double lost_ = 0;     // of it
};

void Sweep::count_loss(double residual_squares, double squares, double unit) {
  if (squares_ == 0) squares_ = squares / (unit * unit);
  if (squares > 0) lost_ += residual_squares / squares * (1 - lost_);
}

Factors Sweep::truncated(PanelStream& stream, std::size_t bond, double unit) {
  SvdTarget target;
  target.rank = request_.ranks[bond];
  target.tolerance = step_tolerance();
  const StreamShape shape{stream.rows(), stream.columns(), stream.granule(), Arithmetic::f32};
  const auto factorise = [&](SvdMethod method) {
    target.method = method;
    target.most_columns = std::numeric_limits<std::size_t>::max();
    if (target.has_goal()) {
      target.most_columns = goal_columns(device_, shape, target, job_);
    }
    return streamed_svd(device_, stream, target, job_);
  };
  StreamedSvd svd = factorise(method_for(stream.columns(), target.tolerance, target.rank));
  const double small = gram_safe_error(Arithmetic::f32) * std::sqrt(svd.squares);
  const bool dense = stream.columns() <= most_dense_columns;
  if (!target.has_goal() && dense && target.method == SvdMethod::gram && svd.residual < small &&
      svd.squares > 0) {
    svd = StreamedSvd();
    svd = factorise(SvdMethod::qr);
  }
  if (svd.rank == 0 && svd.squares > 0) {
    // A bond has at least one component, even where a goal would do without.
    target.tolerance = 0;
    target.rank = 1;
    svd = StreamedSvd();
    svd = factorise(method_for(stream.columns(), 0, 1));
  }
  count_loss(svd.residual * svd.residual, svd.squares, unit);
  Factors factors;
  factors.rank = svd.rank;
  if (svd.rank == 0) return factors;
  factors.V.resize(stream.columns() * svd.rank);
  factors.XV.resize(stream.rows() * svd.rank);
  ops::read_reals(device_, svd.V, Arithmetic::f32, stream.columns(), svd.rank, svd.leading, 1.0,
                  std::span<float>(factors.V));
  ops::read_reals(device_, svd.XV, Arithmetic::f32, stream.rows(), svd.rank, svd.leading, 1 / unit,
                  std::span<float>(factors.XV));
  for (const double value : svd.values) factors.values.push_back(value / unit);
  return factors;
}

Factors Sweep::spectral(PanelStream& stream, std::size_t bond) {
  const std::size_t m = stream.columns();
  const double tolerance = step_tolerance();
  const bool gram = tolerance >= gram_safe_error(Arithmetic::f32);
  const Spectrum spectrum = gram ? gram_spectrum(device_, stream, job_)
                                 : qr_spectrum(device_, stream, ops::Tsqr::Workspace::ample, job_);
  Factors factors;
  if (spectrum.squares == 0) return factors;
  const double floor = noise_floor(Arithmetic::f32, spectrum.squares, {});
  std::size_t known = 0;
  while (known < m && spectrum.values[known] > floor) ++known;
  double rest = 0;
  for (std::size_t j = known; j < m; ++j) rest += spectrum.values[j] * spectrum.values[j];
  std::size_t k = known;
  if (tolerance > 0) {
    k = smallest_rank(std::span(spectrum.values).first(known), rest,
                      tolerance * tolerance * spectrum.squares);
  }
  if (request_.ranks[bond] > 0) k = std::min(k, request_.ranks[bond]);
  k = std::clamp<std::size_t>(k, 1, known);
  for (std::size_t j = k; j < known; ++j) rest += spectrum.values[j] * spectrum.values[j];
  count_loss(rest, spectrum.squares, 1);
  factors.rank = k;
  factors.V.resize(m * k);
  for (std::size_t i = 0; i < m; ++i) {
    for (std::size_t j = 0; j < k; ++j) {
      factors.V[i * k + j] = static_cast<float>(spectrum.vectors[i * m + j]);
    }
  }
  factors.values.assign(spectrum.values.begin(),
                        spectrum.values.begin() + static_cast<std::ptrdiff_t>(k));
  return factors;
}

void Sweep::note(End end, const Factors& factors, const char* method, std::size_t columns) {
  job_.notes.push_back(fmt::format("R{} = {}: {} of a short side of {}, cut from the {}",
                                   bond(end) + 1, factors.rank, method, columns,
                                   end == End::left ? "left" : "right"));
}

End Sweep::cheaper_end() const {
  const std::size_t left = left_rank() * train_.sizes[first_];
  const std::size_t right = train_.sizes[last_] * right_rank();
  const std::size_t left_side = std::min(left, W_.size() / left);
  const std::size_t right_side = std::min(right, W_.size() / right);
  return left_side <= right_side ? End::left : End::right;
}

void Sweep::cut_resident(End end) {
  const std::size_t own =
      train_.sizes[cut_mode(end)] * (end == End::left ? left_rank() : right_rank());
  const std::size_t rest = W_.size() / own;
  const std::size_t rows = end == End::left ? own : rest;
  const bool turned = W_.size() / rows > rows;  // the short side is that of the columns
  if (turned) W_ = transposed(W_, rows);
  const std::size_t long_side = std::max(own, rest);
  const std::size_t short_side = std::min(own, rest);
  MatrixPanels stream(device_, long_side, short_side, std::span<const float>(W_),
                      matrix_granule(short_side));
  Factors factors = truncated(stream, bond(end), stream.scale());
  const std::size_t k = factors.rank;
  if (k == 0) return;
  note(end, factors, "SVD", short_side);
  // V belongs to the columns of the stream; what is left carries the singular values
  const bool own_is_V = (end == End::right) != turned;
  std::vector<float>& Q = own_is_V ? factors.V : factors.XV;
  std::vector<float>& left_over = own_is_V ? factors.XV : factors.V;
  if (!own_is_V) move_values(factors);
  train_.values[bond(end)] = factors.values;
  if (end == End::left) {
    train_.cores[first_].assign(Q.begin(), Q.end());
    W_ = transposed(left_over, rest);
    train_.ranks[++first_] = k;
  } else {
    const std::vector<float> core = transposed(Q, own);
    train_.cores[last_].assign(core.begin(), core.end());
    W_ = std::move(left_over);
    train_.ranks[last_--] = k;
  }
}

// Q: rows (i, bond) of the cut mode.
void Sweep::take_core(End end, std::span<const float> Q, std::size_t rank) {
  const std::size_t sizes[]{train_.sizes[cut_mode(end)],
                            end == End::left ? left_rank() : right_rank(), rank};
  constexpr std::size_t left[]{1, 0, 2};   // [old][i][new]
  constexpr std::size_t right[]{2, 0, 1};  // [new][i][old]
  const std::vector<float> core = permuted(Q, sizes, end == End::left ? left : right);
  train_.cores[cut_mode(end)].assign(core.begin(), core.end());
}

// The basis of the modes at an end, with the cut mode among them.
void Sweep::extend_basis(const BtfShape& shape, End end, const ModeOrder& order, ModeSide& own,
                         std::span<const float> Q, std::size_t rank) {
  const Mode cut = order[cut_mode(end)];
  const std::size_t size = mode_size(shape, cut);
  const std::size_t bound = own.bound_size(shape);
  // [cut mode][bound modes][rank]
  std::vector<float> basis(size * bound * rank);
  for (std::size_t i = 0; i < size; ++i) {
    for (std::size_t j = 0; j < bound; ++j) {
      for (std::size_t k = 0; k < rank; ++k) {
        double sum = own.bound.empty() ? static_cast<double>(Q[i * rank + k]) : 0.0;
        for (std::size_t b = 0; b < own.rank && !own.bound.empty(); ++b) {
          sum += static_cast<double>(own.basis[j * own.rank + b]) *
                 static_cast<double>(Q[(i * own.rank + b) * rank + k]);
        }
        basis[(i * bound + j) * rank + k] = static_cast<float>(sum);
      }
    }
  }
  // then in storage order
  std::vector<Mode> modes{cut};
  modes.insert(modes.end(), own.bound.begin(), own.bound.end());
  std::vector<Mode> sorted = modes;
  sort_modes(sorted);
  std::vector<std::size_t> sizes, axes;
  for (const Mode mode : modes) sizes.push_back(mode_size(shape, mode));
  sizes.push_back(rank);
  for (const Mode mode : sorted) {
    axes.push_back(
        static_cast<std::size_t>(std::find(modes.begin(), modes.end(), mode) - modes.begin()));
  }
  axes.push_back(modes.size());
  own.basis = permuted(std::span<const float>(basis), sizes, axes);
  own.bound = std::move(sorted);
  own.rank = rank;
}

// W from rows [modes][rank] of what a cut of the input leaves.
void Sweep::take_rest(const BtfShape& shape, End end, const ModeOrder& order,
                      const std::vector<Mode>& modes, std::span<const float> rest,
                      std::size_t rank) {
  std::vector<std::size_t> sizes, axes;
  for (const Mode mode : modes) sizes.push_back(mode_size(shape, mode));
  sizes.push_back(rank);
  if (end == End::left) axes.push_back(modes.size());
  for (std::size_t n = 0; n < mode_count; ++n) {
    const auto found = std::find(modes.begin(), modes.end(), order[n]);
    if (found != modes.end()) axes.push_back(static_cast<std::size_t>(found - modes.begin()));
  }
  if (end == End::right) axes.push_back(modes.size());
  W_ = permuted(rest, sizes, axes);
}

void Sweep::cut_streamed(TileSource& source, const TtFitOptions& options, double scale) {
  const ModeOrder& order = options.order;
  const BtfShape& shape = source.info().shape;
  const End end = streamed_end(train_.sizes);
  ModeSide own;
  while (W_.empty()) {
    own.free = {order[cut_mode(end)]};
    ModeSide rest;
    for (std::size_t n = first_; n <= last_; ++n) {
      if (n != cut_mode(end)) rest.free.push_back(order[n]);
    }
    sort_modes(rest.free);
    const std::size_t own_size = own.size(shape);
    const std::size_t rest_size = rest.size(shape);
    const bool spectral_cut = own_size <= most_dense_columns && own_size <= rest_size &&
                              own_size * rest_size > options.most_left && last_ - first_ > 1;
    const bool own_is_V = own_size <= rest_size;
    const auto stream = tensor_panels(device_, source, own_is_V ? rest : own, own_is_V ? own : rest,
                                      static_cast<float>(scale), job_);
    Factors factors =
        spectral_cut ? spectral(*stream, bond(end)) : truncated(*stream, bond(end), 1);
    const std::size_t k = factors.rank;
    if (k == 0) return;
    note(end, factors, spectral_cut ? "spectrum" : "SVD", stream->columns());
    train_.values[bond(end)] = factors.values;
    std::vector<float>& Q = own_is_V ? factors.V : factors.XV;
    std::vector<float>& left_over = own_is_V ? factors.XV : factors.V;
    if (!own_is_V) move_values(factors);
    take_core(end, Q, k);
    if (spectral_cut) {
      extend_basis(shape, end, order, own, Q, k);
    } else {
      take_rest(shape, end, order, own_is_V ? row_modes(shape, rest) : rest.free, left_over, k);
    }
    if (end == End::left) {
      train_.ranks[++first_] = k;
    } else {
      train_.ranks[last_--] = k;
    }
  }
}

void Sweep::zero_train() {
  train_.ranks.fill(1);
  for (std::size_t n = 0; n < mode_count; ++n) train_.cores[n].assign(train_.sizes[n], 0.0);
  for (std::vector<double>& values : train_.values) values.assign(1, 0.0);
  train_.center = 0;
}

void Sweep::finish(double scale) {
  train_.center = first_;
  train_.cores[first_].assign(W_.begin(), W_.end());
  for (double& value : train_.cores[first_]) value /= scale;
  for (std::vector<double>& values : train_.values) {
    for (double& value : values) value /= scale;
  }
}

TrainFit Sweep::run(TileSource& source, const TtFitOptions& options) {
  const BtfShape& shape = source.info().shape;
  for (std::size_t n = 0; n < mode_count; ++n) {
    train_.sizes[n] = mode_size(shape, options.order[n]);
  }
  const SourceScan scan = scan_source(device_, source, job_);
  const double scale = static_cast<double>(unit_scale(scan.largest));
  if (scan.largest == 0) {
    zero_train();
    return {std::move(train_), 0, 0};
  }
  if (shape.values() <= options.resident_values) {
    const StageTimer timer(job_, "read", 0, static_cast<double>(source.info().bytes()));
    std::vector<std::byte> raw(source.info().bytes());
    read_slab(source, {Mode::view, 0, shape.views}, options.order, raw);
    W_.resize(shape.values());
    std::vector<double> run(std::min<std::size_t>(W_.size(), 65536));
    const std::size_t bytes = size_of(source.info().dtype);
    for (std::size_t i = 0; i < W_.size(); i += run.size()) {
      const std::size_t count = std::min(run.size(), W_.size() - i);
      reference::to_double(source.info().dtype, std::span(raw).subspan(i * bytes, count * bytes),
                           job_.nan_zero, std::span(run).first(count));
      for (std::size_t j = 0; j < count; ++j) W_[i + j] = static_cast<float>(run[j] * scale);
    }
  } else {
    cut_streamed(source, options, scale);
  }
  while (first_ < last_) cut_resident(cheaper_end());
  finish(scale);
  return {std::move(train_), squares_ / (scale * scale), lost_};
}

}  // namespace

MemoryPlan plan_tt(Device& device, TileSource& source, const TtFitOptions& options,
                   const Job& job) {
  const BtfInfo& info = source.info();
  const BtfShape& shape = info.shape;
  MemoryPlan plan;
  if (shape.values() <= options.resident_values) {
    // the tensor, turned, its block and panels, and the factors of a cut here and there
    plan.add("tensor", info.bytes() + 4 * shape.values() * sizeof(float));
    plan.add("factors", 4 * shape.values() * sizeof(float));
    return plan;
  }
  std::array<std::size_t, mode_count> sizes{};
  for (std::size_t n = 0; n < mode_count; ++n) sizes[n] = mode_size(shape, options.order[n]);
  const bool left = streamed_end(sizes) == End::left;
  const std::size_t outer = left ? 0 : last_mode;
  const std::size_t inner = left ? 1 : last_mode - 1;
  // the second cut, with nothing cut off by the first
  ModeSide own{{options.order[inner]}, {options.order[outer]}, {}, sizes[outer]};
  own.basis.resize(sizes[outer] * sizes[outer]);
  ModeSide rest;
  for (std::size_t n = 0; n < mode_count; ++n) {
    if (n != inner && n != outer) rest.free.push_back(options.order[n]);
  }
  sort_modes(rest.free);
  const bool own_is_short = own.size(shape) <= rest.size(shape);
  const ModeSide& rows = own_is_short ? rest : own;
  const ModeSide& columns = own_is_short ? own : rest;
  plan.add("slab", tensor_panels_bytes(device, info, rows, columns));
  const StreamShape stream{rows.size(shape), columns.size(shape), 0, Arithmetic::f32};
  SvdTarget target;
  target.tolerance = options.request.tolerance;
  target.rank = options.request.ranks[left ? 1 : 2];
  target.method = SvdMethod::randomized;
  if (target.has_goal()) {
    target.most_columns = goal_columns(device, stream, target, job);
  }
  const MemoryPlan svd = plan_streamed_svd(device, stream, target);
  for (const MemoryItem& item : svd.items) plan.add(item.what, item.bytes);
  const std::size_t rank = std::min(
      {target.has_goal() ? target.most_columns : target.rank, stream.rows, stream.columns});
  plan.add("what a cut leaves", 3 * (stream.rows + stream.columns) * rank * sizeof(float));
  return plan;
}

TrainFit fit_tt(Device& device, TileSource& source, const TtFitOptions& options, Job& job) {
  return Sweep(device, options.request, job).run(source, options);
}

}  // namespace weft
