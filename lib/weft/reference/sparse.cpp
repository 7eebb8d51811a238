#include "weft/reference/sparse.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "weft/model/sparse_lists.hpp"
#include "weft/reference/pca.hpp"

namespace weft {

double SparseErrors::foreseen() const {
  return std::sqrt(projection * projection + texels * texels + views * views);
}

}  // namespace weft

namespace weft::reference {
namespace {

KsvdFit<double> fit_dictionary(std::size_t dimension, const std::vector<double>& signals,
                               std::size_t atoms, std::size_t terms, const SparseRequest& request,
                               std::uint64_t seed) {
  KsvdOptions options;
  options.atoms = std::min(atoms, signals.size() / dimension);
  options.sparsity = std::min(terms, options.atoms);
  options.iterations = request.iterations;
  options.update = request.update;
  options.seed = seed;
  return ksvd(dimension, signals, options);
}

CodeLists code_lists(const KsvdFit<double>& fit, std::size_t signals) {
  return {fit.indices.size() / signals, fit.indices, fit.coefficients};
}

}  // namespace

SparseFit encode_sparse(TileSource& source, const SparseRequest& request, Job& job) {
  const BtfShape& shape = source.info().shape;
  const std::size_t texels = shape.texels();
  const std::size_t n = shape.images() * shape.channels;
  const std::size_t fibre = shape.lights * shape.channels;
  SvdRequest svd;
  svd.method = SvdMethod::automatic;
  svd.rank = request.rank;
  PcaFit pca = encode_pca(source, svd, job);
  const std::size_t rank = pca.model->rank;

  SparseFit fit;
  fit.model = std::make_unique<SparseModel>();
  fit.rank = rank;
  fit.model->mean = std::move(pca.model->mean);
  if (pca.squares > 0) fit.errors.projection = pca.residual / std::sqrt(pca.squares);
  if (rank == 0) return fit;

  // Y = U Sigma and W^T, in a unit that brings the largest singular value to [1/2, 1)
  std::vector<double> W(pca.model->basis.begin(), pca.model->basis.end());  // [rank][n]
  std::vector<double> sigma(rank, 0.0);
  for (std::size_t j = 0; j < rank; ++j) {
    for (std::size_t r = 0; r < n; ++r) sigma[j] += W[j * n + r] * W[j * n + r];
    sigma[j] = std::sqrt(sigma[j]);
    for (std::size_t r = 0; r < n && sigma[j] > 0; ++r) W[j * n + r] /= sigma[j];
  }
  int exponent = 0;
  std::frexp(*std::max_element(sigma.begin(), sigma.end()), &exponent);
  const double unit = std::ldexp(1.0, exponent);
  const double squares = pca.squares / (unit * unit);
  std::vector<double> Y(texels * rank);
  for (std::size_t i = 0; i < Y.size(); ++i) {
    Y[i] = double{pca.model->coefficients[i]} * sigma[i % rank] / unit;
  }

  // texels, and B = diag(|P_j|) D W^T
  const StageTimer timer(job, "K-SVD");
  const KsvdFit<double> of_texels =
      fit_dictionary(rank, Y, request.abrdf_atoms, request.texel_terms, request, job.seed);
  CodeLists P = code_lists(of_texels, texels);
  std::vector<double> weights = atom_weights(P, of_texels.dictionary.size() / rank);
  const std::vector<std::uint32_t> abrdfs = drop_unused(P, weights);
  std::vector<double> B(abrdfs.size() * n, 0.0);
  for (std::size_t a = 0; a < abrdfs.size(); ++a) {
    for (std::size_t j = 0; j < rank; ++j) {
      const double factor = weights[a] * of_texels.dictionary[abrdfs[a] * rank + j];
      for (std::size_t r = 0; r < n; ++r) B[a * n + r] += factor * W[j * n + r];
    }
  }

  // views, with the weights divided out
  const KsvdFit<double> of_views =
      fit_dictionary(fibre, B, request.light_atoms, request.view_terms, request, job.seed + 1);
  CodeLists V = code_lists(of_views, abrdfs.size() * shape.views);
  for (std::size_t i = 0; i < V.coefficients.size(); ++i) {
    V.coefficients[i] /= weights[i / (shape.views * V.length)];
  }
  std::vector<double> uses = atom_weights(V, of_views.dictionary.size() / fibre);
  const std::vector<std::uint32_t> lights = drop_unused(V, uses);
  for (const std::uint32_t atom : lights) {
    for (std::size_t i = 0; i < fibre; ++i) {
      fit.model->dictionary.push_back(
          static_cast<float>(of_views.dictionary[atom * fibre + i] * unit));
    }
  }
  fit.model->light_atoms = lights.size();
  fit.model->abrdf_atoms = abrdfs.size();
  fit.model->views = sparse_lists(V, lights.size());
  fit.model->texels = sparse_lists(P, abrdfs.size());
  fit.errors.texels = std::sqrt(of_texels.objective / squares);
  fit.errors.views = std::sqrt(of_views.objective / squares);
  return fit;
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
