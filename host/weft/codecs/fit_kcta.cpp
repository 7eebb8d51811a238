#include "weft/codecs/fit_kcta.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "weft/codecs/decompose_cluster.hpp"
#include "weft/codecs/fit_tucker.hpp"
#include "weft/codecs/held_tensor.hpp"
#include "weft/codecs/kcta_plan.hpp"
#include "weft/codecs/mix_slices.hpp"
#include "weft/codecs/scan_source.hpp"
#include "weft/codecs/slice_rows.hpp"
#include "weft/error.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/kcta_mixing.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

using reference::KctaMixing;
using Sizes = std::vector<std::size_t>;

constexpr const char* update_stage = "update stage";

// A^T B of row-major matrices of as many rows, [columns of A][columns of B].
std::vector<float> product_of_columns(std::span<const float> A, std::size_t a,
                                      std::span<const float> B, std::size_t b) {
  std::vector<double> sums(a * b, 0.0);
  for (std::size_t row = 0; row < A.size() / a; ++row) {
    for (std::size_t i = 0; i < a; ++i) {
      for (std::size_t j = 0; j < b; ++j) {
        sums[i * b + j] += double{A[row * a + i]} * double{B[row * b + j]};
      }
    }
  }
  return {sums.begin(), sums.end()};
}

struct State {
  std::vector<ClusterBases> clusters;
  std::size_t mixtures = 1;
  KctaMixing mixing;

  double error() const { return std::accumulate(mixing.errors.begin(), mixing.errors.end(), 0.0); }
  double core_norms() const {
    double sum = 0;
    for (const ClusterBases& cluster : clusters) {
      double squares = 0;
      for (const float value : cluster.Z) squares += double{value} * double{value};
      sum += std::sqrt(squares);
    }
    return sum;
  }
};

class Fitter final : public KctaEncoder {
 public:
  Fitter(Device& device, TileSource& source, const KctaRequest& request, Job& job)
      : device_(device),
        source_(source),
        request_(request),
        job_(job),
        shape_(request),
        row_(shape_.row()),
        rank_(shape_.ranks[0]),
        decomposition_(device, shape_, update_stage, job) {}

  KctaFit fit() override {
    hold_slices();
    start();
    // a pass of hard clustering before those of soft clustering (section 5.1)
    if (request_.mixtures > 1) iterate(1);
    return iterated(request_.iterations);
  }

  KctaFit refit(const KctaModel& start, std::size_t iterations) override {
    KctaRequest request = request_;
    request.ranks = start.ranks;
    Fitter smaller(device_, source_, request, job_);
    smaller.hold_slices_of(*this, start);
    smaller.start_from(start);
    return smaller.iterated(iterations);
  }

 private:
  KctaFit iterated(std::size_t iterations) {
    for (std::size_t i = 0; i < iterations; ++i) {
      const double before = state_.core_norms();
      const bool better = iterate(request_.mixtures);
      job_.advance("iteration", i + 1, iterations);
      fit_.errors.restored = !better;
      const double norms = state_.core_norms();
      if (!better || std::abs(norms - before) <= request_.least_change * norms) break;
    }
    fit_.errors.squares = squares_of_all_;
    fit_.errors.lost = lost_;
    make_model();
    // what is not needed for another
    B_ = FloatStore();
    residual_ = FloatStore();
    return std::move(fit_);
  }

  // A_G, eq. (23), with the clustered mode first and its largest value near 1.
  void hold_slices() {
    const TuckerOptions options = global_bases_kcta(request_);
    TuckerFit global = fit_tucker(device_, source_, options, job_);
    squares_of_all_ = global.errors.squares;
    lost_ = std::max(0.0, global.errors.discarded);
    global_ = std::move(global.model->factors);
    A_ = std::move(global.model->core);
    const StageTimer timer(job_, "slices");
    float largest = 0;
    for (const float value : A_) largest = std::max(largest, std::abs(value));
    scale_ = unit_scale(double{largest});
    if (scale_ != 1) {
      for (float& value : A_) value *= scale_;
    }
    if (request_.mode > 0) put_first();
    hold_rows(0);
  }

