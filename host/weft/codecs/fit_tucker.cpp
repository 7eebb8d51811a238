#include "weft/codecs/fit_tucker.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <utility>

#include "weft/codecs/held_tensor.hpp"
#include "weft/codecs/long_modes.hpp"
#include "weft/codecs/scan_source.hpp"
#include "weft/codecs/scattered_rows.hpp"
#include "weft/codecs/tensor_tiles.hpp"
#include "weft/codecs/tucker_plan.hpp"
#include "weft/error.hpp"
#include "weft/ops/sum_squares.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

using By = TensorTiles::By;

// Room in the squared error, and in bytes, that a fit leaves to the goal's cuts.
constexpr double first_share = 0.25;
constexpr double first_bytes = 3;

// Singular vectors of a mode with their squared values.
struct Spectrum {
  std::vector<double> values;   // descending
  std::vector<double> vectors;  // row-major [n][n], or [n][columns] of a long mode
  std::size_t columns = 0;
};

Spectrum spectrum_of(const std::vector<double>& gram) {
  const auto n =
      static_cast<std::size_t>(std::llround(std::sqrt(static_cast<double>(gram.size()))));
  reference::SymmetricEigen eigen = reference::symmetric_eigen(n, gram);
  return {std::move(eigen.values), std::move(eigen.vectors), n};
}

// The leading `rank` vectors, [n][rank].
std::vector<float> leading(const Spectrum& spectrum, std::size_t rank) {
  const std::size_t n = spectrum.vectors.size() / spectrum.columns;
  std::vector<float> U(n * rank);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < rank; ++j) {
      U[i * rank + j] = static_cast<float>(spectrum.vectors[i * spectrum.columns + j]);
    }
  }
  return U;
}

class Fitter {
 public:
  Fitter(Device& device, TileSource& source, const TuckerOptions& options, Job& job)
      : device_(device),
        source_(source),
        request_(options.request),
        gram_(options.gram),
        job_(job),
        sizes_(request_.groups.sizes()),
        factors_(sizes_.size()),
        ranks_(sizes_) {
    // values of 8 and 16 bits can be squared in float as they are
    if (source.info().dtype == DType::f32) {
      scale_ = unit_scale(scan_source(device, source, job).largest);
    }
  }

  std::vector<std::vector<double>> spectra() {
    std::vector<std::vector<double>> values;
    for (Spectrum& spectrum : data_spectra()) values.push_back(std::move(spectrum.values));
    return values;
  }

  TuckerFit run() {
    const bool iterates = request_.method == TuckerMethod::hooi;
    if ((iterates ? request_.start : request_.method) == TuckerMethod::hosvd) {
      hosvd();
    } else {
      sthosvd();
    }
    fit_.errors.discarded = lost_;
    if (iterates) iterate();
    finish();
    return std::move(fit_);
  }

 private:
  double values() const { return static_cast<double>(product(sizes_)); }
  double budget() { return first_share * request_.relative * request_.relative * squares(); }
  // What may be lost beyond what is.
  double room() { return request_.relative * request_.relative * squares() - lost_; }
  double source_bytes() const { return static_cast<double>(source_.info().bytes()); }

  // |D|^2, which the first pass finds on its way.
  double squares() {
    if (!squares_known_) {
      stream(By::images, {}, "norm",
             [](const TensorTiles&, const Buffer&, const std::vector<std::size_t>&, std::size_t,
                std::size_t) {});
    }
    return squares_;
  }

  double tile_squares(const TensorTiles& tiles, const Buffer& tile, std::size_t count) {
    const std::size_t values =
        count * tiles.segments() * (tiles.largest_values() / tiles.largest_rest());
    return ops::sum_squares(device_, values, tile, Arithmetic::f32);
  }

