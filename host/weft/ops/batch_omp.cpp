#include "weft/ops/batch_omp.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <numeric>

#include "weft/error.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"

namespace weft {

namespace {
constexpr Tunable batch_omp_macros[] = {
    {"SIDE", 3, {1, 2, 3, 4, 6}, "signals that a work-item codes at the same time, at most"},
    {"SIDE_KIB", 40, {16, 24, 32, 40, 48, 64, 96, 192}, "KiB that they work in, at most"},
    {"BLOCK", 8, {4, 8, 16}, "vectors that a work-item holds in registers, at most"},
};
}  // namespace
constinit const TunableKernel tunables::batch_omp{"batch_omp", batch_omp_macros};

}  // namespace weft

namespace weft::ops {
namespace {

constexpr std::size_t most_size = std::size_t{1} << 24;
constexpr std::size_t most_gram_bytes = std::size_t{256} << 20;
constexpr std::size_t chunk_bytes = std::size_t{4} << 20;  // of correlations: they stay in a cache
constexpr std::size_t scratch_bytes = std::size_t{64} << 20;  // of all groups
constexpr std::size_t batch_bytes = std::size_t{16} << 20;
constexpr std::size_t block_signals = std::size_t{1} << 16;
constexpr std::uint32_t coded_again = 0xFFFFFFFF;  // the counts RECODE and ENDED of the kernel

// signals that a work-item measures
constexpr std::size_t measured_at_once = 64;
// steps of a batch between two looks whether all its codes have ended
constexpr std::size_t steps_between_looks = 8;

bool in_tiles(const Device& device, Family family) {
  return family == Family::tiles || (family == Family::automatic && !device.limits().is_cpu);
}

void launch_groups(Device& device, cl_kernel kernel, std::size_t groups, std::size_t items) {
  const std::array<std::size_t, 1> global{groups * items};
  const std::array<std::size_t, 1> local{items};
  device.launch(kernel, global, local);
}

float float_target(const OmpTarget& target) {
  return static_cast<float>(
      std::min(target.residual, static_cast<double>(std::numeric_limits<float>::max())));
}

}  // namespace

BatchOmp::Sizes BatchOmp::sizes_of(const Device& device, std::size_t atoms, std::size_t dimension,
                                   const OmpOptions& options) {
  const std::size_t k = options.target.sparsity;
  if (atoms == 0 || atoms > most_size) fail_input("sparse coding: {} atoms", atoms);
  if (dimension == 0 || dimension > most_size) {
    fail_input("sparse coding: signals of dimension {}", dimension);
  }
  if (k == 0 || k > most_size) fail_input("sparse coding: {} atoms per signal", k);
  if (!(options.target.residual >= 0)) {
    fail_input("sparse coding: a residual of {} can't be reached", options.target.residual);
  }
  Sizes sizes;
  sizes.packed = !in_tiles(device, options.product);
  sizes.tiles = in_tiles(device, options.family);
  sizes.vector_width = sizes.tiles ? 4 : ops::vector_width(device);
  sizes.items = sizes.tiles
                    ? std::bit_floor(std::clamp<std::size_t>(device.limits().max_work_group, 1, 64))
                    : 1;
  constexpr std::size_t few = 4;
  sizes.vectors = sizes.tiles ? 1 : device.parameter(tunables::batch_omp, "BLOCK");
  sizes.A = round_up(atoms, sizes.vector_width * (sizes.tiles ? 1 : few));
  // as many in registers as need no more padding
  while (sizes.A % (sizes.vector_width * sizes.vectors) != 0) sizes.vectors /= 2;
  sizes.dimension_p = round_up(dimension, sizes.vector_width);
  sizes.steps = std::min({k, atoms, dimension});
  sizes.l_row = round_up(sizes.steps, sizes.vector_width);
  const std::size_t row_bytes = sizes.A * sizeof(float);
  sizes.gram = options.form == OmpForm::gram ||
               (options.form == OmpForm::automatic && row_bytes <= most_gram_bytes / sizes.A);
  const std::size_t batch_floats =
      sizes.A + (sizes.steps + 1) * sizes.dimension_p + (sizes.steps + 3) * sizes.l_row;
  sizes.batch =
      std::clamp<std::size_t>(batch_bytes / (batch_floats * sizeof(float)), 16, block_signals);
  sizes.block = block_signals;
  if (!sizes.gram) return sizes;
  sizes.chunk = std::clamp<std::size_t>(std::bit_floor(chunk_bytes / row_bytes), 64, 4096);
  sizes.group_floats = (sizes.steps + 1) * sizes.A + (sizes.steps + 3) * sizes.l_row;
  if (!sizes.tiles) {
    // what fits a first cache
    const std::size_t bytes = device.parameter(tunables::batch_omp, "SIDE_KIB") << 10;
    sizes.side = std::clamp<std::size_t>(bytes / (sizes.group_floats * sizeof(float)), 1,
                                         device.parameter(tunables::batch_omp, "SIDE"));
  }
  sizes.groups = std::clamp<std::size_t>(scratch_bytes / (sizes.group_floats * sizeof(float)), 8,
                                         sizes.tiles ? 1024 : 64);
  sizes.groups = std::min(sizes.groups, sizes.chunk);
  return sizes;
}

std::vector<BatchOmp::Item> BatchOmp::items_of(const Device& device, std::size_t dimension,
                                               const Sizes& sizes) {
  const std::size_t rows = std::max(sizes.chunk, sizes.batch);
  const std::size_t states = sizes.batch * sizes.l_row;
  std::vector<Item> items{
      {&BatchOmp::units_, "unit atoms", sizes.A * sizes.dimension_p},
      {&BatchOmp::inverse_, "norms of atoms", sizes.A},
      {&BatchOmp::correlations_, "correlations", rows * sizes.A},
      {&BatchOmp::scales_, "scales of signals", rows},
      {&BatchOmp::energies_, "energies of signals", rows},
      {&BatchOmp::residuals_, "residuals", sizes.block},
      {&BatchOmp::list_, "list of signals", sizes.batch},
      {&BatchOmp::r_, "residuals of a batch", sizes.batch * sizes.dimension_p},
      {&BatchOmp::left_, "energies of residuals", sizes.batch},
      {&BatchOmp::q_, "orthogonal atoms", sizes.batch * sizes.steps * sizes.dimension_p},
      {&BatchOmp::l_, "triangular factors", sizes.batch * sizes.steps * sizes.l_row},
      {&BatchOmp::a_, "coefficients", states},
      {&BatchOmp::inverses_, "pivots", states},
      {&BatchOmp::chosen_, "chosen atoms", states},
      {&BatchOmp::count_, "counts", sizes.batch},
  };
  if (sizes.packed) {
    items.push_back(
        {&BatchOmp::packed_, "packed atoms", packed_elements(device, dimension, sizes.A)});
  }
  if (sizes.gram) {
    items.push_back({&BatchOmp::gram_, "inner products of atoms", sizes.A * sizes.A});
    items.push_back({&BatchOmp::scratch_, "scratch of sparse coding",
                     sizes.groups * sizes.group_floats * sizes.side});
  }
  for (Item& item : items) item.bytes *= sizeof(float);
  return items;
}

BatchOmp::BatchOmp(Device& device, std::size_t atoms, std::size_t dimension,
                   const OmpOptions& options)
    : device_(device),
      atoms_(atoms),
      dimension_(dimension),
      options_(options),
      sizes_(sizes_of(device, atoms, dimension, options)) {
  for (const Item& item : items_of(device, dimension, sizes_)) {
    this->*item.buffer = Buffer(device, item.bytes, item.what);
  }
}

std::size_t BatchOmp::bytes(const Device& device, std::size_t atoms, std::size_t dimension,
                            const OmpOptions& options) {
  const Sizes sizes = sizes_of(device, atoms, dimension, options);
  std::size_t total = 0;
  for (const Item& item : items_of(device, dimension, sizes)) total += item.bytes;
  // counts and the list made from them on the host
  return total + 2 * sizes.block * sizeof(std::uint32_t);
}

cl_kernel BatchOmp::kernel(const char* name) {
  return device_.kernel(
      kernel_sources::batch_omp,
      fmt::format("-DVW={} -DITEMS={} -DBLOCK={} -DSIDE={} -DSMALLEST_CORRELATION={:a}f "
                  "-DLEAST_DISTANCE={:a}f -DMOST_DEPENDENT={}",
                  sizes_.vector_width, sizes_.items, sizes_.vectors, sizes_.side,
                  PursuitLimits::smallest_correlation, PursuitLimits::least_distance,
                  PursuitLimits::most_dependent),
      name);
}

void BatchOmp::set_dictionary(const ConstMatrix& D) {
  check_rows("D", atoms_, D);
  const cl_kernel normalise = kernel("normalise_atoms");
  set_arguments(normalise, ulong(atoms_), ulong(dimension_), ulong(sizes_.dimension_p), D.buffer,
                ulong(D.offset), ulong(D.leading), units_, inverse_);
  launch_items(device_, normalise, sizes_.A);
  if (sizes_.packed) {
    pack_panels(device_, transposed(device_, units_, sizes_.dimension_p), dimension_, sizes_.A,
                packed_);
  }
  if (sizes_.gram) product(sizes_.A, {units_, sizes_.dimension_p}, gram_);
}

void BatchOmp::product(std::size_t rows, const ConstMatrix& X, Buffer& C) {
  if (!sizes_.packed) {
    ProductOptions options;
    options.family = Family::tiles;
    gemm(device_, Transpose::no, Transpose::yes, rows, sizes_.A, dimension_, 1, X,
         {units_, sizes_.dimension_p}, 0, {C, sizes_.A}, options);
    return;
  }
  gemm_packed(device_, rows, sizes_.A, dimension_, 1,
              row_major(device_, X.buffer, X.leading, X.offset), packed_, 0,
              to_row_major(device_, C, sizes_.A));
}

void BatchOmp::check_rows(const char* name, std::size_t rows, const ConstMatrix& X) const {
  const std::size_t values = X.buffer.size() / sizeof(float);
  if (X.leading < dimension_ || X.offset > values ||
      (rows > 0 && (values - X.offset < dimension_ ||
                    (values - X.offset - dimension_) / X.leading < rows - 1))) {
    fail_input(
        "matrix {}: {} rows of {} with leading dimension {} and offset {} do not fit a buffer of "
        "{} values",
        name, rows, dimension_, X.leading, X.offset, values);
  }
}

void BatchOmp::check_codes(std::size_t signals, const OmpCodes& codes) const {
  const std::size_t k = options_.target.sparsity;
  std::size_t end = 0;
  std::size_t entries = 0;
  const bool fits = !__builtin_add_overflow(codes.first, signals, &end) &&
                    !__builtin_mul_overflow(end, k, &entries) &&
                    entries <= codes.indices.size() / sizeof(std::uint32_t) &&
                    entries <= codes.coefficients.size() / sizeof(float) &&
                    end <= codes.counts.size() / sizeof(std::uint32_t) &&
                    (!codes.residuals || end <= codes.residuals->size() / sizeof(float));
  if (!fits) {
    fail_input(
        "sparse coding: codes of {} signals from {} on, {} entries each, do not fit their buffers",
        signals, codes.first, k);
  }
}

void BatchOmp::correlate(std::size_t signals, const ConstMatrix& Y, Buffer& C) {
  check_rows("Y", signals, Y);
  if (signals > 0) product(signals, Y, C);
}

void BatchOmp::code(std::size_t signals, const ConstMatrix& Y, const OmpCodes& codes) {
  code_blocks(signals, Y, nullptr, codes);
}

void BatchOmp::code_correlated(std::size_t signals, const ConstMatrix& Y, const Buffer& C,
                               const OmpCodes& codes) {
  if (!sizes_.gram) fail_input("sparse coding from correlations needs the atoms' inner products");
  if (C.size() / sizeof(float) / sizes_.A < signals) {
    fail_input("matrix C: {} rows of {} do not fit a buffer of {} values", signals, sizes_.A,
               C.size() / sizeof(float));
  }
  code_blocks(signals, Y, &C, codes);
}

void BatchOmp::code_blocks(std::size_t signals, const ConstMatrix& Y, const Buffer* C,
                           const OmpCodes& codes) {
  check_rows("Y", signals, Y);
  check_codes(signals, codes);
  std::vector<std::uint32_t> counts;
  std::vector<std::uint32_t> list;
  for (std::size_t first = 0; first < signals; first += sizes_.block) {
    check_interrupt();
    const std::size_t count = std::min(sizes_.block, signals - first);
    const ConstMatrix rows{Y.buffer, Y.leading, Y.offset + first * Y.leading};
    OmpCodes block = codes;
    block.first += first;
    list.resize(count);
    if (sizes_.gram) {
      for (std::size_t s = 0; s < count; s += sizes_.chunk) {
        code_chunk({first + s, s, std::min(sizes_.chunk, count - s)}, Y, C, block);
      }
      // those that the inner products could not follow
      counts.resize(count);
      device_.read(codes.counts, std::span<std::uint32_t>(counts), block.first);
      list.clear();
      for (std::size_t s = 0; s < count; ++s) {
        if (counts[s] == coded_again) list.push_back(static_cast<std::uint32_t>(s));
      }
      recoded_ += list.size();
    } else {
      std::iota(list.begin(), list.end(), 0U);
    }
    for (std::size_t b = 0; b < list.size(); b += sizes_.batch) {
      check_interrupt();
      const std::size_t size = std::min(sizes_.batch, list.size() - b);
      code_batch(std::span<const std::uint32_t>(list).subspan(b, size), rows, block);
    }
  }
  device_.finish();
}

void BatchOmp::code_chunk(const Chunk& chunk, const ConstMatrix& Y, const Buffer* C,
                          const OmpCodes& block) {
  const ConstMatrix rows{Y.buffer, Y.leading, Y.offset + chunk.first * Y.leading};
  const cl_kernel measure = kernel("measure_signals");
  set_arguments(measure, ulong(chunk.count), ulong(measured_at_once), ulong(dimension_), Y.buffer,
                ulong(rows.offset), ulong(Y.leading), scales_, energies_);
  launch_items(device_, measure, ceil_div(chunk.count, measured_at_once));
  if (!C) product(chunk.count, rows, correlations_);

  const std::size_t per_group = round_up(ceil_div(chunk.count, sizes_.groups), sizes_.side);
  const cl_kernel pursue = kernel("code_by_gram");
  set_arguments(
      pursue, ulong(chunk.count), ulong(per_group), ulong(atoms_), ulong(sizes_.A),
      static_cast<cl_uint>(options_.target.sparsity), static_cast<cl_uint>(sizes_.steps),
      float_target(options_.target), C ? *C : correlations_, ulong(C ? chunk.first * sizes_.A : 0),
      gram_, inverse_, scales_, energies_, scratch_, ulong(sizes_.group_floats),
      ulong(sizes_.l_row), ulong(block.first + chunk.in_block), block.indices, block.coefficients,
      block.counts, ulong(block.residuals ? block.first + chunk.in_block : chunk.in_block),
      block.residuals ? *block.residuals : residuals_);
  launch_groups(device_, pursue, ceil_div(chunk.count, per_group), sizes_.items);
}

void BatchOmp::code_batch(std::span<const std::uint32_t> list, const ConstMatrix& Y,
                          const OmpCodes& block) {
  device_.write(list_, list);
  const cl_kernel gather = kernel("gather_signals");
  set_arguments(gather, ulong(dimension_), ulong(sizes_.dimension_p), list_, Y.buffer,
                ulong(Y.offset), ulong(Y.leading), r_, scales_, energies_, left_, count_);
  launch_items(device_, gather, list.size());

  const std::size_t per_group = sizes_.tiles ? 1 : 4;
  std::vector<std::uint32_t> counts(list.size());
  for (std::size_t t = 0; t < sizes_.steps; ++t) {
    product(list.size(), {r_, sizes_.dimension_p}, correlations_);
    const cl_kernel step = kernel("step_by_residual");
    set_arguments(
        step, ulong(list.size()), ulong(per_group), ulong(atoms_), ulong(sizes_.A),
        ulong(sizes_.dimension_p), static_cast<cl_uint>(options_.target.sparsity),
        static_cast<cl_uint>(sizes_.steps), float_target(options_.target), correlations_, units_,
        inverse_, list_, scales_, energies_, r_, left_, q_, l_, ulong(sizes_.l_row), a_, inverses_,
        chosen_, count_, ulong(block.first), block.indices, block.coefficients, block.counts,
        ulong(block.residuals ? block.first : 0), block.residuals ? *block.residuals : residuals_);
    launch_groups(device_, step, ceil_div(list.size(), per_group), sizes_.items);
    if ((t + 1) % steps_between_looks != 0) continue;
    device_.read(count_, std::span<std::uint32_t>(counts));
    if (std::ranges::all_of(counts, [](std::uint32_t count) { return count == coded_again; })) {
      return;
    }
  }
}

}  // namespace weft::ops
