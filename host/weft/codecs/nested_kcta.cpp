#include "weft/codecs/nested_kcta.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>
#include <utility>

#include "weft/model/tucker_ranks.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/mode_product.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

using Sizes = std::vector<std::size_t>;
using Values = std::vector<double>;

// What the numbers of a clustered model are counted by.
struct ClusteredSizes {
  Sizes sizes;  // of the modes
  std::size_t mode = 0;
  std::size_t clusters = 1;
  std::size_t mixtures = 1;
  std::vector<std::uint8_t> global;  // whether a mode has one basis for all clusters
  std::size_t grid_side = 0;

  double numbers(std::span<const std::size_t> ranks) const {
    const auto count = static_cast<double>(clusters);
    double core = count;
    double rest = 0;
    for (std::size_t n = 0; n < ranks.size(); ++n) {
      const auto rank = static_cast<double>(ranks[n]);
      const double column = static_cast<double>(sizes[n]) * rank;
      core *= rank;
      if (n == mode) {
        const auto rows = static_cast<double>(sizes[n] + grid_side * grid_side);
        rest += static_cast<double>(mixtures) * rows * rank;
      } else if (ranks[n] < sizes[n]) {
        rest += (global[n] != 0 ? 1 : count) * column;
      }
    }
    return core + rest;
  }
};

// Columns of a basis [rows][rank] turned by Q [rank][rank]; Q itself where there is no basis.
std::vector<float> turned(std::span<const float> basis, const Values& Q, std::size_t rank) {
  if (basis.empty()) return {Q.begin(), Q.end()};
  const Sizes sizes{basis.size() / rank, rank};
  const Values U = reference::mode_product(sizes, 1, Values(basis.begin(), basis.end()), rank,
                                           reference::transposed(rank, rank, Q));
  return {U.begin(), U.end()};
}

// The models; their modes in the order of the groups, cores' with the clustered mode first.
class NestedKcta final : public NestedModels {
 public:
  explicit NestedKcta(NestedClusters clusters) : made_(std::move(clusters)) {
    const KctaModel& whole = *made_.fit.model;
    counted_ = {whole.groups.sizes(), whole.mode,   whole.clusters,
                whole.mixtures,       made_.global, whole.grid_side};
    axes_.push_back(whole.mode);
    for (std::size_t n = 0; n < whole.groups.count(); ++n) {
      if (n != whole.mode) axes_.push_back(n);
      // longer ones that are whole have no Gram matrix
      turns_.push_back(n == whole.mode || whole.has_factor(n) ||
                               whole.groups.groups()[n].size <= longest_kcta_mode
                           ? 1
                           : 0);
    }
    lost_ = made_.fit.errors.lost + made_.fit.errors.history.back();
    make_orthogonal();
    cut();
  }

  std::size_t count() const override { return cuts_.size(); }
  std::size_t values(std::size_t i) const override {
    return static_cast<std::size_t>(counted_.numbers(cuts_[i].ranks));
  }
  double error(std::size_t i) const override {
    const double squares = made_.fit.errors.squares;
    return squares > 0 ? std::sqrt((lost_ + cuts_[i].lost) / squares) : 0;
  }
  bool complete() const override { return !made_.bound.empty(); }
  std::string bound() const override { return made_.bound; }
  std::size_t decompositions() const override { return made_.decompositions; }
  // Mixtures are found for the cores as large as they are.
  bool cuts_lose() const override { return made_.fit.model->mixtures > 1; }
  std::shared_ptr<const ModeSpectra> spectra() const override { return made_.spectra; }

  std::unique_ptr<Model> model(std::size_t i) const override {
    const KctaModel& whole = *made_.fit.model;
    const Sizes& ranks = cuts_[i].ranks;
    auto model = std::make_unique<KctaModel>();
    model->info = whole.info;
    model->set_groups(whole.groups, whole.mode);
    model->clusters = whole.clusters;
    model->mixtures = whole.mixtures;
    model->ranks = ranks;
    model->members = whole.members;
    model->mixing = leading_columns(whole.mixing, whole.ranks[whole.mode], ranks[whole.mode]);
    model->grid_side = whole.grid_side;
    model->grid_members = whole.grid_members;
    model->grid_mixing =
        leading_columns(whole.grid_mixing, whole.ranks[whole.mode], ranks[whole.mode]);
    for (std::size_t n = 0; n < ranks.size(); ++n) {
      if (n == whole.mode || ranks[n] == counted_.sizes[n]) continue;
      auto& to = counted_.global[n] != 0 ? model->global[n] : model->local[n];
      to = leading_columns(counted_.global[n] != 0 ? whole.global[n] : whole.local[n],
                           whole.ranks[n], ranks[n]);
    }
    const std::size_t core = whole.cores.size() / whole.clusters;
    for (std::size_t c = 0; c < whole.clusters; ++c) {
      const std::vector<float> Z =
          core_of(c, std::span(whole.cores).subspan(c * core, core), ranks);
      model->cores.insert(model->cores.end(), Z.begin(), Z.end());
    }
    model->info.parameters = made_.parameters(*model, error(i));
    return model;
  }

