#include "weft/codecs/fit_sparse.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "weft/codecs/ksvd.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/codecs/sparse_decoder.hpp"
#include "weft/codecs/truncated_svd.hpp"
#include "weft/error.hpp"
#include "weft/model/sparse_lengths.hpp"
#include "weft/ops/matrix_product.hpp"

namespace weft {
namespace {

// Bytes of the basis that are on the device at a time.
constexpr std::size_t basis_bytes = std::size_t{64} << 20;

// One plan for a job and the jobs within it, which count what is held meanwhile.
class WithinPlan {
 public:
  explicit WithinPlan(Job& job)
      : job_(job), on_plan_(std::exchange(job.on_plan, {})), held_(job.held.size()) {}
  ~WithinPlan() {
    job_.on_plan = std::move(on_plan_);
    job_.held.resize(held_);
  }
  WithinPlan(const WithinPlan&) = delete;
  WithinPlan& operator=(const WithinPlan&) = delete;

 private:
  Job& job_;
  std::function<void(const MemoryPlan&)> on_plan_;
  std::size_t held_;
};

SvdOptions svd_options(const SparseOptions& options) {
  SvdOptions svd;
  svd.rank = options.rank;
  return svd;
}

KsvdOptions ksvd_options(const SparseOptions& options, std::size_t atoms, std::size_t terms,
                         std::uint64_t seed) {
  KsvdOptions ksvd;
  ksvd.atoms = atoms;
  ksvd.sparsity = std::min(terms, atoms);
  ksvd.iterations = options.iterations;
  ksvd.update = options.update;
  ksvd.seed = seed;
  return ksvd;
}

CodeLists code_lists(const KsvdFit<float>& fit, std::size_t length) {
  return {length, fit.indices, {fit.coefficients.begin(), fit.coefficients.end()}};
}

class DeviceEncoder final : public SparseEncoder {
 public:
  DeviceEncoder(Device& device, TileSource& source, const SparseOptions& options, Job& job)
      : device_(device),
        source_(source),
        options_(options),
        job_(job),
        within_(job),
        held_(job.held.size()),
        shape_(source.info().shape),
        sizes_(shape_, options) {}

  // Mean, Y = U Sigma and W.
  void project(std::size_t rank) override {
    // nothing of a projection of lower rank is held meanwhile
    job_.held.resize(held_);
    for (std::vector<float>* values : {&Y_, &W_, &B_}) *values = std::vector<float>();
    texels_ = KsvdFit<float>();
    views_ = KsvdFit<float>();
    options_.rank = rank;
    sizes_ = SparseSizes(shape_, options_);
    job_.plan(plan_sparse(device_, source_, options_, job_));
    TruncatedSvd svd = truncated_svd(device_, source_, svd_options(options_), job_);
    job_.notes.push_back(fmt::format("projection: svd {}, {} passes over the data, rank {}: {}",
                                     name_of(svd.method), svd.passes, svd.rank, svd.reason));
    mean_ = std::move(svd.mean);
    rank_ = svd.rank;
    std::vector<double> sigma(rank_, 0.0);
    for (std::size_t r = 0; r < sizes_.row; ++r) {
      for (std::size_t j = 0; j < rank_; ++j) {
        sigma[j] += std::pow(double{svd.right[r * rank_ + j]}, 2);
      }
    }
    double largest = 0;
    for (double& value : sigma) {
      value = std::sqrt(value);
      largest = std::max(largest, value);
    }
    int exponent = 0;
    std::frexp(largest, &exponent);
    unit_ = std::ldexp(1.0, exponent);
    squares_ = svd.squares / (unit_ * unit_);
    projection_ = std::pow(svd.residual / unit_, 2);
    Y_ = std::move(svd.left);
    for (std::size_t p = 0; p < sizes_.texels; ++p) {
      for (std::size_t j = 0; j < rank_; ++j) {
        Y_[p * rank_ + j] = static_cast<float>(double{Y_[p * rank_ + j]} * sigma[j] / unit_);
      }
    }
    W_ = std::move(svd.right);
    for (std::size_t r = 0; r < sizes_.row; ++r) {
      for (std::size_t j = 0; j < rank_; ++j) {
        const double value = double{W_[r * rank_ + j]};
        W_[r * rank_ + j] = static_cast<float>(sigma[j] > 0 ? value / sigma[j] : 0.0);
      }
    }
    job_.held.push_back({"projected texels", Y_.size() * sizeof(float)});
    job_.held.push_back({"basis of the projection", W_.size() * sizeof(float)});
    job_.held.push_back({"ABRDFs", sizes_.abrdf_atoms * sizes_.row * sizeof(float)});
  }

  std::size_t rank() const override { return rank_; }
  double projection_error() const override { return part(projection_); }

  SparseFit fit(std::size_t view_terms, std::size_t texel_terms, std::size_t iterations) override {
    texel_start_.clear();
    view_start_.clear();
    SparseFit fit = refit(view_terms, texel_terms, iterations);
    texel_start_ = texels_.dictionary;
    view_start_ = views_.dictionary;
    return fit;
  }

