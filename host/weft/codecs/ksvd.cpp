#include "weft/codecs/ksvd.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "weft/error.hpp"
#include "weft/ops/batch_omp.hpp"
#include "weft/ops/ksvd_update.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/reference/ksvd_atoms.hpp"

namespace weft {
namespace {

constexpr std::size_t staged_values = std::size_t{1} << 20;  // read from the source at once
constexpr std::size_t compared_atoms = 512;                  // rows of a block of inner products

constexpr double most_entries = 0x1p56;  // of all codes: their bytes are counted

// An error below this part of |Y|^2 is what float arithmetic leaves.
constexpr double rounding = 0x1p-42;

std::size_t leading_of(std::size_t dimension) {
  return ops::round_up(dimension, ops::atom_row_multiple);
}

std::size_t batch_of(std::size_t signals, const KsvdOptions& options) {
  return options.batch == 0 ? signals : std::min(options.batch, signals);
}

std::size_t staged_rows(std::size_t leading) {
  return std::max<std::size_t>(staged_values / leading, 1);
}

ops::OmpOptions omp_options(const KsvdOptions& options) {
  ops::OmpOptions omp;
  omp.target.sparsity = options.sparsity;
  return omp;
}

// Largest magnitude and sum of squares of all signals.
struct Extent {
  double largest = 0;
  double squares = 0;
};

Extent scan(const KsvdSignals& signals) {
  Extent extent;
  const std::size_t most = std::min(staged_rows(signals.dimension), signals.signals);
  std::vector<float> rows(most * signals.dimension);
  for (std::size_t first = 0; first < signals.signals; first += most) {
    check_interrupt();
    const std::size_t count = std::min(most, signals.signals - first);
    const std::span<float> part = std::span(rows).first(count * signals.dimension);
    signals.read(first, part);
    for (std::size_t i = 0; i < part.size(); ++i) {
      const double value = std::abs(double{part[i]});
      if (!std::isfinite(value)) {
        fail_input("signal {} has {} in dimension {}", first + i / signals.dimension, part[i],
                   i % signals.dimension);
      }
      extent.largest = std::max(extent.largest, value);
      extent.squares += value * value;
    }
  }
  return extent;
}

// Dictionary and codes on the device, and the state of the fit on the host.
class KsvdRun {
 public:
  KsvdRun(Device& device, const KsvdSignals& signals, const KsvdOptions& options, double scale,
          Job& job, const std::string& name)
      : device_(device),
        signals_(signals),
        options_(options),
        scale_(scale),
        job_(job),
        coding_(name + ": coding"),
        atoms_(name + ": atoms"),
        leading_(leading_of(signals.dimension)),
        batch_(batch_of(signals.signals, options)),
        Y_(device, batch_ * leading_ * sizeof(float), "signals"),
        R_(device, batch_ * leading_ * sizeof(float), "residuals of the signals"),
        errors_(device, batch_ * sizeof(float), "errors of the signals"),
        entries_(device, batch_ * options.sparsity * sizeof(std::uint32_t), "uses of the atoms"),
        omp_(device, options.atoms, signals.dimension, omp_options(options)),
        update_(device, leading_, options.update),
        signal_errors_(signals.signals) {
    const std::size_t entries = batch_ * options.sparsity;
    for (ops::DeviceCodes& codes : codes_) {
      codes.indices = Buffer(device, entries * sizeof(std::uint32_t), "indices of codes");
      codes.coefficients = Buffer(device, entries * sizeof(float), "coefficients of codes");
      codes.counts = Buffer(device, batch_ * sizeof(std::uint32_t), "counts of codes");
    }
    for (Buffer& D : D_) {
      D = Buffer(device, options.atoms * leading_ * sizeof(float), "dictionary");
    }
    fit_.indices.resize(signals.signals * options.sparsity);
    fit_.coefficients.resize(fit_.indices.size());
    fit_.counts.resize(signals.signals);
    if (whole()) load(0, batch_);
  }

  KsvdFit<float>& fit() { return fit_; }
  bool whole() const { return batch_ == signals_.signals; }

  // The dictionary [atoms][dimension] to the device.
  void set_dictionary(std::span<const double> dictionary) {
    const std::size_t n = signals_.dimension;
    std::vector<float> rows(options_.atoms * leading_, 0.0f);
    for (std::size_t j = 0; j < options_.atoms; ++j) {
      for (std::size_t i = 0; i < n; ++i) {
        rows[j * leading_ + i] = static_cast<float>(dictionary[j * n + i]);
      }
    }
    device_.write(D_[0], std::span<const float>(rows));
    omp_.set_dictionary({D_[0], leading_});
  }