 private:
  struct Cut {
    Sizes ranks;
    double lost = 0;  // squared, beside what the whole loses
  };

  Sizes core_sizes(std::span<const std::size_t> ranks) const {
    Sizes sizes;
    for (const std::size_t n : axes_) sizes.push_back(ranks[n]);
    return sizes;
  }

  // The leading part of a core; modes that are whole lose their turn again.
  std::vector<float> core_of(std::size_t c, std::span<const float> core, const Sizes& ranks) const {
    const KctaModel& whole = *made_.fit.model;
    Sizes sizes = core_sizes(ranks);
    std::vector<float> Z = leading_part(core, core_sizes(whole.ranks), sizes);
    for (std::size_t a = 1; a < axes_.size(); ++a) {
      const std::size_t n = axes_[a];
      if (turns_[n] == 0 || ranks[n] < counted_.sizes[n]) continue;
      const std::span<const float> U = whole.factor(n, c);
      const Values back = reference::mode_product(sizes, a, Values(Z.begin(), Z.end()), sizes[a],
                                                  Values(U.begin(), U.end()));
      Z.assign(back.begin(), back.end());
    }
    return Z;
  }

  // All-orthogonal cores: each mode turned to the eigenvectors of its Gram matrix, of all clusters
  // together where they have one basis.
  void make_orthogonal() {
    KctaModel& whole = *made_.fit.model;
    const Sizes sizes = core_sizes(whole.ranks);
    const std::size_t core = whole.cores.size() / whole.clusters;
    std::vector<Values> shared(axes_.size());  // turns of shared bases
    for (std::size_t c = 0; c < whole.clusters; ++c) {
      const Values Z = core_values(c, core);
      for (std::size_t a = 1; a < axes_.size(); ++a) {
        if (counted_.global[axes_[a]] == 0) continue;
        const Values gram = reference::mode_gram(sizes, a, Z);
        shared[a].resize(gram.size(), 0.0);
        for (std::size_t i = 0; i < gram.size(); ++i) shared[a][i] += gram[i];
      }
    }
    for (std::size_t a = 1; a < axes_.size(); ++a) {
      if (shared[a].empty()) continue;
      shared[a] = reference::symmetric_eigen(sizes[a], shared[a]).vectors;
      whole.global[axes_[a]] = turned(whole.global[axes_[a]], shared[a], sizes[a]);
    }
    std::vector<std::vector<float>> local(axes_.size());
    for (std::size_t c = 0; c < whole.clusters; ++c) {
      Values Z = core_values(c, core);
      for (std::size_t a = 0; a < axes_.size(); ++a) {
        const std::size_t n = axes_[a];
        if (turns_[n] == 0) continue;
        Values Q = shared[a];
        if (Q.empty()) {
          Q = reference::symmetric_eigen(sizes[a], reference::mode_gram(sizes, a, Z)).vectors;
          if (a == 0) {
            turn_mixing(c, Q);
          } else {
            const std::vector<float> U = turned(whole.factor(n, c), Q, sizes[a]);
            local[a].insert(local[a].end(), U.begin(), U.end());
          }
        }
        Z = reference::mode_product(sizes, a, Z, sizes[a],
                                    reference::transposed(sizes[a], sizes[a], Q));
      }
      std::copy(Z.begin(), Z.end(), whole.cores.begin() + static_cast<std::ptrdiff_t>(c * core));
    }
    for (std::size_t a = 1; a < axes_.size(); ++a) {
      if (!local[a].empty()) whole.local[axes_[a]] = std::move(local[a]);
    }
  }

  Values core_values(std::size_t c, std::size_t core) const {
    const auto first = made_.fit.model->cores.begin() + static_cast<std::ptrdiff_t>(c * core);
    return {first, first + static_cast<std::ptrdiff_t>(core)};
  }

  // Rows of a cluster's mixing matrix.
  void turn_mixing(std::size_t c, const Values& Q) {
    KctaModel& whole = *made_.fit.model;
    const std::size_t rank = whole.ranks[whole.mode];
    const auto turn = [&](const IndexTensor& members, std::span<float> mixing) {
      for (std::size_t i = 0; i < members.size(); ++i) {
        if (members[i] != c) continue;
        const std::span<float> row = mixing.subspan(i * rank, rank);
        const std::vector<float> made = turned(row, Q, rank);
        std::copy(made.begin(), made.end(), row.begin());
      }
    };
    turn(whole.members, whole.mixing);
    turn(whole.grid_members, whole.grid_mixing);
  }