  // Streams tiles of a kind with the modes `onto` of it projected on their factors; `use` gets the
  // tile, its sizes, and which part of `rest` it is.
  template <typename Use>
  void stream(By kind, const std::vector<std::size_t>& onto, const char* stage, const Use& use) {
    const StageTimer timer(job_, stage, 0, source_bytes());
    TensorTiles tiles(device_, source_, request_.groups, kind, scale_, job_);
    std::vector<Buffer> factors;
    for (const std::size_t n : onto) {
      factors.emplace_back(device_, factors_[n].size() * sizeof(float), "factor");
      device_.write(factors.back(), std::span<const float>(factors_[n]));
    }
    Buffer projected[2];
    for (Buffer& buffer : projected) {
      if (onto.empty()) continue;
      buffer = Buffer(device_, tiles.largest_values() * sizeof(float), "projected tile");
    }
    double squares = 0;
    tiles.for_each([&](const Buffer& tile, std::size_t first, std::size_t count) {
      if (!squares_known_) squares += tile_squares(tiles, tile, count);
      std::vector<std::size_t> sizes = tiles.modes().tile_sizes(sizes_, count * tiles.segments());
      const Buffer* from = &tile;
      for (std::size_t i = 0; i < onto.size(); ++i) {
        const std::size_t at = tiles.modes().position(onto[i]);
        const std::size_t rank = ranks_[onto[i]];
        const ops::ModeView view = ops::mode_view(sizes, at);
        ops::mode_product(device_, view, *from, ops::ModeProduct::project, factors[i], rank,
                          projected[i % 2]);
        job_.stage(stage).flops += 2 * static_cast<double>(view.elements() * rank);
        sizes[at] = rank;
        from = &projected[i % 2];
      }
      use(tiles, *from, sizes, first, count);
      job_.advance(stage, first + count, tiles.rest());
    });
    if (squares_known_) return;
    squares_ = squares;
    squares_known_ = true;
    // the first value that is not finite, by name
    if (!std::isfinite(squares)) scan_source(device_, source_, job_);
  }

  // Spectra of modes of one kind, of D as projected on the modes `onto` of that kind.
  std::vector<Spectrum> streamed_spectra(By kind, const std::vector<std::size_t>& modes,
                                         const std::vector<std::size_t>& onto) {
    std::vector<Spectrum> spectra;
    std::vector<ops::ModeGram> grams;
    std::vector<std::size_t> by_gram;
    for (const std::size_t n : modes) {
      if (sizes_[n] > longest_gram_mode) continue;
      grams.emplace_back(device_, sizes_[n], gram_);
      by_gram.push_back(n);
    }
    if (!by_gram.empty()) {
      stream(kind, onto, "Gram matrices",
             [&](const TensorTiles& tiles, const Buffer& tile,
                 const std::vector<std::size_t>& sizes, std::size_t, std::size_t) {
               for (std::size_t i = 0; i < by_gram.size(); ++i) {
                 const ops::ModeView view =
                     ops::mode_view(sizes, tiles.modes().position(by_gram[i]));
                 grams[i].add(tile, view);
                 job_.stage("Gram matrices").flops +=
                     static_cast<double>(view.elements() * (view.size + 1));
               }
             });
    }
    for (const std::size_t n : modes) {
      const auto at = std::find(by_gram.begin(), by_gram.end(), n);
      if (at != by_gram.end()) {
        const StageTimer timer(job_, "eigenvectors");
        spectra.push_back(
            spectrum_of(grams[static_cast<std::size_t>(at - by_gram.begin())].matrix()));
      } else {
        spectra.push_back(long_spectrum(n));
      }
    }
    return spectra;
  }

  // Of a long mode, from the data itself.
  Spectrum long_spectrum(std::size_t n) {
    LongModeVectors found =
        long_mode_vectors(device_, source_, request_.groups, n, request_.most[n], scale_, job_);
    return {std::move(found.squares), std::move(found.vectors), found.columns};
  }