  // The same of a fit with ranks that are no smaller, projected onto the global bases of a model
  // that was cut of it.
  void hold_slices_of(const Fitter& whole, const KctaModel& start) {
    const StageTimer timer(job_, "slices");
    scale_ = whole.scale_;
    squares_of_all_ = whole.squares_of_all_;
    HeldTensor T;
    T.sizes = whole.shape_.sizes;
    T.values = whole.A_;
    for (std::size_t a = 1; a < shape_.sizes.size(); ++a) {
      const std::size_t n = shape_.groups[a];
      const std::size_t rank = shape_.sizes[a];
      if (start.global[n].empty()) continue;
      // A_G x U'^T U of bases U that A_G is given in
      std::vector<float> onto = start.global[n];
      if (!whole.global_[n].empty()) {
        onto = product_of_columns(whole.global_[n], T.sizes[a], start.global[n], rank);
      }
      T.project(device_, a, rank, onto);
    }
    A_ = std::move(T.values);
    global_ = start.global;
    hold_rows(whole.A_.place() == FloatStore::Place::memory ? whole.A_.size() * sizeof(float) : 0);
    const double before = std::accumulate(whole.squares_.begin(), whole.squares_.end(), 0.0);
    const double after = std::accumulate(squares_.begin(), squares_.end(), 0.0);
    lost_ = whole.lost_ + std::max(0.0, before - after) / (double{scale_} * double{scale_});
  }

  // Room for the rows of clusters, beside A_G and what else is held.
  void hold_rows(std::size_t held) {
    place_ = A_.place();
    std::size_t others = A_.place() == FloatStore::Place::memory ? A_.size() * sizeof(float) : 0;
    others += held + working_plan_kcta(device_, request_, shape_).total();
    for (const MemoryItem& item : job_.held) others += item.bytes;
    if (others + held_beside_kcta(request_, shape_) > job_.memory) place_ = FloatStore::Place::file;
    B_ = FloatStore(request_.clusters * rank_ * row_, place_);
    slices_ = row_list(A_, shape_.slices(), row_);
    squares_ = combined_squares(device_, row_, slices_, {}, {});
  }

  // Clusters as a model has them; what they leave is not known.
  void start_from(const KctaModel& start) {
    const std::size_t slices = shape_.slices();
    const std::size_t core = start.cores.size() / start.clusters;
    state_.mixtures = start.mixtures;
    for (std::size_t i = 0; i < start.members.size(); ++i) {
      state_.mixing.members.push_back(static_cast<std::uint32_t>(start.members[i]));
    }
    state_.mixing.coefficients.assign(start.mixing.begin(), start.mixing.end());
    state_.mixing.errors.assign(slices, std::numeric_limits<double>::infinity());
    for (std::size_t c = 0; c < request_.clusters; ++c) {
      ClusterBases cluster;
      const auto first = start.cores.begin() + static_cast<std::ptrdiff_t>(c * core);
      cluster.Z.assign(first, first + static_cast<std::ptrdiff_t>(core));
      for (float& value : cluster.Z) value *= scale_;
      cluster.U.resize(shape_.sizes.size());
      for (std::size_t a = 1; a < shape_.sizes.size(); ++a) {
        if (!shape_.local(a)) continue;
        const std::span<const float> U = start.factor(shape_.groups[a], c);
        cluster.U[a].assign(U.begin(), U.end());
      }
      state_.clusters.push_back(std::move(cluster));
      expand(c);
    }
  }

  void put_first() {
    std::size_t outer = 1;
    for (std::size_t n = 0; n < request_.mode; ++n) outer *= shape_.sizes[n + 1];
    const std::size_t inner = row_ / outer;
    FloatStore turned(A_.size(), A_.place());
    for (std::size_t o = 0; o < outer; ++o) {
      check_interrupt();
      for (std::size_t i = 0; i < shape_.slices(); ++i) {
        std::copy_n(A_.data() + (o * shape_.slices() + i) * inner, inner,
                    turned.data() + i * row_ + o * inner);
      }
    }
    A_ = std::move(turned);
  }

  RowList rows_of(std::size_t cluster) const {
    return row_list(std::span<const float>(B_).subspan(cluster * rank_ * row_, rank_ * row_), rank_,
                    row_);
  }

