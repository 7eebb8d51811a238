#include "weft/reference/weigh_clusters.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "weft/reference/factorise.hpp"

namespace weft::reference {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Index index(std::size_t i) {
  return static_cast<Eigen::Index>(i);
}

// V diag(values) V^T of a symmetric matrix, values above rounding of the largest only.
struct Eigenpairs {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};

Eigenpairs eigenpairs(const Eigen::MatrixXd& matrix, std::size_t most) {
  const RowMajor rows = matrix;
  const std::size_t size = static_cast<std::size_t>(matrix.rows());
  const SymmetricEigen eigen =
      symmetric_eigen(size, std::span(rows.data(), static_cast<std::size_t>(rows.size())));
  const double floor = static_cast<double>(size) * 0x1p-46 * std::max(eigen.values[0], 0.0);
  std::size_t kept = 0;
  while (kept < std::min(size, most) && eigen.values[kept] > floor) ++kept;
  Eigenpairs result;
  result.values = Eigen::Map<const Eigen::VectorXd>(eigen.values.data(), index(kept));
  result.vectors = Eigen::Map<const RowMajor>(eigen.vectors.data(), index(size), index(size))
                       .leftCols(index(kept));
  return result;
}

// A cluster in coordinates of its own: x_p ~ M c_p, M the columns mu and b_1 .. b_k.
struct Cluster {
  Eigen::MatrixXd M;                // [n, 1 + k]
  std::vector<std::size_t> texels;  // its p
  Eigen::MatrixXd c;                // [1 + k, texels]
  Eigen::VectorXd s;                // [texels]
};

struct Weighed {
  Eigen::VectorXd mean;          // [n]
  Eigen::MatrixXd basis;         // [n, k]
  Eigen::MatrixXd coefficients;  // [k, texels]
};

Weighed weighed(const Cluster& cluster, std::size_t rank) {
  Weighed result;
  const Eigen::VectorXd mean = cluster.c * cluster.s / cluster.s.squaredNorm();
  result.mean = cluster.M * mean;
  const Eigen::MatrixXd d = cluster.c - mean * cluster.s.transpose();
  // M = Q R with Q orthonormal, by the Gram matrix of M
  const Eigenpairs gram =
      eigenpairs(cluster.M.transpose() * cluster.M, static_cast<std::size_t>(cluster.M.cols()));
  const Eigen::VectorXd roots = gram.values.cwiseSqrt();
  const Eigen::MatrixXd R = roots.asDiagonal() * gram.vectors.transpose();
  const Eigen::MatrixXd x = R * d;
  result.basis.resize(cluster.M.rows(), 0);
  result.coefficients.resize(0, d.cols());
  if (x.size() == 0) return result;
  const Eigenpairs parts = eigenpairs(x * x.transpose(), rank);
  const Eigen::VectorXd sigma = parts.values.cwiseSqrt();
  result.basis =
      cluster.M *
      (gram.vectors * (roots.cwiseInverse().asDiagonal() * (parts.vectors * sigma.asDiagonal())));
  result.coefficients = sigma.cwiseInverse().asDiagonal() * (parts.vectors.transpose() * x);
  return result;
}

}  // namespace

void weigh_clusters(LpcaModel& model, std::span<const float> texel_scale, std::size_t rank) {
  const std::size_t clusters = model.ranks.size();
  const std::size_t n = model.mean.size() / clusters;
  const std::vector<std::size_t> offsets = model.offsets();
  std::vector<Cluster> parts(clusters);
  for (std::size_t p = 0; p < texel_scale.size(); ++p) parts[model.clusters[p]].texels.push_back(p);
  std::vector<Weighed> fits;
  std::size_t widest = 0;
  for (std::size_t g = 0; g < clusters; ++g) {
    Cluster& cluster = parts[g];
    const std::size_t k = model.ranks[g];
    const std::size_t count = cluster.texels.size();
    cluster.M.resize(index(n), index(1 + k));
    for (std::size_t r = 0; r < n; ++r) {
      cluster.M(index(r), 0) = double{model.mean[g * n + r]};
      for (std::size_t j = 0; j < k; ++j) {
        cluster.M(index(r), index(1 + j)) = double{model.basis[(offsets[g] + j) * n + r]};
      }
    }
    cluster.c.resize(index(1 + k), index(count));
    cluster.s.resize(index(count));
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t p = cluster.texels[i];
      cluster.s[index(i)] = double{texel_scale[p]};
      cluster.c(0, index(i)) = 1;
      for (std::size_t j = 0; j < k; ++j) {
        cluster.c(index(1 + j), index(i)) = double{model.coefficients[p * model.rank + j]};
      }
    }
    fits.push_back(weighed(cluster, rank));
    widest = std::max(widest, static_cast<std::size_t>(fits.back().basis.cols()));
  }

  std::vector<std::uint32_t> ranks;
  model.rank = widest;
  model.mean.clear();
  model.basis.clear();
  model.coefficients.assign(texel_scale.size() * widest, 0.0f);
  for (std::size_t g = 0; g < clusters; ++g) {
    const Weighed& fit = fits[g];
    ranks.push_back(static_cast<std::uint32_t>(fit.basis.cols()));
    for (const double value : fit.mean) model.mean.push_back(static_cast<float>(value));
    for (Eigen::Index j = 0; j < fit.basis.cols(); ++j) {
      for (const double value : fit.basis.col(j)) model.basis.push_back(static_cast<float>(value));
      for (std::size_t i = 0; i < parts[g].texels.size(); ++i) {
        model.coefficients[parts[g].texels[i] * widest + static_cast<std::size_t>(j)] =
            static_cast<float>(fit.coefficients(j, index(i)));
      }
    }
  }
  model.ranks = IndexTensor(ranks, widest + 1);
}

}  // namespace weft::reference
