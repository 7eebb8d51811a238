#include "weft/reference/tucker.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

#include "weft/error.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/mode_product.hpp"
#include "weft/reference/tile.hpp"

namespace weft {
namespace {

// [..][P][C] as [..][C][P], or back.
std::vector<double> turn_channels(std::span<const double> values, std::size_t rows,
                                  std::size_t columns) {
  std::vector<double> turned(values.size());
  const std::size_t image = rows * columns;
  for (std::size_t first = 0; first < values.size(); first += image) {
    for (std::size_t i = 0; i < rows; ++i) {
      for (std::size_t j = 0; j < columns; ++j) {
        turned[first + j * rows + i] = values[first + i * columns + j];
      }
    }
  }
  return turned;
}

double squares_of(std::span<const double> values) {
  double sum = 0;
  for (const double value : values) sum += value * value;
  return sum;
}

// A tensor, the factors it was projected on so far, and their leading columns.
struct Projected {
  std::vector<std::size_t> sizes;
  std::vector<double> values;

  reference::SymmetricEigen spectrum(std::size_t n) const {
    return reference::symmetric_eigen(sizes[n], reference::mode_gram(sizes, n, values));
  }
  // Onto the columns of a row-major U [size][rank].
  void project(std::size_t n, std::size_t rank, std::span<const double> U) {
    values =
        reference::mode_product(sizes, n, values, rank, reference::transposed(sizes[n], rank, U));
    sizes[n] = rank;
  }
};

std::vector<double> leading(const reference::SymmetricEigen& eigen, std::size_t rank) {
  const std::size_t n = eigen.values.size();
  std::vector<double> U(n * rank);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < rank; ++j) U[i * rank + j] = eigen.vectors[i * n + j];
  }
  return U;
}

}  // namespace

std::string_view name_of(TuckerMethod method) {
  switch (method) {
    case TuckerMethod::hosvd:
      return "hosvd";
    case TuckerMethod::sthosvd:
      return "sthosvd";
    case TuckerMethod::hooi:
      return "hooi";
  }
  return "";
}

bool TuckerRequest::cuts(std::size_t n) const {
  const std::size_t size = groups.groups()[n].size;
  if (most[n] < size) return true;
  return has_goal() && size > 1 && size <= longest_gram_mode;
}

bool TuckerRequest::takes_factor(std::size_t n, std::size_t rank, double least, double room) const {
  if (rank < groups.groups()[n].size) return true;
  return cuts(n) && (bytes > 0 || (relative > 0 && least <= room));
}

