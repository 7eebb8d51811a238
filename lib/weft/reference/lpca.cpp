#include "weft/reference/lpca.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "weft/error.hpp"
#include "weft/reference/cluster_seeds.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/tile.hpp"

namespace weft::reference {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr double least_gain = 1e-3;  // of the error, by which an iteration must improve it
constexpr std::size_t mean_iterations = 10;

Eigen::Index index(std::size_t i) {
  return static_cast<Eigen::Index>(i);
}

// An affine subspace of the ABRDFs.
struct Cluster {
  std::vector<std::size_t> texels;
  Eigen::VectorXd mean;    // [n]
  Eigen::MatrixXd basis;   // [n, k], orthonormal
  Eigen::VectorXd values;  // singular values
};

// The cluster's mean and the leading k components of the texels without it.
void fit(Cluster& cluster, const Eigen::MatrixXd& T, std::size_t k) {
  const Eigen::Index n = T.rows();
  const Eigen::Index count = index(cluster.texels.size());
  Eigen::MatrixXd A(n, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    A.col(i) = T.col(index(cluster.texels[static_cast<std::size_t>(i)]));
  }
  cluster.mean = A.rowwise().mean();
  A.colwise() -= cluster.mean;
  cluster.basis.resize(n, 0);
  cluster.values.resize(0);
  const double norm = A.norm();
  // What rounding of the mean leaves is no component.
  const double floor = 1e-13 * (norm + std::sqrt(static_cast<double>(count)) * cluster.mean.norm());
  if (k == 0 || count < 2 || norm <= floor) return;
  // by the Gram matrix of the shorter side of A scaled to unit norm
  A /= norm;
  const bool by_texels = count < n;
  const RowMajor G = by_texels ? RowMajor(A.transpose() * A) : RowMajor(A * A.transpose());
  const std::size_t size = static_cast<std::size_t>(G.rows());
  const SymmetricEigen eigen =
      symmetric_eigen(size, std::span(G.data(), static_cast<std::size_t>(G.size())));
  // Gram matrices resolve squares down to rounding of the largest.
  const double resolved = static_cast<double>(size) * 0x1p-52 * eigen.values[0];
  Eigen::Index kept = 0;
  while (kept < std::min(index(k), std::min(count - 1, n)) &&
         eigen.values[static_cast<std::size_t>(kept)] > resolved) {
    ++kept;
  }
  const Eigen::Map<const RowMajor> vectors(eigen.vectors.data(), index(size), index(size));
  cluster.basis = by_texels ? Eigen::MatrixXd(A * vectors.leftCols(kept))
                            : Eigen::MatrixXd(vectors.leftCols(kept));
  cluster.values.resize(kept);
  for (Eigen::Index j = 0; j < kept; ++j) {
    if (by_texels) cluster.basis.col(j).normalize();
    cluster.values[j] = norm * std::sqrt(eigen.values[static_cast<std::size_t>(j)]);
  }
}

// Squared distance of every texel from a cluster's subspace.
Eigen::VectorXd distances(const Cluster& cluster, const Eigen::MatrixXd& T) {
  const Eigen::MatrixXd D = T.colwise() - cluster.mean;
  const Eigen::MatrixXd coefficients = cluster.basis.transpose() * D;
  return (D - cluster.basis * coefficients).colwise().squaredNorm();
}

// Gives empty clusters the worst half of the texels of the worst cluster. False if none is empty.
bool repair(std::vector<Cluster>& clusters, std::vector<std::size_t>& label,
            const Eigen::VectorXd& error) {
  bool repaired = false;
  for (std::size_t empty = 0; empty < clusters.size(); ++empty) {
    if (std::count(label.begin(), label.end(), empty) > 0) continue;
    std::vector<double> sums(clusters.size(), 0.0);
    std::vector<std::size_t> sizes(clusters.size(), 0);
    for (std::size_t p = 0; p < label.size(); ++p) {
      sums[label[p]] += error[index(p)];
      ++sizes[label[p]];
    }
    std::size_t worst = 0;
    for (std::size_t g = 1; g < clusters.size(); ++g) {
      if (sums[g] > sums[worst]) worst = g;
    }
    if (!(sums[worst] > 0) || sizes[worst] < 2) return repaired;
    std::vector<std::size_t> members;
    for (std::size_t p = 0; p < label.size(); ++p) {
      if (label[p] == worst) members.push_back(p);
    }
    std::stable_sort(members.begin(), members.end(), [&](std::size_t a, std::size_t b) {
      return error[index(a)] > error[index(b)];
    });
    for (std::size_t i = 0; i < members.size() / 2; ++i) label[members[i]] = empty;
    repaired = true;
  }
  return repaired;
}

void set_members(std::vector<Cluster>& clusters, const std::vector<std::size_t>& label) {
  for (Cluster& cluster : clusters) cluster.texels.clear();
  for (std::size_t p = 0; p < label.size(); ++p) clusters[label[p]].texels.push_back(p);
  std::erase_if(clusters, [](const Cluster& cluster) { return cluster.texels.empty(); });
}

// Each texel to its nearest subspace; its own where that is as near.
void assign(const std::vector<Cluster>& clusters, const Eigen::MatrixXd& T,
            std::vector<std::size_t>& label, Eigen::VectorXd& error) {
  for (std::size_t g = 0; g < clusters.size(); ++g) {
    for (const std::size_t p : clusters[g].texels) label[p] = g;
  }
  RowMajor all(index(clusters.size()), T.cols());
  for (std::size_t g = 0; g < clusters.size(); ++g) {
    all.row(index(g)) = distances(clusters[g], T).transpose();
  }
  for (std::size_t p = 0; p < label.size(); ++p) {
    std::size_t best = label[p];
    for (std::size_t g = 0; g < clusters.size(); ++g) {
      if (all(index(g), index(p)) < all(index(best), index(p))) best = g;
    }
    label[p] = best;
    error[index(p)] = all(index(best), index(p));
  }
}

double squared_error(const std::vector<Cluster>& clusters, const Eigen::MatrixXd& T) {
  double sum = 0;
  for (const Cluster& cluster : clusters) {
    for (const std::size_t p : cluster.texels) {
      const Eigen::VectorXd d = T.col(index(p)) - cluster.mean;
      sum += (d - cluster.basis * (cluster.basis.transpose() * d)).squaredNorm();
    }
  }
  return sum;
}

std::unique_ptr<LpcaModel> to_model(const std::vector<Cluster>& clusters,
                                    const Eigen::MatrixXd& T) {
  auto model = std::make_unique<LpcaModel>();
  const std::size_t texels = static_cast<std::size_t>(T.cols());
  for (const Cluster& cluster : clusters) {
    model->rank = std::max(model->rank, static_cast<std::size_t>(cluster.values.size()));
  }
  model->coefficients.assign(texels * model->rank, 0.0f);
  std::vector<std::uint32_t> label(texels);
  std::vector<std::uint32_t> ranks;
  for (std::size_t g = 0; g < clusters.size(); ++g) {
    const Cluster& cluster = clusters[g];
    ranks.push_back(static_cast<std::uint32_t>(cluster.values.size()));
    for (const double value : cluster.mean) model->mean.push_back(static_cast<float>(value));
    for (Eigen::Index j = 0; j < cluster.values.size(); ++j) {
      for (const double value : cluster.basis.col(j)) {
        model->basis.push_back(static_cast<float>(value * cluster.values[j]));
      }
    }
    for (const std::size_t p : cluster.texels) {
      label[p] = static_cast<std::uint32_t>(g);
      const Eigen::VectorXd a = cluster.basis.transpose() * (T.col(index(p)) - cluster.mean);
      for (Eigen::Index j = 0; j < a.size(); ++j) {
        model->coefficients[p * model->rank + static_cast<std::size_t>(j)] =
            static_cast<float>(a[j] / cluster.values[j]);
      }
    }
  }
  model->clusters = IndexTensor(label, clusters.size());
  model->ranks = IndexTensor(ranks, model->rank + 1);
  return model;
}

}  // namespace