  // Chains of ever smaller ranks, one for each rank of the clustered mode, whose steps are large;
  // of all their models those that no other beats in both size and error.
  void cut() {
    std::vector<Cut> all;
    for (std::size_t rank = made_.fit.model->ranks[made_.fit.model->mode]; rank > 0;
         rank = below(rank)) {
      add_chain(rank, all);
    }
    std::stable_sort(all.begin(), all.end(), [&](const Cut& one, const Cut& other) {
      return counted_.numbers(one.ranks) < counted_.numbers(other.ranks);
    });
    for (Cut& cut : all) {
      if (!cuts_.empty() && cut.lost >= cuts_.back().lost) continue;
      const bool larger =
          cuts_.empty() || counted_.numbers(cut.ranks) > counted_.numbers(cuts_.back().ranks);
      if (larger) {
        cuts_.push_back(std::move(cut));
      } else {
        cuts_.back() = std::move(cut);
      }
    }
  }

  // Models with this rank of the clustered mode.
  void add_chain(std::size_t rank, std::vector<Cut>& all) const {
    const KctaModel& whole = *made_.fit.model;
    const Sizes sizes = core_sizes(whole.ranks);
    const std::size_t core = whole.cores.size() / whole.clusters;
    Cut now{whole.ranks, 0};
    now.ranks[whole.mode] = rank;
    Sizes left = core_sizes(now.ranks);
    Values squares(core, 0.0);  // of all clusters' cores
    for (std::size_t i = 0; i < whole.cores.size(); ++i) {
      squares[i % core] += double{whole.cores[i]} * double{whole.cores[i]};
    }
    const auto kept = static_cast<std::ptrdiff_t>(core / sizes[0] * rank);
    now.lost = std::accumulate(squares.begin() + kept, squares.end(), 0.0);
    std::vector<Values> slices;  // sums of squares of what is left of the core
    for (const std::size_t size : sizes) slices.emplace_back(size, 0.0);
    for_each(sizes, left, sizes.size(), 0, [&](const Sizes& index, std::size_t at) {
      for (std::size_t a = 0; a < index.size(); ++a) slices[a][index[a]] += squares[at];
    });
    all.push_back(now);
    for (;;) {
      const std::size_t axis = cheapest(now, slices);
      if (axis == axes_.size()) break;
      const std::size_t first = below(left[axis]);
      for_each(sizes, left, axis, first, [&](const Sizes& index, std::size_t at) {
        now.lost += squares[at];
        for (std::size_t a = 0; a < index.size(); ++a) {
          if (a != axis) slices[a][index[a]] -= squares[at];
        }
      });
      now.ranks[axes_[axis]] = left[axis] = first;
      all.push_back(now);
    }
  }

  // The next smaller rank that is allowed.
  std::size_t below(std::size_t rank) const { return (rank - 1) / made_.align * made_.align; }

  // The axis behind the first whose next cut loses least for the numbers it saves; axes_.size()
  // where all are at their least.
  std::size_t cheapest(const Cut& now, const std::vector<Values>& slices) const {
    const double held = counted_.numbers(now.ranks);
    std::size_t best = axes_.size();
    double best_loss = 0;
    Sizes ranks = now.ranks;
    for (std::size_t a = 1; a < axes_.size(); ++a) {
      std::size_t& rank = ranks[axes_[a]];
      const std::size_t whole = rank;
      const std::size_t kept = below(rank);
      if (turns_[axes_[a]] == 0 || kept == 0) continue;
      double lost = 0;
      for (std::size_t j = kept; j < whole; ++j) lost += std::max(0.0, slices[a][j]);
      rank = kept;
      const double loss = lost / std::max(1.0, held - counted_.numbers(ranks));
      rank = whole;
      if (best == axes_.size() || loss < best_loss) {
        best = a;
        best_loss = loss;
      }
    }
    return best;
  }

  // Calls use(index, place) for the leading part `left` of a core, with indices of `axis` from
  // `first` on.
  template <typename Use>
  static void for_each(const Sizes& sizes, const Sizes& left, std::size_t axis, std::size_t first,
                       const Use& use) {
    Sizes index(sizes.size(), 0);
    if (axis < index.size()) index[axis] = first;
    for (;;) {
      std::size_t at = 0;
      for (std::size_t a = 0; a < sizes.size(); ++a) at = at * sizes[a] + index[a];
      use(index, at);
      std::size_t a = sizes.size();
      while (a-- > 0) {
        if (++index[a] < left[a]) break;
        index[a] = a == axis ? first : 0;
      }
      if (a == static_cast<std::size_t>(-1)) return;
    }
  }

  NestedClusters made_;
  ClusteredSizes counted_;
  Sizes axes_;                       // groups of a core's axes
  std::vector<std::uint8_t> turns_;  // whether a mode can be cut
  double lost_ = 0;                  // squared, by the whole
  std::vector<Cut> cuts_;
};

}  // namespace

std::unique_ptr<NestedModels> nested_clusters(NestedClusters clusters) {
  return std::make_unique<NestedKcta>(std::move(clusters));
}

double clustered_numbers(const KctaRequest& request) {
  return ClusteredSizes{request.groups.sizes(), request.mode,        request.clusters,
                        request.mixtures,       request.global_mode, request.grid_side}
      .numbers(request.ranks);
}

}  // namespace weft
