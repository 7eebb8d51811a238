#include "eigen_products.hpp"

#include <Eigen/Core>

namespace {

template <typename T>
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
template <typename T>
using In = Eigen::Map<const Matrix<T>>;
template <typename T>
using Out = Eigen::Map<Matrix<T>>;

template <typename T>
void gemm(long M, long N, long K, const T* A, const T* B, T* C) {
  Out<T>(C, M, N).noalias() = In<T>(A, M, K) * In<T>(B, K, N);
}

template <typename T>
void syrk(long M, long K, const T* A, bool add, T* C) {
  Out<T> result(C, M, M);
  if (!add) result.setZero();
  result.template selfadjointView<Eigen::Lower>().rankUpdate(In<T>(A, M, K));
}

}  // namespace

void weft_eigen_set_threads(int threads) {
  Eigen::setNbThreads(threads);
}
void weft_eigen_sgemm(long M, long N, long K, const float* A, const float* B, float* C) {
  gemm(M, N, K, A, B, C);
}
void weft_eigen_dgemm(long M, long N, long K, const double* A, const double* B, double* C) {
  gemm(M, N, K, A, B, C);
}
void weft_eigen_ssyrk(long M, long K, const float* A, bool add, float* C) {
  syrk(M, K, A, add, C);
}
void weft_eigen_dsyrk(long M, long K, const double* A, bool add, double* C) {
  syrk(M, K, A, add, C);
}