  // D projected on the modes `onto` of one kind, whole, in host memory.
  HeldTensor hold(By kind, const std::vector<std::size_t>& onto) {
    std::vector<std::size_t> sizes = sizes_;
    for (const std::size_t n : onto) sizes[n] = ranks_[n];
    const FloatStore::Place place =
        place_of_held(device_, source_, {request_, gram_}, job_, product(sizes) * sizeof(float));
    if (place == FloatStore::Place::file && !noted_file_) {
      job_.notes.push_back(
          fmt::format("the projected tensor, {} bytes, is held in a temporary file: --memory {}",
                      product(sizes) * sizeof(float), job_.memory));
      noted_file_ = true;
    }
    HeldTensor W(std::move(sizes), place);
    std::optional<ScatteredRows> rows;
    stream(kind, onto, "projection",
           [&](const TensorTiles& tiles, const Buffer& tile,
               const std::vector<std::size_t>& tile_sizes, std::size_t first, std::size_t count) {
             const std::size_t values = product(tile_sizes);
             if (kind == By::images) {
               device_.read(tile, std::span(W.values).subspan(first * (values / count), values));
             } else {
               // rows of a block of texels
               if (!rows) rows.emplace(W.values, tiles.rest() / tiles.segments());
               rows->add(device_, tile, values / count, count, first);
             }
           });
    if (rows) rows->finish();
    return W;
  }

  Spectrum held_spectrum(const HeldTensor& W, std::size_t n) {
    const ops::ModeView view = ops::mode_view(W.sizes, n);
    if (view.size > longest_gram_mode) {
      LongModeVectors found = long_mode_vectors(device_, W, n, request_.most[n], job_);
      return {std::move(found.squares), std::move(found.vectors), found.columns};
    }
    std::vector<double> gram;
    {
      const StageTimer timer(job_, "Gram matrices",
                             static_cast<double>(view.elements() * (view.size + 1)));
      gram = W.gram(device_, n, gram_);
    }
    const StageTimer timer(job_, "eigenvectors");
    return spectrum_of(gram);
  }

  void project(HeldTensor& W, std::size_t n) {
    const StageTimer timer(job_, "projection",
                           2 * static_cast<double>(W.values.size() * ranks_[n]));
    W.project(device_, n, ranks_[n], factors_[n]);
  }

  // Modes of a kind that have a factor by now.
  std::vector<std::size_t> projected_modes(By kind) const {
    std::vector<std::size_t> modes;
    for (std::size_t n = 0; n < sizes_.size(); ++n) {
      if (kind_of(request_.groups.groups()[n]) == kind && !factors_[n].empty()) modes.push_back(n);
    }
    return modes;
  }

  std::vector<Spectrum> data_spectra() {
    std::vector<Spectrum> spectra(sizes_.size());
    for (const By kind : {By::texels, By::images}) {
      std::vector<std::size_t> modes;
      for (std::size_t n = 0; n < sizes_.size(); ++n) {
        if (kind_of(request_.groups.groups()[n]) == kind && request_.cuts(n)) modes.push_back(n);
      }
      if (modes.empty()) continue;
      std::vector<Spectrum> found = streamed_spectra(kind, modes, {});
      for (std::size_t i = 0; i < modes.size(); ++i) spectra[modes[i]] = std::move(found[i]);
    }
    return spectra;
  }

  std::vector<std::size_t> ranks_from(const std::vector<Spectrum>& spectra) {
    std::vector<std::size_t> ranks = request_.most;
    std::vector<std::vector<double>> values;
    std::vector<std::uint8_t> cut;
    for (const Spectrum& spectrum : spectra) {
      values.push_back(spectrum.values);
      cut.push_back(spectrum.values.size() > 1 ? 1 : 0);
    }
    for (std::size_t n = 0; n < ranks.size(); ++n) {
      if (cut[n] != 0) ranks[n] = std::min(ranks[n], spectra[n].columns);
    }
    if (request_.bytes > 0) {
      std::vector<std::uint8_t> whole = cut;  // long modes keep the rank that they were given
      for (std::size_t n = 0; n < ranks.size(); ++n) {
        if (sizes_[n] > longest_gram_mode) whole[n] = 0;
      }
      const TuckerBytes bytes = tucker_bytes(request_, whole);
      const auto most = static_cast<double>(request_.bytes);
      const RankChoice choice = cut_ranks(std::span<const std::vector<double>>(values), sizes_,
                                          bytes, {0, first_bytes * most});
      // what is left must hold ranks in equal proportion too, for the goal's cuts to compare
      const std::vector<std::size_t> equal = equal_proportion(bytes, most);
      for (std::size_t n = 0; n < ranks.size(); ++n) {
        ranks[n] = std::min(ranks[n], std::max(choice.ranks[n], equal[n]));
      }
    } else if (request_.relative > 0) {
      const double modes = static_cast<double>(std::count(cut.begin(), cut.end(), 1));
      for (std::size_t n = 0; n < ranks.size(); ++n) {
        if (cut[n] != 0) ranks[n] = std::min(ranks[n], rank_within(values[n], budget() / modes));
      }
    }
    return ranks;
  }

