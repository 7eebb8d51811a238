#include "weft/reference/kcta.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "weft/error.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/kcta_mixing.hpp"
#include "weft/reference/mode_product.hpp"
#include "weft/reference/tile.hpp"
#include "weft/reference/tucker.hpp"
#include "weft/tensor/permute.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft::reference {
namespace {

using Sizes = std::vector<std::size_t>;
using Values = std::vector<double>;

double squares_of(std::span<const double> values) {
  return std::inner_product(values.begin(), values.end(), values.begin(), 0.0);
}

// The leading `rank` columns of eigenvectors, [n][rank].
Values leading(std::size_t n, std::span<const double> gram, std::size_t rank) {
  const SymmetricEigen eigen = symmetric_eigen(n, gram);
  Values U(n * rank);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < rank; ++j) U[i * rank + j] = eigen.vectors[i * n + j];
  }
  return U;
}

// The N-mode SVD of the slices of a cluster (section 4.3), from the mixing matrix and bases that it
// has, or from none.
struct Decomposition {
  Sizes sizes;         // of the slices, [members][I_n ...]
  const Sizes& ranks;  // [R_m][R_n ...]
  const Values& slices;
  std::vector<Values> U;  // of the modes behind the first
  Values U_m;             // [members][rank]
  std::size_t rank;       // R_m, or the members if they are fewer
  Values Z;               // [rank][R_n ...]

  Decomposition(Sizes tensor_sizes, const Sizes& core_ranks, const Values& values)
      : sizes(std::move(tensor_sizes)),
        ranks(core_ranks),
        slices(values),
        U(sizes.size() - 1),
        rank(std::min(core_ranks[0], sizes[0])) {}

  bool cuts(std::size_t n) const { return ranks[n] < sizes[n]; }

  // mode by mode, of the tensor as projected so far
  void begin() {
    U_m = leading(sizes[0], mode_gram(sizes, 0, slices), rank);
    Sizes left = sizes;
    Values T = mode_product(left, 0, slices, rank, transposed(sizes[0], rank, U_m));
    left[0] = rank;
    for (std::size_t n = 1; n < sizes.size(); ++n) {
      if (!cuts(n)) continue;
      U[n - 1] = leading(left[n], mode_gram(left, n, T), ranks[n]);
      T = mode_product(left, n, T, ranks[n], transposed(left[n], ranks[n], U[n - 1]));
      left[n] = ranks[n];
    }
  }

  // alternating least squares: each basis of the tensor projected onto all others
  void sweep() {
    Sizes of_rank = sizes;
    of_rank[0] = rank;
    const Values W = mode_product(sizes, 0, slices, rank, transposed(sizes[0], rank, U_m));
    for (std::size_t n = 1; n < sizes.size(); ++n) {
      if (!cuts(n)) continue;
      Sizes left = of_rank;
      const Values T = projected(left, W, U, n);
      U[n - 1] = leading(left[n], mode_gram(left, n, T), ranks[n]);
    }
    Sizes left = sizes;
    const Values P = projected(left, slices, U);
    U_m = leading(sizes[0], mode_gram(left, 0, P), rank);
    Z = mode_product(left, 0, P, rank, transposed(sizes[0], rank, U_m));
  }
};

// All values of a source, in the order of the groups.
Values read_tensor(TileSource& source, const ModeGroups& groups, Job& job) {
  const BtfShape& shape = source.info().shape;
  const StageTimer timer(job, "read", 0, static_cast<double>(source.info().bytes()));
  Values D(shape.values());
  for (std::size_t i = 0; i < shape.images(); ++i) {
    check_interrupt();
    read_tile(source, i, 1, job.nan_zero,
              std::span(D).subspan(i * shape.image_values(), shape.image_values()));
  }
  if (!groups.channels_first()) return D;
  const Sizes stored{shape.images(), shape.texels(), shape.channels};
  return permuted<double>(D, stored, Sizes{0, 2, 1});
}

// Clusters, and the slices in them.
struct State {
  std::vector<KctaCluster> clusters;
  std::size_t mixtures = 1;
  KctaMixing mixing;

