#include "weft/reference/sparse.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "weft/model/sparse_lengths.hpp"
#include "weft/model/sparse_lists.hpp"
#include "weft/reference/pca.hpp"

namespace weft {

double SparseErrors::foreseen() const {
  return std::sqrt(projection * projection + texels * texels + views * views);
}

}  // namespace weft

namespace weft::reference {
namespace {

CodeLists code_lists(const KsvdFit<double>& fit, std::size_t signals) {
  return {fit.indices.size() / signals, fit.indices, fit.coefficients};
}

// The squared errors of a fit of Y [signals][dimension] by dictionary D for shorter lists.
std::vector<double> shorter_lists(std::size_t dimension, const std::vector<double>& Y,
                                  const std::vector<double>& D, const CodeLists& codes,
                                  double squares) {
  std::vector<double> errors = truncation_errors(dimension, std::vector<float>(Y.begin(), Y.end()),
                                                 std::vector<float>(D.begin(), D.end()), codes);
  for (double& error : errors) error /= squares;
  return errors;
}

class ReferenceEncoder final : public SparseEncoder {
 public:
  ReferenceEncoder(TileSource& source, const SparseRequest& request, Job& job)
      : source_(source),
        request_(request),
        job_(job),
        shape_(source.info().shape),
        n_(shape_.images() * shape_.channels),
        fibre_(shape_.lights * shape_.channels) {}

  // Y = U Sigma and W^T, in a unit that brings the largest singular value to [1/2, 1).
  void project(std::size_t rank) override {
    SvdRequest svd;
    svd.method = SvdMethod::automatic;
    svd.rank = rank;
    PcaFit pca = encode_pca(source_, svd, job_);
    rank_ = pca.model->rank;
    mean_ = std::move(pca.model->mean);
    projection_ = pca.squares > 0 ? pca.residual / std::sqrt(pca.squares) : 0;
    if (rank_ == 0) return;
    W_.assign(pca.model->basis.begin(), pca.model->basis.end());
    std::vector<double> sigma(rank_, 0.0);
    for (std::size_t j = 0; j < rank_; ++j) {
      for (std::size_t r = 0; r < n_; ++r) sigma[j] += W_[j * n_ + r] * W_[j * n_ + r];
      sigma[j] = std::sqrt(sigma[j]);
      for (std::size_t r = 0; r < n_ && sigma[j] > 0; ++r) W_[j * n_ + r] /= sigma[j];
    }
    int exponent = 0;
    std::frexp(*std::max_element(sigma.begin(), sigma.end()), &exponent);
    unit_ = std::ldexp(1.0, exponent);
    squares_ = pca.squares / (unit_ * unit_);
    Y_.resize(shape_.texels() * rank_);
    for (std::size_t i = 0; i < Y_.size(); ++i) {
      Y_[i] = double{pca.model->coefficients[i]} * sigma[i % rank_] / unit_;
    }
  }

  std::size_t rank() const override { return rank_; }
  double projection_error() const override { return projection_; }

  SparseFit fit(std::size_t view_terms, std::size_t texel_terms, std::size_t iterations) override {
    texel_start_.clear();
    view_start_.clear();
    SparseFit fit = decompose(view_terms, texel_terms, iterations);
    texel_start_ = of_texels_.dictionary;
    view_start_ = of_views_.dictionary;
    return fit;
  }

  SparseFit refit(std::size_t view_terms, std::size_t texel_terms,
                  std::size_t iterations) override {
    return decompose(view_terms, texel_terms, iterations);
  }

  SparseLengthErrors length_errors() override {
    return {shorter_lists(fibre_, B_, of_views_.dictionary,
                          code_lists(of_views_, B_.size() / fibre_), squares_),
            shorter_lists(rank_, Y_, of_texels_.dictionary, code_lists(of_texels_, shape_.texels()),
                          squares_)};
  }

 private:
  // From `start`, where it is a dictionary of as many atoms, else from samples.
  KsvdFit<double> fit_dictionary(std::size_t dimension, const std::vector<double>& signals,
                                 std::size_t atoms, std::size_t terms, std::size_t iterations,
                                 std::uint64_t seed, const std::vector<double>& start) const {
    KsvdOptions options;
    options.atoms = std::min(atoms, signals.size() / dimension);
    options.sparsity = std::min(terms, options.atoms);
    options.iterations = iterations;
    options.update = request_.update;
    options.seed = seed;
    if (start.size() != options.atoms * dimension) return ksvd(dimension, signals, options);
    options.start = KsvdStart::given;
    return ksvd(dimension, signals, options, start);
  }