  void start() {
    const std::size_t slices = shape_.slices();
    std::vector<std::uint32_t>& members = state_.mixing.members;
    if (request_.start == KctaStart::directions) {
      members = cluster_points(slice_parameters(source_.info(), request_.groups, request_.mode),
                               request_.clusters);
    } else if (request_.start == KctaStart::slices) {
      const std::vector<double> gram = row_products(device_, row_, slices_, slices_);
      members = cluster_points(leading_subspace(slices, gram, request_.clusters * rank_),
                               request_.clusters, job_.seed);
    } else {
      members = deal_slices(slices, request_.clusters, job_.seed);
    }
    state_.clusters.resize(request_.clusters);
    state_.mixing.coefficients.assign(slices * rank_, 0.0);
    state_.mixing.errors.assign(slices, 0.0);
    update(std::vector<bool>(request_.clusters, true));
    fit_.errors.history.push_back(state_.error());
  }

  // Both stages; false where the error grew, and what was before is restored.
  bool iterate(std::size_t mixtures) {
    const State before = state_;
    std::vector<bool> fresh(request_.clusters, false);
    {
      const StageTimer timer(job_, "clustering stage");
      const RowList rows = row_list(B_, request_.clusters * rank_, row_);
      const std::vector<double> gram = row_products(device_, row_, rows, rows);
      const std::vector<double> products = row_products(device_, row_, slices_, rows);
      count_products(job_.stage("clustering stage"), shape_.slices() + rows.size(), rows.size(),
                     row_);
      state_.mixtures = mixtures;
      state_.mixing = mix_by_products(request_.clusters, mixtures, products, gram, squares_);
      for (const SliceMove& move : fill_empty_clusters(
               request_.clusters, mixtures, state_.mixing.members, state_.mixing.errors)) {
        fresh[move.to] = true;
        refit(move.slice, fresh, products, gram);
      }
    }
    update(fresh);
    const bool better = state_.error() <= before.error();
    if (!better) {
      state_ = before;
      for (std::size_t c = 0; c < request_.clusters; ++c) expand(c);
    }
    fit_.errors.history.push_back(state_.error());
    return better;
  }

  // Coefficients of a slice for those of its clusters that have a core, its clusters put in order.
  void refit(std::size_t i, const std::vector<bool>& fresh, std::span<const double> products,
             std::span<const double> gram) {
    const std::size_t K = state_.mixtures;
    const std::size_t columns = request_.clusters * rank_;
    const auto members = std::span(state_.mixing.members).subspan(i * K, K);
    std::sort(members.begin(), members.end());
    Sizes known;
    for (const std::uint32_t c : members) {
      for (std::size_t r = 0; r < rank_ && !fresh[c]; ++r) known.push_back(c * rank_ + r);
    }
    std::vector<double> G;
    std::vector<double> a;
    for (const std::size_t p : known) {
      a.push_back(products[i * columns + p]);
      for (const std::size_t q : known) G.push_back(gram[p * columns + q]);
    }
    const std::vector<double> u = reference::solve_mixing(known.size(), G, a);
    auto to = state_.mixing.coefficients.begin() + static_cast<std::ptrdiff_t>(i * K * rank_);
    std::size_t from = 0;
    for (const std::uint32_t c : members) {
      for (std::size_t r = 0; r < rank_; ++r) *to++ = fresh[c] ? 0.0 : u[from++];
    }
  }

  // The rows of a cluster from its core and bases.
  void expand(std::size_t c) {
    const ClusterBases& cluster = state_.clusters[c];
    std::vector<RowProduct> steps;
    Sizes sizes(shape_.ranks.begin() + 1, shape_.ranks.end());
    // the last mode first: what is in front of it is still short
    for (std::size_t a = shape_.sizes.size(); a-- > 1;) {
      if (!shape_.local(a)) continue;
      steps.push_back({a - 1, ops::ModeProduct::expand, shape_.sizes[a], cluster.U[a]});
    }
    count_modes(job_.stage(update_stage), rank_, sizes, steps);
    multiply_modes(device_, sizes, row_list(cluster.Z, rank_, shape_.core_row()), steps,
                   B_.data() + c * rank_ * row_);
  }