LpcaFit encode_lpca(TileSource& source, const LpcaOptions& options, Job& job) {
  const BtfShape& shape = source.info().shape;
  const std::size_t texels = shape.texels();
  const std::size_t n = shape.images() * shape.channels;
  const std::size_t count = std::min(options.clusters, texels);
  const std::size_t k = std::min({options.rank, texels, n});
  MemoryPlan plan;
  // the data, its distances from a subspace, and the parts of the largest cluster
  plan.add("BTF in double", 5 * texels * n * sizeof(double));
  plan.add("clusters", count * (n * (k + 1) + texels) * sizeof(double));
  const std::size_t shorter = std::min(texels, n);
  plan.add("Gram matrix", 3 * shorter * shorter * sizeof(double));
  plan.add("model", (count * n * (k + 1) + texels * (k + 1)) * sizeof(float));
  job.plan(plan);

  // a column per texel
  Eigen::MatrixXd T(index(n), index(texels));
  {
    const StageTimer timer(job, "read");
    std::vector<double> image(shape.image_values());
    for (std::size_t i = 0; i < shape.images(); ++i) {
      read_tile(source, i, 1, job.nan_zero, image);
      T.middleRows(index(i * shape.channels), index(shape.channels)) =
          Eigen::Map<const Eigen::MatrixXd>(image.data(), index(shape.channels), index(texels));
      job.advance("read", i + 1, shape.images());
    }
  }

  // k-means: subspaces of no dimension
  const StageTimer timer(job, "iteration");
  const std::vector<std::size_t> seeds =
      cluster_seeds(n, std::span(T.data(), static_cast<std::size_t>(T.size())), count, job.seed);
  std::vector<Cluster> clusters(seeds.size());
  std::vector<std::size_t> label(texels, 0);
  Eigen::VectorXd error(index(texels));
  for (std::size_t g = 0; g < seeds.size(); ++g) {
    clusters[g].mean = T.col(index(seeds[g]));
    clusters[g].basis.resize(index(n), 0);
  }
  for (std::size_t i = 0; i < mean_iterations; ++i) {
    check_interrupt();
    assign(clusters, T, label, error);
    set_members(clusters, label);
    for (Cluster& cluster : clusters) fit(cluster, T, 0);
  }

  // k-subspaces
  LpcaFit result;
  const double norm = T.norm();
  for (std::size_t i = 0;; ++i) {
    check_interrupt();
    for (Cluster& cluster : clusters) fit(cluster, T, k);
    result.errors.push_back(norm > 0 ? std::sqrt(squared_error(clusters, T)) / norm : 0.0);
    job.advance("iteration", i + 1, options.iterations + 1);
    const bool improved = i == 0 || result.errors[i] < (1 - least_gain) * result.errors[i - 1];
    if (!improved || i >= options.iterations) break;
    const std::vector<std::size_t> before = label;
    assign(clusters, T, label, error);
    clusters.resize(std::min(count, texels));  // those that were lost may come back
    const bool repaired = repair(clusters, label, error);
    set_members(clusters, label);
    if (!repaired && label == before) break;
  }
  result.model = to_model(clusters, T);
  return result;
}

void decode_lpca(const LpcaModel& model, std::size_t first, std::size_t count,
                 std::span<double> out) {
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t n = shape.images() * shape.channels;
  const std::vector<std::size_t> offsets = model.offsets();
  for (std::size_t p = 0; p < shape.texels(); ++p) {
    const std::size_t g = model.clusters[p];
    const float* a = model.coefficients.data() + p * model.rank;
    for (std::size_t image = first; image < first + count; ++image) {
      for (std::size_t c = 0; c < shape.channels; ++c) {
        const std::size_t row = image * shape.channels + c;
        double value = model.mean[g * n + row];
        for (std::size_t i = offsets[g]; i < offsets[g + 1]; ++i) {
          value += double{a[i - offsets[g]]} * double{model.basis[i * n + row]};
        }
        out[((image - first) * shape.texels() + p) * shape.channels + c] = value;
      }
    }
  }
}

}  // namespace weft::reference