  SparseFit decompose(std::size_t view_terms, std::size_t texel_terms, std::size_t iterations) {
    SparseFit fit;
    fit.model = std::make_unique<SparseModel>();
    fit.rank = rank_;
    fit.errors.projection = projection_;
    fit.model->mean = mean_;
    if (rank_ == 0) return fit;

    // texels, and B = diag(|P_j|) D W^T
    const StageTimer timer(job_, "K-SVD");
    of_texels_ = fit_dictionary(rank_, Y_, request_.abrdf_atoms, texel_terms, iterations, job_.seed,
                                texel_start_);
    CodeLists P = code_lists(of_texels_, shape_.texels());
    std::vector<double> weights = atom_weights(P, of_texels_.dictionary.size() / rank_);
    const std::vector<std::uint32_t> abrdfs = drop_unused(P, weights);
    B_.assign(abrdfs.size() * n_, 0.0);
    for (std::size_t a = 0; a < abrdfs.size(); ++a) {
      for (std::size_t j = 0; j < rank_; ++j) {
        const double factor = weights[a] * of_texels_.dictionary[abrdfs[a] * rank_ + j];
        for (std::size_t r = 0; r < n_; ++r) B_[a * n_ + r] += factor * W_[j * n_ + r];
      }
    }

    // views, with the weights divided out
    of_views_ = fit_dictionary(fibre_, B_, request_.light_atoms, view_terms, iterations,
                               job_.seed + 1, view_start_);
    CodeLists V = code_lists(of_views_, abrdfs.size() * shape_.views);
    for (std::size_t i = 0; i < V.coefficients.size(); ++i) {
      V.coefficients[i] /= weights[i / (shape_.views * V.length)];
    }
    std::vector<double> uses = atom_weights(V, of_views_.dictionary.size() / fibre_);
    const std::vector<std::uint32_t> lights = drop_unused(V, uses);
    for (const std::uint32_t atom : lights) {
      for (std::size_t i = 0; i < fibre_; ++i) {
        fit.model->dictionary.push_back(
            static_cast<float>(of_views_.dictionary[atom * fibre_ + i] * unit_));
      }
    }
    fit.model->light_atoms = lights.size();
    fit.model->abrdf_atoms = abrdfs.size();
    fit.model->views = sparse_lists(V, lights.size());
    fit.model->texels = sparse_lists(P, abrdfs.size());
    fit.errors.texels = std::sqrt(of_texels_.objective / squares_);
    fit.errors.views = std::sqrt(of_views_.objective / squares_);
    return fit;
  }

  TileSource& source_;
  SparseRequest request_;
  Job& job_;
  BtfShape shape_;
  std::size_t n_;      // V L C
  std::size_t fibre_;  // L C

  std::size_t rank_ = 0;
  double projection_ = 0;
  double unit_ = 1;
  double squares_ = 0;  // |T|^2, in that unit
  std::vector<float> mean_;
  std::vector<double> W_;  // [rank][n]
  std::vector<double> Y_;  // [P][rank]
  std::vector<double> B_;  // [ABRDFs in use][n]
  KsvdFit<double> of_texels_;
  KsvdFit<double> of_views_;
  // dictionaries of the last fit
  std::vector<double> texel_start_;
  std::vector<double> view_start_;
};

}  // namespace

std::unique_ptr<SparseEncoder> sparse_encoder(TileSource& source, const SparseRequest& request,
                                              Job& job) {
  return std::make_unique<ReferenceEncoder>(source, request, job);
}

SparseFit encode_sparse(TileSource& source, const SparseRequest& request, Job& job) {
  ReferenceEncoder encoder(source, request, job);
  encoder.project(request.rank);
  return encoder.fit(request.view_terms, request.texel_terms, request.iterations);
}

void decode_sparse(const SparseModel& model, std::size_t first, std::size_t count,
                   std::span<double> out) {
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t C = shape.channels;
  const SparseLists& V = model.views;
  const SparseLists& P = model.texels;
  std::vector<double> abrdfs(model.abrdf_atoms * C);
  double* texel = out.data();
  for (std::size_t image = first; image < first + count; ++image) {
    const std::size_t view = image / shape.lights;
    const std::size_t light = image % shape.lights;
    // the ABRDFs of this view and light
    std::fill(abrdfs.begin(), abrdfs.end(), 0.0);
    for (std::size_t j = 0; j < model.abrdf_atoms; ++j) {
      for (std::size_t n = 0; n < V.length; ++n) {
        const std::size_t term = (j * shape.views + view) * V.length + n;
        for (std::size_t c = 0; c < C; ++c) {
          abrdfs[j * C + c] +=
              double{V.coefficients[term]} *
              double{model.dictionary[(V.atoms[term] * shape.lights + light) * C + c]};
        }
      }
    }
    for (std::size_t p = 0; p < shape.texels(); ++p, texel += C) {
      for (std::size_t c = 0; c < C; ++c) {
        texel[c] = model.mean[image * C + c];
        for (std::size_t term = p * P.length; term < (p + 1) * P.length; ++term) {
          texel[c] += double{P.coefficients[term]} * abrdfs[P.atoms[term] * C + c];
        }
      }
    }
  }
}

}  // namespace weft::reference