  // The update stage, (20)-(22); `fresh` clusters have no bases yet.
  void update(std::vector<bool> fresh) {
    const StageTimer timer(job_, update_stage);
    const std::size_t K = state_.mixtures;
    KctaMixing& mixing = state_.mixing;
    const auto lists = slices_of_clusters(request_.clusters, K, mixing.members);
    for (std::size_t c = 0; c < request_.clusters; ++c) {
      check_interrupt();
      const std::vector<std::size_t>& list = lists[c];
      // places of c among each slice's clusters
      Sizes places;
      for (const std::size_t i : list) {
        const auto first = mixing.members.begin() + static_cast<std::ptrdiff_t>(i * K);
        places.push_back(static_cast<std::size_t>(
            std::find(first, first + static_cast<std::ptrdiff_t>(K), c) - first));
      }
      const RowList residual = residual_of(c, list, fresh);
      const std::vector<float> U_m =
          fresh[c]
              ? decomposition_.begin(state_.clusters[c], residual)
              : decomposition_.refine(state_.clusters[c], residual, orthonormal_rows(list, places));
      fresh[c] = false;
      expand(c);
      set_rows(c, list, places, residual, U_m);
    }
  }

  // R'_c, eq. (20): the slices of a cluster less what their other clusters make of them; the slices
  // themselves where there are none.
  RowList residual_of(std::size_t c, const std::vector<std::size_t>& list,
                      const std::vector<bool>& fresh) {
    const std::size_t K = state_.mixtures;
    const KctaMixing& mixing = state_.mixing;
    std::vector<std::size_t> others;
    for (const std::size_t i : list) {
      for (std::size_t k = 0; k < K; ++k) {
        const std::uint32_t j = mixing.members[i * K + k];
        if (j != c && !fresh[j]) others.push_back(j);
      }
    }
    std::sort(others.begin(), others.end());
    others.erase(std::unique(others.begin(), others.end()), others.end());
    RowList mine = picked(slices_, list);
    if (others.empty()) return mine;
    RowList rows;
    for (const std::size_t j : others) {
      const RowList more = rows_of(j);
      rows.insert(rows.end(), more.begin(), more.end());
    }
    std::vector<float> M(list.size() * rows.size(), 0.0f);
    for (std::size_t s = 0; s < list.size(); ++s) {
      for (std::size_t k = 0; k < K; ++k) {
        const std::size_t at = list[s] * K + k;
        const auto found = std::find(others.begin(), others.end(), mixing.members[at]);
        if (found == others.end()) continue;
        const auto column = static_cast<std::size_t>(found - others.begin()) * rank_;
        for (std::size_t r = 0; r < rank_; ++r) {
          M[s * rows.size() + column + r] =
              -static_cast<float>(mixing.coefficients[at * rank_ + r]);
        }
      }
    }
    // memory that was used before is faster than new
    if (residual_.size() < list.size() * row_) {
      residual_ = FloatStore();
      residual_ = FloatStore(list.size() * row_, place_);
    }
    combine_rows(device_, row_, mine, M, rows, residual_.data());
    count_sums(job_.stage(update_stage), list.size(), list.size(), rows.size(), row_);
    residual_.release();
    B_.release();
    return row_list(std::span<const float>(residual_), list.size(), row_);
  }

  // U'_m,c of section 4.2.3: the left singular vectors of a mixing matrix's rows.
  std::vector<float> orthonormal_rows(const std::vector<std::size_t>& list,
                                      const Sizes& places) const {
    std::vector<double> rows;
    for (std::size_t s = 0; s < list.size(); ++s) {
      const auto first =
          state_.mixing.coefficients.begin() +
          static_cast<std::ptrdiff_t>((list[s] * state_.mixtures + places[s]) * rank_);
      rows.insert(rows.end(), first, first + static_cast<std::ptrdiff_t>(rank_));
    }
    const std::vector<double> U = reference::thin_svd(list.size(), rank_, rows).U;
    return {U.begin(), U.end()};
  }