  double error() const { return std::accumulate(mixing.errors.begin(), mixing.errors.end(), 0.0); }
  double core_norms() const {
    double sum = 0;
    for (const KctaCluster& cluster : clusters) sum += std::sqrt(squares_of(cluster.Z));
    return sum;
  }
};

class Encoder final : public KctaEncoder {
 public:
  Encoder(TileSource& source, const KctaRequest& request, Job& job)
      : request_(request), job_(job), info_(source.info()) {
    MemoryPlan plan;
    plan.add("tensor", 6 * info_.shape.values() * sizeof(double));
    job.plan(plan);
    D_ = read_tensor(source, request.groups, job);
    const StageTimer timer(job, "factorise");
    sizes_ = request.groups.sizes();
    fit_errors_.squares = squares_of(D_);
    project_global();
    put_first();
  }

  // Of a fit with ranks that are no smaller, projected onto the global bases of a model that was
  // cut of it, from its clusters on.
  Encoder(const Encoder& whole, const KctaRequest& request, const KctaModel& start)
      : request_(request),
        job_(whole.job_),
        info_(whole.info_),
        D_(whole.D_),
        sizes_(whole.sizes_),
        axes_(whole.axes_),
        global_(whole.global_.size()) {
    fit_errors_ = whole.fit_errors_;
    for (std::size_t a = 1; a < axes_.size(); ++a) {
      const std::size_t n = axes_[a];
      if (!request_.cuts(n) || request_.global_mode[n] == 0) continue;
      const std::size_t rank = request_.ranks[n];
      const std::size_t size = request_.groups.groups()[n].size;
      global_[n].assign(start.global[n].begin(), start.global[n].end());
      Values onto = transposed(size, rank, global_[n]);
      if (!whole.global_[n].empty()) {
        // U'^T U of the basis U that A_G is given in
        onto = mode_product(Sizes{rank, size}, 1, onto, sizes_[a],
                            transposed(size, sizes_[a], whole.global_[n]));
      }
      D_ = mode_product(sizes_, a, D_, rank, onto);
      sizes_[a] = rank;
    }
    fit_errors_.lost = std::max(0.0, fit_errors_.squares - squares_of(D_));
    set_ranks();
    start_from(start);
  }

  KctaFit fit() override {
    const StageTimer timer(job_, "factorise");
    start();
    // a pass of hard clustering before those of soft clustering (section 5.1)
    if (request_.mixtures > 1) iterate(1);
    return iterated(request_.iterations);
  }

  KctaFit refit(const KctaModel& start, std::size_t iterations) override {
    const StageTimer timer(job_, "factorise");
    KctaRequest request = request_;
    request.ranks = start.ranks;
    return Encoder(*this, request, start).iterated(iterations);
  }

 private:
  KctaFit iterated(std::size_t iterations) {
    KctaFit fit;
    for (std::size_t i = 0; i < iterations; ++i) {
      const double before = state_.core_norms();
      const bool better = iterate(request_.mixtures);
      job_.advance("iteration", i + 1, iterations);
      fit_errors_.restored = !better;
      const double norms = state_.core_norms();
      if (!better || std::abs(norms - before) <= request_.least_change * norms) break;
    }
    fit.model = made_model();
    fit.errors = fit_errors_;
    return fit;
  }

  // A_G, eq. (23)
  void project_global() {
    global_.resize(sizes_.size());
    Sizes modes;
    for (std::size_t n = 0; n < sizes_.size(); ++n) {
      if (request_.cuts(n) && request_.global_mode[n] != 0) modes.push_back(n);
    }
    for (const std::size_t n : cheapest_cuts(sizes_, request_.ranks, modes)) {
      const std::size_t rank = request_.ranks[n];
      global_[n] = leading(sizes_[n], mode_gram(sizes_, n, D_), rank);
      D_ = mode_product(sizes_, n, D_, rank, transposed(sizes_[n], rank, global_[n]));
      sizes_[n] = rank;
    }
    fit_errors_.lost = std::max(0.0, fit_errors_.squares - squares_of(D_));
  }

  // The clustered mode before the others.
  void put_first() {
    axes_ = {request_.mode};
    for (std::size_t n = 0; n < sizes_.size(); ++n) {
      if (n != request_.mode) axes_.push_back(n);
    }
    D_ = permuted<double>(D_, sizes_, axes_);
    Sizes turned;
    for (const std::size_t n : axes_) turned.push_back(sizes_[n]);
    sizes_ = turned;
    set_ranks();
  }