  // Codes all signals by the dictionary; with `kept`, those whose code before is better keep it.
  void code_all(bool kept) {
    double total = 0;
    for (std::size_t first = 0; first < signals_.signals; first += batch_) {
      const std::size_t count = std::min(batch_, signals_.signals - first);
      if (!whole()) load(first, count);
      code(count, kept);
      read_codes(first, count);
      for (std::size_t i = first; i < first + count; ++i) total += signal_errors_[i];
    }
    fit_.objective = total;
  }

  // Updates the atoms by all signals.
  void update_all() {
    for (std::size_t first = 0; first < signals_.signals; first += batch_) {
      const std::size_t count = std::min(batch_, signals_.signals - first);
      if (!whole()) {
        load(first, count);
        code(count, false);
        batch_indices_.resize(count * options_.sparsity);
        batch_coefficients_.resize(batch_indices_.size());
        device_.read(codes_[0].indices, std::span<std::uint32_t>(batch_indices_));
        device_.read(codes_[0].coefficients, std::span<float>(batch_coefficients_));
        update(count, batch_indices_, batch_coefficients_);
        omp_.set_dictionary({D_[0], leading_});
      } else {
        update(count, fit_.indices, fit_.coefficients);
      }
    }
  }

  // Replaces atoms without use and duplicates by the signals that were coded worst, and makes the
  // dictionary the one that is coded by. Returns how many were replaced.
  std::size_t replace() {
    std::vector<double> dictionary = read_dictionary();
    const std::size_t replaced =
        reference::replace_atoms(reader(), signal_errors_, needless_atoms(), dictionary);
    if (replaced > 0) {
      set_dictionary(dictionary);
    } else {
      omp_.set_dictionary({D_[0], leading_});
    }
    return replaced;
  }

  // [atoms][dimension]
  std::vector<double> read_dictionary() {
    const std::size_t n = signals_.dimension;
    std::vector<float> rows(options_.atoms * leading_);
    device_.read(D_[0], std::span<float>(rows));
    std::vector<double> dictionary(options_.atoms * n);
    for (std::size_t j = 0; j < options_.atoms; ++j) {
      std::copy_n(rows.data() + j * leading_, n, dictionary.data() + j * n);
    }
    return dictionary;
  }

  // Signals times the scale.
  reference::SignalReader reader() {
    return {signals_.signals, signals_.dimension, [this](std::size_t i, std::span<double> values) {
              std::vector<float> row(values.size());
              signals_.read(i, row);
              std::transform(row.begin(), row.end(), values.begin(),
                             [&](float value) { return double{value} * scale_; });
            }};
  }

 private:
  ops::CodeShape shape(std::size_t count) const {
    return {count, leading_, options_.atoms, options_.sparsity};
  }

  void load(std::size_t first, std::size_t count) {
    const std::size_t n = signals_.dimension;
    const std::size_t most = std::min(staged_rows(leading_), count);
    std::vector<float> rows(most * n);
    std::vector<float> padded(most * leading_, 0.0f);
    for (std::size_t begin = 0; begin < count; begin += most) {
      check_interrupt();
      const std::size_t part = std::min(most, count - begin);
      signals_.read(first + begin, std::span(rows).first(part * n));
      for (std::size_t i = 0; i < part; ++i) {
        for (std::size_t j = 0; j < n; ++j) {
          padded[i * leading_ + j] = static_cast<float>(double{rows[i * n + j]} * scale_);
        }
      }
      device_.write(Y_, std::span<const float>(padded).first(part * leading_), begin * leading_);
    }
  }

  // The first `count` signals on the device.
  void code(std::size_t count, bool kept) {
    const auto N = static_cast<double>(count);
    const auto K = static_cast<double>(options_.atoms);
    const auto k = static_cast<double>(options_.sparsity);
    const auto n = static_cast<double>(signals_.dimension);
    // the product, its updates, and the residual; all signals read twice, the residuals written
    const StageTimer timer(job_, coding_, 2 * N * n * (K + k) + N * K * k * (k + 1),
                           12 * N * n + 8 * N * k);
    ops::DeviceCodes& codes = codes_[kept ? 1 : 0];
    omp_.code(count, {Y_, leading_}, {codes.indices, codes.coefficients, codes.counts});
    ops::code_residuals(device_, shape(count), Y_, D_[0], codes, kept ? codes_.data() : nullptr, R_,
                        errors_);
    device_.finish();
    if (kept) std::swap(codes_[0], codes_[1]);
  }

