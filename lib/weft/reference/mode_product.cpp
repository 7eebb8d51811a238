#include "weft/reference/mode_product.hpp"

#include <Eigen/Core>

namespace weft::reference {
namespace {
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Map<const RowMajor> matrix(std::size_t rows, std::size_t columns,
                                  std::span<const double> values) {
  return {values.data(), static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(columns)};
}

struct Split {
  std::size_t outer = 1;
  std::size_t inner = 1;
};
Split split(std::span<const std::size_t> sizes, std::size_t mode) {
  Split split;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    if (i < mode) split.outer *= sizes[i];
    if (i > mode) split.inner *= sizes[i];
  }
  return split;
}

}  // namespace

std::size_t elements_of(std::span<const std::size_t> sizes) {
  std::size_t count = 1;
  for (const std::size_t size : sizes) count *= size;
  return count;
}

std::vector<double> unfold(std::span<const std::size_t> sizes, std::size_t mode,
                           std::span<const double> T) {
  const auto [outer, inner] = split(sizes, mode);
  const std::size_t n = sizes[mode];
  std::vector<double> unfolded(T.size());
  for (std::size_t o = 0; o < outer; ++o) {
    for (std::size_t j = 0; j < n; ++j) {
      for (std::size_t i = 0; i < inner; ++i) {
        unfolded[(j * outer + o) * inner + i] = T[(o * n + j) * inner + i];
      }
    }
  }
  return unfolded;
}

std::vector<double> mode_product(std::span<const std::size_t> sizes, std::size_t mode,
                                 std::span<const double> T, std::size_t rows,
                                 std::span<const double> M) {
  const auto [outer, inner] = split(sizes, mode);
  const std::size_t n = sizes[mode];
  std::vector<double> product(outer * rows * inner);
  if (inner == 1) {  // one product instead of one for every row
    Eigen::Map<RowMajor>(product.data(), static_cast<Eigen::Index>(outer),
                         static_cast<Eigen::Index>(rows))
        .noalias() = matrix(outer, n, T) * matrix(rows, n, M).transpose();
    return product;
  }
  for (std::size_t o = 0; o < outer; ++o) {
    Eigen::Map<RowMajor>(product.data() + o * rows * inner, static_cast<Eigen::Index>(rows),
                         static_cast<Eigen::Index>(inner))
        .noalias() = matrix(rows, n, M) * matrix(n, inner, T.subspan(o * n * inner, n * inner));
  }
  return product;
}

std::vector<double> transposed(std::size_t rows, std::size_t columns, std::span<const double> M) {
  std::vector<double> result(M.size());
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t j = 0; j < columns; ++j) result[j * rows + i] = M[i * columns + j];
  }
  return result;
}

std::vector<double> mode_gram(std::span<const std::size_t> sizes, std::size_t mode,
                              std::span<const double> T) {
  const std::size_t n = sizes[mode];
  const std::vector<double> unfolded = unfold(sizes, mode, T);
  const auto rows = matrix(n, T.size() / n, unfolded);
  std::vector<double> gram(n * n);
  Eigen::Map<RowMajor>(gram.data(), rows.rows(), rows.rows()).noalias() = rows * rows.transpose();
  return gram;
}

}  // namespace weft::reference