  void set_ranks() {
    ranks_ = sizes_;
    ranks_[0] = request_.ranks[request_.mode];
    for (std::size_t a = 1; a < axes_.size(); ++a) {
      if (request_.cuts(axes_[a])) ranks_[a] = request_.ranks[axes_[a]];
    }
    row_ = D_.size() / sizes_[0];
  }

  // Clusters as a model has them; what they leave is not known.
  void start_from(const KctaModel& start) {
    const std::size_t core = start.cores.size() / start.clusters;
    state_.mixtures = start.mixtures;
    for (std::size_t i = 0; i < start.members.size(); ++i) {
      state_.mixing.members.push_back(static_cast<std::uint32_t>(start.members[i]));
    }
    state_.mixing.coefficients.assign(start.mixing.begin(), start.mixing.end());
    state_.mixing.errors.assign(sizes_[0], std::numeric_limits<double>::infinity());
    for (std::size_t c = 0; c < request_.clusters; ++c) {
      KctaCluster cluster;
      cluster.sizes = ranks_;
      const auto first = start.cores.begin() + static_cast<std::ptrdiff_t>(c * core);
      cluster.Z.assign(first, first + static_cast<std::ptrdiff_t>(core));
      for (std::size_t a = 1; a < axes_.size(); ++a) {
        const std::size_t n = axes_[a];
        const std::span<const float> U =
            start.local[n].empty() ? std::span<const float>() : start.factor(n, c);
        cluster.U.emplace_back(U.begin(), U.end());
      }
      state_.clusters.push_back(std::move(cluster));
    }
  }

  std::span<const double> slice(std::size_t i) const {
    return std::span<const double>(D_).subspan(i * row_, row_);
  }

  void start() {
    const std::size_t slices = sizes_[0];
    std::vector<std::uint32_t>& members = state_.mixing.members;
    if (request_.start == KctaStart::directions) {
      members = cluster_points(slice_parameters(info_, request_.groups, request_.mode),
                               request_.clusters);
    } else if (request_.start == KctaStart::slices) {
      members = cluster_points(
          leading_subspace(slices, mode_gram(sizes_, 0, D_), request_.clusters * ranks_[0]),
          request_.clusters, job_.seed);
    } else {
      members = deal_slices(slices, request_.clusters, job_.seed);
    }
    state_.clusters.resize(request_.clusters);
    state_.mixing.coefficients.assign(slices * ranks_[0], 0.0);
    state_.mixing.errors.assign(slices, 0.0);
    update(std::vector<bool>(request_.clusters, true));
    fit_errors_.history.push_back(state_.error());
  }

  // Both stages; false where the error grew, and what was before is restored.
  bool iterate(std::size_t mixtures) {
    check_interrupt();
    const State before = state_;
    state_.mixtures = mixtures;
    state_.mixing = mix_slices(sizes_, D_, state_.clusters, mixtures);
    std::vector<bool> fresh(request_.clusters, false);
    for (const SliceMove& move : fill_empty_clusters(request_.clusters, mixtures,
                                                     state_.mixing.members, state_.mixing.errors)) {
      fresh[move.to] = true;
      refit(move.slice, fresh);
    }
    update(fresh);
    const bool better = state_.error() <= before.error();
    if (!better) state_ = before;
    fit_errors_.history.push_back(state_.error());
    return better;
  }

  // Coefficients of a slice for those of its clusters that have a core, its clusters put in order.
  void refit(std::size_t i, const std::vector<bool>& fresh) {
    const std::size_t R = ranks_[0];
    const auto members =
        std::span(state_.mixing.members).subspan(i * state_.mixtures, state_.mixtures);
    std::sort(members.begin(), members.end());
    Values B;
    for (const std::uint32_t c : members) {
      if (fresh[c]) continue;
      const Values rows = state_.clusters[c].rows();
      B.insert(B.end(), rows.begin(), rows.end());
    }
    const std::size_t count = B.size() / row_;
    const Values u = solve_mixing(count, row_products(row_, B, B), row_products(row_, slice(i), B));
    double* to = state_.mixing.coefficients.data() + i * state_.mixtures * R;
    std::size_t from = 0;
    for (const std::uint32_t c : members) {
      for (std::size_t r = 0; r < R; ++r) *to++ = fresh[c] ? 0.0 : u[from++];
    }
  }