  void read_codes(std::size_t first, std::size_t count) {
    const std::size_t k = options_.sparsity;
    device_.read(codes_[0].indices, std::span(fit_.indices).subspan(first * k, count * k));
    device_.read(codes_[0].coefficients,
                 std::span(fit_.coefficients).subspan(first * k, count * k));
    device_.read(codes_[0].counts, std::span(fit_.counts).subspan(first, count));
    std::vector<float> errors(count);
    device_.read(errors_, std::span<float>(errors));
    std::copy(errors.begin(), errors.end(),
              signal_errors_.begin() + static_cast<std::ptrdiff_t>(first));
  }

  void update(std::size_t count, std::span<const std::uint32_t> indices,
              std::span<const float> coefficients) {
    const ops::AtomUses uses = ops::atom_uses(shape(count), indices, coefficients);
    const auto values = static_cast<double>(uses.entries.size() * signals_.dimension);
    StageTimer timer(job_, atoms_, 10 * values, 12 * values);
    if (!uses.entries.empty()) {
      device_.write(entries_, std::span<const std::uint32_t>(uses.entries));
    }
    update_.update(shape(count), uses, entries_, D_[0], D_[1], codes_[0].coefficients, R_);
    std::swap(D_[0], D_[1]);
    // a step of the power iteration reads the residuals once more
    Stage& stage = job_.stage(atoms_);
    const double steps = static_cast<double>(update_.steps()) / static_cast<double>(options_.atoms);
    stage.flops += 4 * values * steps;
    stage.bytes += 4 * values * steps;
  }

  // Atoms without use, and those that are the same as an earlier one.
  std::vector<bool> needless_atoms() {
    std::vector<bool> needless(options_.atoms, true);
    for (std::size_t entry = 0; entry < fit_.indices.size(); ++entry) {
      if (fit_.coefficients[entry] != 0) needless[fit_.indices[entry]] = false;
    }
    const std::size_t most = std::min(compared_atoms, options_.atoms);
    Buffer products(device_, most * options_.atoms * sizeof(float), "inner products of atoms");
    std::vector<float> rows(most * options_.atoms);
    for (std::size_t first = 0; first < options_.atoms; first += most) {
      const std::size_t count = std::min(most, options_.atoms - first);
      const std::size_t columns = first + count;  // those after a row's atom do not matter
      ops::gemm(device_, ops::Transpose::no, ops::Transpose::yes, count, columns, leading_, 1,
                {D_[0], leading_, first * leading_}, {D_[0], leading_}, 0, {products, columns});
      device_.read(products, std::span(rows).first(count * columns));
      for (std::size_t i = 0; i < count; ++i) {
        const std::size_t j = first + i;
        for (std::size_t l = 0; l < j && !needless[j]; ++l) {
          needless[j] =
              !needless[l] && std::abs(double{rows[i * columns + l]}) > reference::duplicate_atoms;
        }
      }
    }
    return needless;
  }