  // The rows of a mixing matrix in their places, and errors of slices whose last cluster it is.
  void set_rows(std::size_t c, const std::vector<std::size_t>& list, const Sizes& places,
                const RowList& residual, std::span<const float> U_m) {
    KctaMixing& mixing = state_.mixing;
    const std::size_t K = state_.mixtures;
    const std::size_t rank = U_m.size() / list.size();
    std::vector<std::size_t> last;
    std::vector<float> M;
    for (std::size_t s = 0; s < list.size(); ++s) {
      const std::size_t at = (list[s] * K + places[s]) * rank_;
      for (std::size_t r = 0; r < rank_; ++r) {
        mixing.coefficients[at + r] = r < rank ? double{U_m[s * rank + r]} : 0.0;
      }
      if (places[s] + 1 < K) continue;
      last.push_back(s);
      for (std::size_t r = 0; r < rank_; ++r) {
        M.push_back(-static_cast<float>(mixing.coefficients[at + r]));
      }
    }
    if (last.empty()) return;
    const std::vector<double> errors =
        combined_squares(device_, row_, picked(residual, last), M, rows_of(c));
    count_sums(job_.stage(update_stage), last.size(), 0, rank_, row_);
    for (std::size_t s = 0; s < last.size(); ++s) mixing.errors[list[last[s]]] = errors[s];
  }

  // Clusters and coefficients for what is interpolated between the slices (section 6.3.2).
  void resample(KctaModel& model) {
    const StageTimer timer(job_, "resample views");
    const RowList rows = row_list(B_, request_.clusters * rank_, row_);
    const std::vector<double> gram = row_products(device_, row_, rows, rows);
    const std::vector<double> products = row_products(device_, row_, slices_, rows);
    const ViewResampling views(source_.info().view_directions, request_.grid_side);
    set_grid(model, request_.grid_side,
             mix_between(views, request_.clusters, request_.mixtures, products, gram));
    count_products(job_.stage("resample views"), shape_.slices() + rows.size(), rows.size(), row_);
  }

  void make_model() {
    fit_.model = std::make_unique<KctaModel>();
    KctaModel& model = *fit_.model;
    model.set_groups(request_.groups, request_.mode);
    model.clusters = request_.clusters;
    model.ranks = request_.ranks;
    model.global = global_;
    const float inverse = 1 / scale_;
    for (const ClusterBases& cluster : state_.clusters) {
      for (const float value : cluster.Z) {
        // in two steps where the scale's inverse is no normal float
        model.cores.push_back(std::isnormal(inverse)
                                  ? value * inverse
                                  : static_cast<float>(double{value} / double{scale_}));
      }
      for (std::size_t a = 1; a < shape_.sizes.size(); ++a) {
        std::vector<float>& local = model.local[shape_.groups[a]];
        local.insert(local.end(), cluster.U[a].begin(), cluster.U[a].end());
      }
    }
    const std::vector<double>& u = state_.mixing.coefficients;
    set_mixing(model, request_.mixtures, state_.mixtures, state_.mixing.members,
               std::vector<float>(u.begin(), u.end()));
    if (request_.grid_side > 0) resample(model);
    const double unit = 1 / (double{scale_} * double{scale_});
    for (double& error : fit_.errors.history) error *= unit;
  }

  Device& device_;
  TileSource& source_;
  KctaRequest request_;
  Job& job_;
  SliceShape shape_;
  std::size_t row_;   // values of a slice
  std::size_t rank_;  // R_m
  ClusterDecomposition decomposition_;
  std::vector<std::vector<float>> global_;
  double squares_of_all_ = 0;  // |D|^2
  double lost_ = 0;            // by global bases
  float scale_ = 1;
  FloatStore A_, B_;
  FloatStore::Place place_ = FloatStore::Place::memory;
  RowList slices_;
  FloatStore residual_;          // R'_c of the cluster that is updated
  std::vector<double> squares_;  // of slices
  State state_;
  KctaFit fit_;
};

}  // namespace

KctaFit fit_kcta(Device& device, TileSource& source, const KctaRequest& request, Job& job) {
  return Fitter(device, source, request, job).fit();
}

std::unique_ptr<KctaEncoder> kcta_encoder(Device& device, TileSource& source,
                                          const KctaRequest& request, Job& job) {
  return std::make_unique<Fitter>(device, source, request, job);
}

}  // namespace weft