  // The update stage, (20)-(22); `fresh` clusters have no bases yet.
  void update(const std::vector<bool>& fresh) {
    const std::size_t R = ranks_[0];
    const std::size_t K = state_.mixtures;
    KctaMixing& mixing = state_.mixing;
    const auto lists = slices_of_clusters(request_.clusters, K, mixing.members);
    std::vector<Values> rows(request_.clusters);
    for (std::size_t c = 0; c < request_.clusters; ++c) {
      if (!fresh[c]) rows[c] = state_.clusters[c].rows();
    }
    const auto coefficients = [&](std::size_t i, std::size_t k) {
      return std::span(mixing.coefficients).subspan((i * K + k) * R, R);
    };
    const auto place = [&](std::size_t i, std::size_t c) {
      const auto first = mixing.members.begin() + static_cast<std::ptrdiff_t>(i * K);
      return static_cast<std::size_t>(std::find(first, first + static_cast<std::ptrdiff_t>(K), c) -
                                      first);
    };
    for (std::size_t c = 0; c < request_.clusters; ++c) {
      // R'_c, and the rows of the mixing matrix
      Values residual;
      Values mine;
      for (const std::size_t i : lists[c]) {
        Values left(slice(i).begin(), slice(i).end());
        for (std::size_t k = 0; k < K; ++k) {
          const std::uint32_t j = mixing.members[i * K + k];
          if (j == c || rows[j].empty()) continue;
          const Values made = matrix_product(R, coefficients(i, k), rows[j]);
          for (std::size_t p = 0; p < row_; ++p) left[p] -= made[p];
        }
        residual.insert(residual.end(), left.begin(), left.end());
        const auto u = coefficients(i, place(i, c));
        mine.insert(mine.end(), u.begin(), u.end());
      }
      Sizes sizes = sizes_;
      sizes[0] = lists[c].size();
      Decomposition svd(sizes, ranks_, residual);
      if (fresh[c]) {
        svd.begin();
      } else {
        svd.U_m = thin_svd(sizes[0], R, mine).U;  // section 4.2.3
        svd.U = state_.clusters[c].U;
      }
      for (std::size_t s = 0; s < (fresh[c] ? cold_sweeps : warm_sweeps); ++s) svd.sweep();

      KctaCluster& cluster = state_.clusters[c];
      cluster.sizes = ranks_;
      cluster.U = svd.U;
      cluster.Z = svd.Z;
      cluster.Z.resize(product(ranks_), 0.0);  // fewer slices than ranks
      rows[c] = cluster.rows();
      for (std::size_t s = 0; s < lists[c].size(); ++s) {
        const std::size_t i = lists[c][s];
        const std::size_t k = place(i, c);
        const auto u = coefficients(i, k);
        std::fill(u.begin(), u.end(), 0.0);
        std::copy_n(svd.U_m.begin() + static_cast<std::ptrdiff_t>(s * svd.rank), svd.rank,
                    u.begin());
        if (k + 1 < K) continue;  // a later cluster of the slice is still to come
        const Values made = matrix_product(R, u, rows[c]);
        mixing.errors[i] = 0;
        for (std::size_t p = 0; p < row_; ++p) {
          const double difference = residual[s * row_ + p] - made[p];
          mixing.errors[i] += difference * difference;
        }
      }
    }
  }