  void hosvd() {
    const std::vector<Spectrum> spectra = data_spectra();
    ranks_ = ranks_from(spectra);
    for (std::size_t n = 0; n < sizes_.size(); ++n) {
      if (spectra[n].values.empty() ||
          !request_.takes_factor(n, ranks_[n], spectra[n].values.back(), room())) {
        continue;
      }
      factors_[n] = leading(spectra[n], ranks_[n]);
      bound_ += sizes_[n] > longest_gram_mode
                    ? std::max(0.0, squares() - kept(spectra[n].values, ranks_[n]))
                    : tail(spectra[n].values, ranks_[n]);
    }
    HeldTensor core = project_all();
    lost_ = std::max(0.0, squares() - core.squares());
    make_model(std::move(core));
  }

  // D projected on all factors: the kind that leaves less is streamed.
  HeldTensor project_all() {
    TuckerRequest known = request_;
    known.most = ranks_;
    known.relative = 0;
    known.bytes = 0;
    const By first = first_kind(known);
    HeldTensor W = hold(first, projected_modes(first));
    const std::vector<std::size_t> sizes = W.sizes;
    const std::vector<std::size_t> others =
        projected_modes(first == By::texels ? By::images : By::texels);
    for (const std::size_t n : cheapest_cuts(sizes, ranks_, others)) project(W, n);
    return W;
  }

  static double kept(const std::vector<double>& squares, std::size_t rank) {
    return std::accumulate(squares.begin(), squares.begin() + static_cast<std::ptrdiff_t>(rank),
                           0.0);
  }

  void sthosvd() {
    std::vector<std::size_t> wanted = request_.most;
    if (request_.bytes > 0) wanted = ranks_from(data_spectra());
    std::vector<std::size_t> guess = wanted;
    std::vector<std::size_t> modes;
    for (std::size_t n = 0; n < guess.size(); ++n) {
      if (!request_.cuts(n)) continue;
      modes.push_back(n);
      if (request_.relative > 0) {
        guess[n] = std::max<std::size_t>(1, std::min(guess[n], sizes_[n] / 2));
      }
    }
    // the first kind streamed, the other in what is left
    TuckerRequest shape = request_;
    shape.most = wanted;
    const By first = first_kind(shape);
    std::vector<std::size_t> streamed;
    std::vector<std::size_t> held;
    for (const std::size_t n : cheapest_cuts(sizes_, guess, modes)) {
      (kind_of(request_.groups.groups()[n]) == first ? streamed : held).push_back(n);
    }
    // a long mode is cut from the data as it is
    std::stable_partition(streamed.begin(), streamed.end(),
                          [&](std::size_t n) { return sizes_[n] > longest_gram_mode; });
    std::size_t left = streamed.size() + held.size();
    const auto choose = [&](std::size_t n, const Spectrum& spectrum, double squares) {
      ranks_[n] = std::min(wanted[n], spectrum.columns);
      if (request_.relative > 0) {
        ranks_[n] =
            std::min(ranks_[n],
                     rank_within(spectrum.values, (budget() - lost_) / static_cast<double>(left)));
      }
      --left;
      if (!request_.takes_factor(n, ranks_[n], spectrum.values.back(), room())) return;
      lost_ += sizes_[n] > longest_gram_mode
                   ? std::max(0.0, squares - kept(spectrum.values, ranks_[n]))
                   : tail(spectrum.values, ranks_[n]);
      factors_[n] = leading(spectrum, ranks_[n]);
    };
    for (const std::size_t n : streamed) {
      const std::vector<Spectrum> found = streamed_spectra(first, {n}, projected_modes(first));
      choose(n, found[0], squares() - lost_);
    }
    HeldTensor W = hold(first, projected_modes(first));
    for (const std::size_t n : held) {
      const Spectrum spectrum = held_spectrum(W, n);
      choose(n, spectrum, squares() - lost_);
      if (!factors_[n].empty()) project(W, n);
    }
    make_model(std::move(W));
  }