  SparseFit refit(std::size_t view_terms, std::size_t texel_terms,
                  std::size_t iterations) override {
    if (rank_ > 0) decompose(view_terms, texel_terms, iterations);
    return {model(), rank_, {projection_error(), part(texels_.objective), part(views_.objective)}};
  }

  SparseLengthErrors length_errors() override {
    SparseLengthErrors errors{truncation_errors(sizes_.fibre, B_, views_.dictionary, V_),
                              truncation_errors(rank_, Y_, used_atoms(), P_)};
    for (std::vector<double>* kind : {&errors.views, &errors.texels}) {
      for (double& error : *kind) error /= squares_;
    }
    return errors;
  }

 private:
  // The root of a squared error, as a part of |T|.
  double part(double square) const { return squares_ > 0 ? std::sqrt(square / squares_) : 0; }

  // Signals by a dictionary, from `start` where it is one of as many atoms, else from samples.
  KsvdFit<float> fit_dictionary(std::size_t dimension, const std::vector<float>& signals,
                                KsvdOptions options, std::size_t iterations,
                                const std::vector<float>& start, const char* name) {
    options.iterations = iterations;
    const bool given = start.size() == options.atoms * dimension;
    options.start = given ? KsvdStart::given : KsvdStart::samples;
    return ksvd(device_, KsvdSignals::of(dimension, signals), options,
                given ? std::span<const float>(start) : std::span<const float>(), job_, name);
  }

  // Both K-SVDs.
  void decompose(std::size_t view_terms, std::size_t texel_terms, std::size_t iterations) {
    KsvdOptions options = ksvd_options(options_, sizes_.abrdf_atoms, texel_terms, job_.seed);
    texels_ = fit_dictionary(rank_, Y_, options, iterations, texel_start_, "texels");
    P_ = code_lists(texels_, options.sparsity);
    weights_ = atom_weights(P_, sizes_.abrdf_atoms);
    kept_ = drop_unused(P_, weights_);
    combine_abrdfs();

    const std::size_t fibres = kept_.size() * shape_.views;
    const std::size_t atoms = std::min(options_.light_atoms, fibres);
    options = ksvd_options(options_, atoms, view_terms, job_.seed + 1);
    views_ = fit_dictionary(sizes_.fibre, B_, options, iterations, view_start_, "views");
    V_ = code_lists(views_, options.sparsity);
  }

  // B = diag(|P_j|) D W^T, in blocks of W's rows.
  void combine_abrdfs() {
    const std::size_t atoms = kept_.size();
    const StageTimer timer(
        job_, "back-projection",
        2.0 * static_cast<double>(atoms * sizes_.row) * static_cast<double>(rank_));
    std::vector<float> D(atoms * rank_);
    for (std::size_t a = 0; a < atoms; ++a) {
      for (std::size_t j = 0; j < rank_; ++j) {
        D[a * rank_ + j] =
            static_cast<float>(weights_[a] * double{texels_.dictionary[kept_[a] * rank_ + j]});
      }
    }
    B_.resize(atoms * sizes_.row);
    const std::size_t run =
        std::clamp<std::size_t>(basis_bytes / (rank_ * sizeof(float)), 1, sizes_.row);
    Buffer atoms_buffer(device_, D.size() * sizeof(float), "atoms of texels");
    Buffer basis(device_, run * rank_ * sizeof(float), "basis of the projection");
    Buffer product(device_, atoms * run * sizeof(float), "ABRDFs");
    device_.write(atoms_buffer, std::span<const float>(D));
    std::vector<float> rows(atoms * run);
    for (std::size_t first = 0; first < sizes_.row; first += run) {
      check_interrupt();
      const std::size_t count = std::min(run, sizes_.row - first);
      device_.write(basis, std::span<const float>(W_).subspan(first * rank_, count * rank_));
      ops::gemm(device_, ops::Transpose::no, ops::Transpose::yes, atoms, count, rank_, 1.0,
                {atoms_buffer, rank_}, {basis, rank_}, 0.0, {product, count});
      device_.read(product, std::span<float>(rows).first(atoms * count));
      for (std::size_t a = 0; a < atoms; ++a) {
        std::copy_n(rows.data() + a * count, count, B_.data() + a * sizes_.row + first);
      }
    }
  }