  std::unique_ptr<KctaModel> made_model() const {
    auto made = std::make_unique<KctaModel>();
    KctaModel& model = *made;
    model.set_groups(request_.groups, request_.mode);
    model.clusters = request_.clusters;
    model.ranks = request_.ranks;
    for (std::size_t n = 0; n < global_.size(); ++n) {
      model.global[n].assign(global_[n].begin(), global_[n].end());
    }
    for (const KctaCluster& cluster : state_.clusters) {
      model.cores.insert(model.cores.end(), cluster.Z.begin(), cluster.Z.end());
      for (std::size_t a = 1; a < sizes_.size(); ++a) {
        const std::size_t n = a <= request_.mode ? a - 1 : a;
        model.local[n].insert(model.local[n].end(), cluster.U[a - 1].begin(),
                              cluster.U[a - 1].end());
      }
    }
    set_mixing(
        model, request_.mixtures, state_.mixtures, state_.mixing.members,
        std::vector<float>(state_.mixing.coefficients.begin(), state_.mixing.coefficients.end()));
    if (request_.grid_side > 0) {
      const ViewResampling views(info_.view_directions, request_.grid_side);
      set_grid(model, request_.grid_side,
               mix_between(views, sizes_, D_, state_.clusters, request_.mixtures));
    }
    return made;
  }

  KctaRequest request_;
  Job& job_;
  BtfInfo info_;
  Values D_;     // the tensor, then A_G with the clustered mode first
  Sizes sizes_;  // its sizes, and those of cores
  Sizes axes_;   // the groups of its modes
  Sizes ranks_;
  std::size_t row_ = 1;  // values of a slice
  std::vector<Values> global_;
  State state_;
  KctaErrors fit_errors_;
};

}  // namespace

std::vector<std::vector<double>> mode_spectra(TileSource& source, const ModeGroups& groups,
                                              std::span<const std::size_t> modes, Job& job) {
  const Values D = read_tensor(source, groups, job);
  const Sizes sizes = groups.sizes();
  std::vector<Values> spectra(sizes.size());
  for (const std::size_t n : modes) {
    spectra[n] = symmetric_eigen(sizes[n], mode_gram(sizes, n, D)).values;
  }
  return spectra;
}

KctaFit encode_kcta(TileSource& source, const KctaRequest& request, Job& job) {
  return Encoder(source, request, job).fit();
}

std::unique_ptr<KctaEncoder> kcta_encoder(TileSource& source, const KctaRequest& request,
                                          Job& job) {
  return std::make_unique<Encoder>(source, request, job);
}

void decode_kcta(const KctaModel& model, std::size_t first, std::size_t count,
                 std::span<double> out) {
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t image = shape.image_values();
  std::fill_n(out.begin(), count * image, 0.0);
  // whether an image has anything of a cluster: only of modes of directions that is to be known
  const ModeGroup& group = model.groups.groups()[model.mode];
  const auto has = [&](const TuckerModel& cluster, std::size_t i) {
    if (!group.of_directions()) return true;
    const std::size_t channels = group.has(Mode::channel) ? shape.channels : 1;
    const std::size_t view = group.has(Mode::view) ? i / shape.lights : 0;
    const std::size_t light = group.has(Mode::light) ? i % shape.lights : 0;
    std::size_t row = 0;
    if (group.has(Mode::view)) row += view * model.groups.stride(Mode::view);
    if (group.has(Mode::light)) row += light * model.groups.stride(Mode::light);
    const std::size_t rank = model.ranks[model.mode];
    const auto rows = std::span(cluster.factors[model.mode]).subspan(row * rank, channels * rank);
    return std::any_of(rows.begin(), rows.end(), [](float u) { return u != 0; });
  };
  for (std::size_t c = 0; c < model.clusters; ++c) {
    const std::unique_ptr<TuckerModel> cluster = model.cluster(c);
    for (std::size_t i = first; i < first + count;) {
      std::size_t end = i;
      while (end < first + count && has(*cluster, end)) ++end;
      if (end == i) {
        ++i;
        continue;
      }
      Values part((end - i) * image);
      decode_tucker(*cluster, i, end - i, part);
      for (std::size_t p = 0; p < part.size(); ++p) out[(i - first) * image + p] += part[p];
      i = end;
    }
  }
}

}  // namespace weft::reference

namespace weft {

std::size_t grid_bytes(const KctaRequest& request) {
  const std::size_t views = request.groups.groups()[request.mode].size;
  const std::size_t row =
      request.mixtures *
      (sizeof(std::uint32_t) + request.ranks[request.mode] * (sizeof(double) + sizeof(float)));
  // the splines' system, its eigenvectors and inverse
  return request.grid_side * request.grid_side * row +
         4 * (views + 4) * (views + 4) * sizeof(double);
}

}  // namespace weft
