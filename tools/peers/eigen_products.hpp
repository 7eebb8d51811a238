// Eigen's products behind functions of a shared library of its own, see CMakeLists.txt.
#pragma once

#define WEFT_PEER_API __attribute__((visibility("default")))

extern "C" {
WEFT_PEER_API void weft_eigen_set_threads(int threads);
// C = A B, row-major.
WEFT_PEER_API void weft_eigen_sgemm(long M, long N, long K, const float* A, const float* B,
                                    float* C);
WEFT_PEER_API void weft_eigen_dgemm(long M, long N, long K, const double* A, const double* B,
                                    double* C);
// The lower triangle of C = A A^T + (add ? C : 0), row-major.
WEFT_PEER_API void weft_eigen_ssyrk(long M, long K, const float* A, bool add, float* C);
WEFT_PEER_API void weft_eigen_dsyrk(long M, long K, const double* A, bool add, double* C);
}