std::vector<std::size_t> cheapest_cuts(std::span<const std::size_t> sizes,
                                       std::span<const std::size_t> ranks,
                                       std::vector<std::size_t> modes) {
  std::sort(modes.begin(), modes.end());
  std::vector<std::size_t> order = modes;
  std::vector<std::size_t> best = modes;
  double least = std::numeric_limits<double>::infinity();
  do {
    double elements = 1;
    for (const std::size_t size : sizes) elements *= static_cast<double>(size);
    double flops = 0;
    for (const std::size_t n : order) {
      const double kept = static_cast<double>(ranks[n]);
      flops += elements * (static_cast<double>(sizes[n]) + 2 * kept);
      elements *= kept / static_cast<double>(sizes[n]);
    }
    if (flops < least) {
      least = flops;
      best = order;
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return best;
}

TuckerBytes tucker_bytes(const TuckerRequest& request, std::span<const std::uint8_t> factors) {
  TuckerBytes bytes;
  bytes.value_bytes = request.storage == Storage::f16 ? 2 : 4;
  bytes.scale_bytes = request.storage == Storage::f16 ? 4 : 0;
  bytes.sizes = request.groups.sizes();
  bytes.factors.assign(factors.begin(), factors.end());
  if (request.header) {
    bytes.header = [&request, of = bytes.factors](std::span<const std::size_t> ranks) {
      return request.header(ranks, of);
    };
  }
  return bytes;
}

namespace {

// Short modes that are whole after all: back from their singular vectors.
void restore_short_modes(TuckerModel& model) {
  for (std::size_t n = 0; n < model.ranks.size(); ++n) {
    const std::size_t size = model.groups.groups()[n].size;
    if (!model.has_factor(n) || model.ranks[n] < size || size > short_mode) continue;
    std::size_t inner = 1;
    for (std::size_t m = n + 1; m < model.ranks.size(); ++m) inner *= model.ranks[m];
    std::vector<float> fibre(size);
    for (std::size_t i = 0; i < model.core.size(); ++i) {
      if (i / inner % size != 0) continue;
      for (std::size_t j = 0; j < size; ++j) {
        double sum = 0;
        for (std::size_t r = 0; r < size; ++r) {
          sum += double{model.factors[n][j * size + r]} * double{model.core[i + r * inner]};
        }
        fibre[j] = static_cast<float>(sum);
      }
      for (std::size_t j = 0; j < size; ++j) model.core[i + j * inner] = fibre[j];
    }
    model.factors[n].clear();
  }
}

}  // namespace

RankChoice ranks_to_goal(const TuckerModel& model, const TuckerRequest& request, double squares,
                         double lost) {
  std::vector<std::uint8_t> factors;
  for (std::size_t n = 0; n < model.ranks.size(); ++n) {
    factors.push_back(model.has_factor(n) ? 1 : 0);
  }
  RankGoal goal;
  goal.most_bytes = static_cast<double>(request.bytes);
  goal.most_lost = request.relative * request.relative * squares - lost;
  return cut_ranks(model.core, model.ranks, tucker_bytes(request, factors), goal);
}

std::unique_ptr<TuckerModel> leading_model(const TuckerModel& model,
                                           std::span<const std::size_t> ranks) {
  auto part = std::make_unique<TuckerModel>();
  part->set_groups(model.groups);
  part->ranks.assign(ranks.begin(), ranks.end());
  part->core = leading_part(model.core, model.ranks, ranks);
  for (std::size_t n = 0; n < ranks.size(); ++n) {
    if (model.has_factor(n)) {
      part->factors[n] = leading_columns(model.factors[n], model.ranks[n], ranks[n]);
    }
  }
  restore_short_modes(*part);
  return part;
}

namespace reference {
namespace {

// Room in the squared error that a fit leaves to the goal's cuts, and room in bytes.
constexpr double first_share = 0.25;
constexpr double first_bytes = 3;

class Encoder {
 public:
  Encoder(TileSource& source, const TuckerRequest& request, Job& job)
      : request_(request), shape_(source.info().shape), job_(job) {
    MemoryPlan plan;
    plan.add("tensor", 3 * shape_.values() * sizeof(double));
    plan.add("core", shape_.values() * sizeof(float));
    job.plan(plan);
    const StageTimer timer(job, "read", 0, static_cast<double>(source.info().bytes()));
    D_.sizes = request.groups.sizes();
    D_.values.resize(shape_.values());
    for (std::size_t i = 0; i < shape_.images(); ++i) {
      check_interrupt();
      const std::span<double> image =
          std::span(D_.values).subspan(i * shape_.image_values(), shape_.image_values());
      read_tile(source, i, 1, job.nan_zero, image);
      if (request.groups.channels_first()) {
        const std::vector<double> turned = turn_channels(image, shape_.texels(), shape_.channels);
        std::copy(turned.begin(), turned.end(), image.begin());
      }
    }
    fit_.errors.squares = squares_of(D_.values);
    factors_.resize(D_.sizes.size());
    ranks_ = D_.sizes;
  }

  TuckerFit run() {
    const StageTimer timer(job_, "factorise");
    const TuckerMethod start =
        request_.method == TuckerMethod::hooi ? request_.start : request_.method;
    if (start == TuckerMethod::hosvd) {
      hosvd();
    } else {
      sthosvd();
    }
    fit_.errors.discarded = lost_;
    if (request_.method == TuckerMethod::hooi) iterate();
    for (const float value : fit_.model->core)
      fit_.errors.core_squares += double{value} * double{value};
    return std::move(fit_);
  }

 private:
  double budget() const {
    return first_share * request_.relative * request_.relative * fit_.errors.squares;
  }

  // What may be lost beyond what is.
  double room() const {
    return request_.relative * request_.relative * fit_.errors.squares - lost_;
  }

  // Ranks from the spectra of D itself.
  std::vector<std::size_t> ranks_of(std::span<const std::vector<double>> spectra) const {
    std::vector<std::size_t> ranks = request_.most;
    if (request_.bytes > 0) {
      std::vector<std::uint8_t> cut;
      for (const std::vector<double>& spectrum : spectra) cut.push_back(spectrum.empty() ? 0 : 1);
      const TuckerBytes bytes = tucker_bytes(request_, cut);
      const auto most = static_cast<double>(request_.bytes);
      const RankChoice choice =
          cut_ranks(spectra, request_.groups.sizes(), bytes, {0, first_bytes * most});
      // what is left must hold ranks in equal proportion too, for the goal's cuts to compare
      const std::vector<std::size_t> equal = equal_proportion(bytes, most);
      for (std::size_t n = 0; n < ranks.size(); ++n) {
        ranks[n] = std::min(ranks[n], std::max(choice.ranks[n], equal[n]));
      }
    } else if (request_.relative > 0) {
      const auto modes = std::count_if(spectra.begin(), spectra.end(),
                                       [](const auto& spectrum) { return !spectrum.empty(); });
      for (std::size_t n = 0; n < ranks.size(); ++n) {
        if (spectra[n].empty()) continue;
        ranks[n] =
            std::min(ranks[n], rank_within(spectra[n], budget() / static_cast<double>(modes)));
      }
    }
    return ranks;
  }

  void hosvd() {
    std::vector<SymmetricEigen> eigen(D_.sizes.size());
    std::vector<std::vector<double>> spectra(D_.sizes.size());
    for (std::size_t n = 0; n < D_.sizes.size(); ++n) {
      if (!request_.cuts(n)) continue;
      eigen[n] = D_.spectrum(n);
      spectra[n] = eigen[n].values;
    }
    ranks_ = ranks_of(spectra);
    std::vector<std::size_t> modes;
    for (std::size_t n = 0; n < D_.sizes.size(); ++n) {
      if (!spectra[n].empty() && request_.takes_factor(n, ranks_[n], spectra[n].back(), room())) {
        modes.push_back(n);
      }
    }
    Projected core = D_;
    for (const std::size_t n : cheapest_cuts(D_.sizes, ranks_, modes)) {
      factors_[n] = leading(eigen[n], ranks_[n]);
      fit_.errors.bound += tail(spectra[n], ranks_[n]);
      core.project(n, ranks_[n], factors_[n]);
    }
    lost_ = std::max(0.0, fit_.errors.squares - squares_of(core.values));
    make_model(core);
  }

  void sthosvd() {
    std::vector<std::size_t> wanted = request_.most;
    if (request_.bytes > 0) {
      std::vector<std::vector<double>> spectra(D_.sizes.size());
      for (std::size_t n = 0; n < D_.sizes.size(); ++n) {
        if (request_.cuts(n)) spectra[n] = D_.spectrum(n).values;
      }
      wanted = ranks_of(spectra);
    }
    std::vector<std::size_t> guess = wanted;
    std::vector<std::size_t> modes;
    for (std::size_t n = 0; n < guess.size(); ++n) {
      if (!request_.cuts(n)) continue;
      modes.push_back(n);
      if (request_.relative > 0) guess[n] = std::min(guess[n], D_.sizes[n] / 2);
    }
    Projected T = D_;
    const std::vector<std::size_t> order = cheapest_cuts(D_.sizes, guess, modes);
    for (std::size_t i = 0; i < order.size(); ++i) {
      const std::size_t n = order[i];
      const SymmetricEigen eigen = T.spectrum(n);
      ranks_[n] = wanted[n];
      if (request_.relative > 0) {
        const double share = (budget() - lost_) / static_cast<double>(order.size() - i);
        ranks_[n] = std::min(ranks_[n], rank_within(eigen.values, share));
      }
      if (!request_.takes_factor(n, ranks_[n], eigen.values.back(), room())) continue;
      lost_ += tail(eigen.values, ranks_[n]);
      factors_[n] = leading(eigen, ranks_[n]);
      T.project(n, ranks_[n], factors_[n]);
    }
    make_model(T);
  }

  void iterate() {
    TuckerModel& model = *fit_.model;
    ranks_ = model.ranks;
    for (std::size_t n = 0; n < factors_.size(); ++n) {
      if (model.has_factor(n)) factors_[n].assign(model.factors[n].begin(), model.factors[n].end());
    }
    Projected core;
    for (std::size_t i = 0; i < request_.iterations; ++i) {
      for (std::size_t n = 0; n < factors_.size(); ++n) {
        if (factors_[n].empty()) continue;
        core = D_;
        for (std::size_t m = 0; m < factors_.size(); ++m) {
          if (m != n && !factors_[m].empty()) core.project(m, ranks_[m], factors_[m]);
        }
        factors_[n] = leading(core.spectrum(n), ranks_[n]);
        core.project(n, ranks_[n], factors_[n]);
      }
      job_.advance("factorise", i + 1, request_.iterations);
    }
    if (!core.values.empty()) make_model(core);
  }

  void make_model(const Projected& core) {
    fit_.model = std::make_unique<TuckerModel>();
    TuckerModel& model = *fit_.model;
    model.set_groups(request_.groups);
    model.ranks = core.sizes;
    model.core = std::vector<float>(core.values.begin(), core.values.end());
    for (std::size_t n = 0; n < factors_.size(); ++n) {
      model.factors[n].assign(factors_[n].begin(), factors_[n].end());
    }
  }

  const TuckerRequest& request_;
  BtfShape shape_;
  Job& job_;
  Projected D_;
  std::vector<std::vector<double>> factors_;  // U_n [I_n][R_n], or empty
  std::vector<std::size_t> ranks_;
  double lost_ = 0;
  TuckerFit fit_;
};

}  // namespace

TuckerFit encode_tucker(TileSource& source, const TuckerRequest& request, Job& job) {
  return Encoder(source, request, job).run();
}

void decode_tucker(const TuckerModel& model, std::size_t first, std::size_t count,
                   std::span<double> out) {
  const BtfShape& shape = model.info.btf.shape;
  // Contracts mode n of T with the rows of a view and a light, or of all texels; channels of the
  // same group stay.
  const auto contract = [&](Projected& T, std::size_t n, std::size_t view, std::size_t light) {
    const ModeGroup& group = model.groups.groups()[n];
    std::vector<double> rows(model.factors[n].begin(), model.factors[n].end());
    std::size_t kept = group.size;
    const std::size_t rank = T.sizes[n];
    if (group.of_directions()) {
      const std::size_t at =
          (group.has(Mode::view) ? view * model.groups.stride(Mode::view) : 0) +
          (group.has(Mode::light) ? light * model.groups.stride(Mode::light) : 0);
      kept = group.has(Mode::channel) ? shape.channels : 1;
      std::vector<double> picked(kept * rank, 0.0);
      for (std::size_t c = 0; c < kept; ++c) {
        for (std::size_t r = 0; r < rank; ++r) {
          const double unit = r == at + c ? 1.0 : 0.0;
          picked[c * rank + r] = rows.empty() ? unit : rows[(at + c) * rank + r];
        }
      }
      rows = std::move(picked);
    }
    if (rows.empty()) return;
    T.values = mode_product(T.sizes, n, T.values, kept, rows);
    T.sizes[n] = kept;
  };

  const Projected core{model.ranks, {model.core.begin(), model.core.end()}};
  Projected of_view;  // the core with a view's row, which all its lights share
  for (std::size_t i = first; i < first + count; ++i) {
    const std::size_t view = i / shape.lights;
    const std::size_t light = i % shape.lights;
    const bool views_alone = model.groups.groups()[0].modes.size() == 1;
    if (!views_alone) {
      of_view = core;
    } else if (i == first || light == 0) {
      of_view = core;
      contract(of_view, 0, view, light);
    }
    // core x light vector x view vector (Vasilescu & Terzopoulos 2004, eq. (8)), then the texels
    Projected T = of_view;
    for (std::size_t n = views_alone ? 1 : 0; n < model.groups.count(); ++n) {
      contract(T, n, view, light);
    }
    if (model.groups.channels_first()) {
      T.values = turn_channels(T.values, shape.channels, shape.texels());
    }
    std::copy(T.values.begin(), T.values.end(),
              out.begin() + static_cast<std::ptrdiff_t>((i - first) * shape.image_values()));
  }
}

}  // namespace reference
}  // namespace weft