  // Alternating least squares (De Lathauwer et al. 2000): for each kind, D projected on the other
  // kind's modes is held, and all modes of this kind are found in it; where the other kind has
  // none, they are found in the stream.
  void iterate() {
    const TuckerModel& model = *fit_.model;
    ranks_ = model.ranks;
    for (std::size_t n = 0; n < sizes_.size(); ++n) factors_[n] = model.factors[n];
    fit_.model.reset();
    HeldTensor core;
    for (std::size_t i = 0; i < request_.iterations; ++i) {
      for (const By kind : {By::texels, By::images}) {
        const std::vector<std::size_t> modes = projected_modes(kind);
        const std::vector<std::size_t> others =
            projected_modes(kind == By::texels ? By::images : By::texels);
        core = HeldTensor();
        if (modes.empty()) continue;
        if (others.empty()) {
          for (const std::size_t n : modes) {
            std::vector<std::size_t> onto = modes;
            std::erase(onto, n);
            factors_[n] = leading(streamed_spectra(kind, {n}, onto)[0], ranks_[n]);
          }
          core = hold(kind, modes);
          continue;
        }
        const HeldTensor W = hold(kind == By::texels ? By::images : By::texels, others);
        for (const std::size_t n : modes) {
          HeldTensor part = W;
          for (const std::size_t m : modes) {
            if (m != n) project(part, m);
          }
          factors_[n] = leading(held_spectrum(part, n), ranks_[n]);
          project(part, n);
          core = std::move(part);
        }
      }
      job_.advance("iteration", i + 1, request_.iterations);
    }
    if (core.values.empty()) core = project_all();
    lost_ = std::max(0.0, squares() - core.squares());
    fit_.errors.discarded = lost_;
    make_model(std::move(core));
  }

  void make_model(HeldTensor core) {
    fit_.model = std::make_unique<TuckerModel>();
    fit_.model->set_groups(request_.groups);
    fit_.model->ranks = std::move(core.sizes);
    fit_.model->core = std::move(core.values);
    fit_.model->factors = factors_;
  }

  // Back to the data's own magnitude.
  void finish() {
    double core_squares = 0;
    const float inverse = 1 / scale_;
    for (float& value : fit_.model->core) {
      core_squares += double{value} * double{value};
      // in two steps where the scale's inverse is no normal float
      value = std::isnormal(inverse) ? value * inverse
                                     : static_cast<float>(double{value} / double{scale_});
    }
    const double unit = 1 / (double{scale_} * double{scale_});
    fit_.errors.squares = squares() * unit;
    fit_.errors.core_squares = core_squares * unit;
    fit_.errors.bound = bound_ * unit;
    fit_.errors.discarded *= unit;
  }

  Device& device_;
  TileSource& source_;
  const TuckerRequest& request_;
  Arithmetic gram_;
  Job& job_;
  std::vector<std::size_t> sizes_;
  std::vector<std::vector<float>> factors_;  // U_n [I_n][R_n], or empty
  std::vector<std::size_t> ranks_;
  float scale_ = 1;
  double squares_ = 0;  // of the scaled data
  bool squares_known_ = false;
  bool noted_file_ = false;
  double lost_ = 0;
  double bound_ = 0;
  TuckerFit fit_;
};

}  // namespace

TuckerFit fit_tucker(Device& device, TileSource& source, const TuckerOptions& options, Job& job) {
  return Fitter(device, source, options, job).run();
}

std::vector<std::vector<double>> mode_spectra(Device& device, TileSource& source,
                                              const ModeGroups& groups,
                                              std::span<const std::size_t> modes, Job& job) {
  TuckerOptions options;
  options.request.groups = groups;
  options.request.most = groups.sizes();
  // a mode is looked at where it is to be cut
  for (const std::size_t n : modes) options.request.most[n] -= 1;
  MemoryPlan plan = plan_tucker(device, source, options, job);
  plan.limit = job.memory;
  plan.check();
  return Fitter(device, source, options, job).spectra();
}

}  // namespace weft