  Device& device_;
  const KsvdSignals& signals_;
  const KsvdOptions& options_;
  double scale_;
  Job& job_;
  std::string coding_;
  std::string atoms_;
  std::size_t leading_;
  std::size_t batch_;
  Buffer Y_;
  Buffer R_;  // of codes_[0]
  Buffer errors_;
  Buffer entries_;
  std::array<ops::DeviceCodes, 2> codes_;  // those in use, and the next ones
  std::array<Buffer, 2> D_;                // the one in use, and the updated one
  ops::BatchOmp omp_;
  ops::AtomUpdate update_;
  std::vector<double> signal_errors_;
  std::vector<std::uint32_t> batch_indices_;
  std::vector<float> batch_coefficients_;
  KsvdFit<float> fit_;
};

std::string objectives_note(const std::string& name, const KsvdFit<float>& fit, double squares) {
  std::size_t replaced = 0;
  for (const std::size_t count : fit.replaced) replaced += count;
  std::string note = fmt::format("{}: |Y - X D| / |Y| by iteration", name);
  for (const double objective : fit.objectives) {
    note += fmt::format(" {:.4g}", squares > 0 ? std::sqrt(objective / squares) : 0.0);
  }
  return note + fmt::format("; {} atoms replaced", replaced);
}

}  // namespace

KsvdSignals KsvdSignals::of(std::size_t dimension, std::span<const float> values) {
  return {dimension == 0 ? 0 : values.size() / dimension, dimension,
          [=](std::size_t first, std::span<float> rows) {
            std::copy_n(values.data() + first * dimension, rows.size(), rows.data());
          }};
}

KsvdFit<float> ksvd(Device& device, const KsvdSignals& signals, const KsvdOptions& options,
                    std::span<const float> given, Job& job, const std::string& name) {
  reference::check_ksvd(signals.signals, signals.dimension, options, given.size());
  job.plan(ksvd_plan(device, signals.signals, signals.dimension, options));
  const Extent extent = scan(signals);
  int exponent = 0;
  std::frexp(extent.largest, &exponent);
  const double scale = std::ldexp(1.0, -exponent);

  KsvdRun run(device, signals, options, scale, job, name);
  run.set_dictionary(reference::initial_atoms(run.reader(), options,
                                              std::vector<double>(given.begin(), given.end())));
  run.code_all(false);
  KsvdFit<float>& fit = run.fit();
  fit.objectives.push_back(fit.objective);
  std::vector<double> dictionary = run.read_dictionary();
  KsvdFit<float> best = fit;
  const double floor = rounding * extent.squares * scale * scale;
  for (std::size_t t = 1; t <= options.iterations && fit.objective > floor; ++t) {
    check_interrupt();
    const double before = fit.objective;
    run.update_all();
    const std::size_t replaced = run.replace();
    run.code_all(run.whole());
    fit.objectives.push_back(fit.objective);
    fit.replaced.push_back(replaced);
    if (fit.objective < best.objective) {
      best = fit;
      best.best = t;
      dictionary = run.read_dictionary();
    }
    job.advance(name, t, options.iterations);
    if (replaced == 0 && before - fit.objective <= options.tolerance * before) break;
  }
  best.objectives = fit.objectives;
  best.replaced = fit.replaced;

  // back to the unit of the signals
  best.dictionary.assign(dictionary.begin(), dictionary.end());
  for (float& value : best.coefficients) value = static_cast<float>(double{value} / scale);
  best.objective /= scale * scale;
  for (double& value : best.objectives) value /= scale * scale;
  job.notes.push_back(objectives_note(name, best, extent.squares));
  return best;
}

MemoryPlan ksvd_plan(const Device& device, std::size_t signals, std::size_t dimension,
                     const KsvdOptions& options) {
  const std::size_t leading = leading_of(dimension);
  const std::size_t batch = batch_of(signals, options);
  // sizes in double, which none overflows: the largest pieces on the device, and all codes
  const auto signals_at_once = static_cast<double>(batch);
  const auto limit = static_cast<double>(device.limits().largest_allocation);
  const double rows = static_cast<double>(leading) * sizeof(float) *
                      std::max(signals_at_once, static_cast<double>(options.atoms));
  const double codes = signals_at_once * static_cast<double>(options.sparsity) * sizeof(float);
  if (std::max(rows, codes) > limit) {
    fail_input(
        "K-SVD of {} signals at once takes {:.0f} bytes in one piece, {} gives at most {:.0f}",
        batch, std::max(rows, codes), device.limits().name, limit);
  }
  if (static_cast<double>(signals) * static_cast<double>(options.sparsity) > most_entries) {
    fail_input("K-SVD of {} signals of {} atoms each: more than are counted", signals,
               options.sparsity);
  }
  const std::size_t entry = sizeof(std::uint32_t) + sizeof(float);
  const std::size_t k = options.sparsity;
  const std::size_t compared = std::min(compared_atoms, options.atoms);
  MemoryPlan plan;
  plan.add("signals and residuals", 2 * batch * leading * sizeof(float));
  // two on the device, the uses there and on the host; those of all signals, and the best
  plan.add("codes", batch * (4 * k + 2) * entry + 2 * signals * (k + 1) * entry);
  plan.add("errors of the signals", batch * sizeof(float) + signals * 3 * sizeof(double));
  plan.add("dictionary",
           options.atoms * (2 * leading * sizeof(float) + 3 * dimension * sizeof(double)));
  plan.add("rows from the source",
           2 * std::min(staged_rows(leading), signals) * leading * sizeof(float));
  plan.add("atom update", ops::AtomUpdate::bytes(leading));
  plan.add("pursuit", ops::BatchOmp::bytes(device, options.atoms, dimension, omp_options(options)));
  plan.add("inner products of atoms", 2 * compared * options.atoms * sizeof(float) +
                                          ops::product_bytes(device, options.atoms, leading));
  return plan;
}

}  // namespace weft