  // The model of the last decomposition.
  std::unique_ptr<SparseModel> model() const {
    auto model = std::make_unique<SparseModel>();
    model->mean = mean_;
    if (rank_ > 0) {
      // an ABRDF's fibres have its weight
      CodeLists V = V_;
      const std::size_t terms = shape_.views * V.length;
      for (std::size_t i = 0; i < V.coefficients.size(); ++i) {
        V.coefficients[i] /= weights_[i / terms];
      }
      std::vector<double> uses = atom_weights(V, views_.dictionary.size() / sizes_.fibre);
      const std::vector<std::uint32_t> atoms = drop_unused(V, uses);
      for (const std::uint32_t atom : atoms) {
        for (std::size_t i = 0; i < sizes_.fibre; ++i) {
          model->dictionary.push_back(
              static_cast<float>(double{views_.dictionary[atom * sizes_.fibre + i]} * unit_));
        }
      }
      model->light_atoms = atoms.size();
      model->abrdf_atoms = kept_.size();
      model->views = sparse_lists(V, model->light_atoms);
      model->texels = sparse_lists(P_, model->abrdf_atoms);
    }
    return model;
  }

  // Atoms of the texels' space that codes use.
  std::vector<float> used_atoms() const {
    std::vector<float> atoms;
    for (const std::uint32_t atom : kept_) {
      const auto row = texels_.dictionary.begin() + static_cast<std::ptrdiff_t>(atom * rank_);
      atoms.insert(atoms.end(), row, row + static_cast<std::ptrdiff_t>(rank_));
    }
    return atoms;
  }

  Device& device_;
  TileSource& source_;
  SparseOptions options_;
  Job& job_;
  WithinPlan within_;
  std::size_t held_;  // items of the job's caller
  BtfShape shape_;
  SparseSizes sizes_;

  // Everything is in units of `unit_`.
  double unit_ = 1;
  double squares_ = 1;     // |T|^2
  double projection_ = 0;  // |A - U Sigma W^T|^2
  std::size_t rank_ = 0;
  std::vector<float> mean_;  // [n], in the data's own unit
  std::vector<float> Y_;     // U Sigma [P][rank]
  std::vector<float> W_;     // [n][rank]
  KsvdFit<float> texels_;
  CodeLists P_;                      // of the atoms that are used
  std::vector<double> weights_;      // [atoms used]
  std::vector<std::uint32_t> kept_;  // [atoms used], their numbers in texels_
  std::vector<float> B_;             // [atoms used][n]
  KsvdFit<float> views_;
  CodeLists V_;
  // dictionaries of the last fit
  std::vector<float> texel_start_;
  std::vector<float> view_start_;
};

}  // namespace

MemoryPlan plan_sparse(Device& device, TileSource& source, const SparseOptions& options,
                       const Job& job) {
  const BtfShape& shape = source.info().shape;
  const SparseSizes sizes(shape, options);
  const auto held = [&](MemoryPlan plan) {
    plan.add("projected texels", sizes.texels * sizes.rank * sizeof(float));
    plan.add("basis of the projection", sizes.row * sizes.rank * sizeof(float));
    plan.add("ABRDFs", sizes.abrdf_atoms * sizes.row * sizeof(float));
    plan.add("dictionary of texels", sizes.abrdf_atoms * sizes.rank * sizeof(float));
    return plan;
  };
  const std::size_t codes = 2 * (sizeof(std::uint32_t) + sizeof(double));
  const std::size_t fibres = sizes.abrdf_atoms * shape.views;
  MemoryPlan texels =
      held(ksvd_plan(device, sizes.texels, sizes.rank,
                     ksvd_options(options, sizes.abrdf_atoms, options.texel_terms, job.seed)));
  MemoryPlan back;
  const std::size_t run = std::min(sizes.row, basis_bytes / (sizes.rank * sizeof(float)) + 1);
  back.add("block of the basis", run * (sizes.rank + 2 * sizes.abrdf_atoms) * sizeof(float));
  back.add("atoms of texels", 2 * sizes.abrdf_atoms * sizes.rank * sizeof(float));
  back.add("product", ops::product_bytes(device, run, sizes.rank));
  back = held(back);
  MemoryPlan views =
      held(ksvd_plan(device, fibres, sizes.fibre,
                     ksvd_options(options, sizes.light_atoms, options.view_terms, job.seed)));
  for (MemoryPlan* plan : {&texels, &back, &views}) {
    plan->add("lists", (sizes.texels * options.texel_terms + fibres * options.view_terms) * codes);
  }
  const auto less = [](const MemoryPlan& a, const MemoryPlan& b) { return a.total() < b.total(); };
  return std::max(
      {plan_truncated_svd(device, source, svd_options(options), job), texels, back, views}, less);
}

std::unique_ptr<SparseEncoder> sparse_encoder(Device& device, TileSource& source,
                                              const SparseOptions& options, Job& job) {
  return std::make_unique<DeviceEncoder>(device, source, options, job);
}

SparseFit fit_sparse(Device& device, TileSource& source, const SparseOptions& options, Job& job) {
  DeviceEncoder encoder(device, source, options, job);
  const MeasureSparse measure = [&](const SparseModel& model) {
    const auto decoder = sparse_decoder(device, model);
    const ErrorSums sums = measure_errors(device, *decoder, source, job);
    return std::sqrt(sums.square_difference / sums.square_reference);
  };
  return fit_sparse(encoder, source.info(), options, measure, job);
}

}  // namespace weft
