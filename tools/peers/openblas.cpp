// OpenBLAS, by its C interface.
#include <cblas.h>
#include <fmt/core.h>

#include <vector>

#include "contender.hpp"
#include "eigen_products.hpp"

namespace weft::peers {
namespace {

class OpenBlas : public Contender {
 public:
  OpenBlas(const Case& c, const Matrices& matrices)
      : case_(c), matrices_(matrices), C_(c.fp64 ? 0 : c.M * c.N), C64_(c.fp64 ? c.M * c.N : 0) {}

  std::string name() const override { return "OpenBLAS"; }

  void run() override {
    const auto M = static_cast<blasint>(case_.M), N = static_cast<blasint>(case_.N);
    const auto K = static_cast<blasint>(case_.columns());
    if (case_.operation == Operation::gemm) {
      if (case_.fp64) {
        cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, M, N, K, 1, matrices_.A64.data(), K,
                    matrices_.B64.data(), N, 0, C64_.data(), N);
      } else {
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, M, N, K, 1, matrices_.A.data(), K,
                    matrices_.B.data(), N, 0, C_.data(), N);
      }
      return;
    }
    for (std::size_t chunk = 0; chunk < case_.chunks(); ++chunk) {
      if (case_.fp64) {
        cblas_dsyrk(CblasRowMajor, CblasLower, CblasNoTrans, M, K, 1, matrices_.A64.data(), K,
                    chunk == 0 ? 0 : 1, C64_.data(), M);
      } else {
        cblas_ssyrk(CblasRowMajor, CblasLower, CblasNoTrans, M, K, 1, matrices_.A.data(), K,
                    chunk == 0 ? 0 : 1, C_.data(), M);
      }
    }
  }

  Elements result() override {
    return case_.fp64 ? elements_of(case_, C64_.data()) : elements_of(case_, C_.data());
  }

 private:
  const Case& case_;
  const Matrices& matrices_;
  std::vector<float> C_;
  std::vector<double> C64_;
};

}  // namespace

std::unique_ptr<Contender> openblas_contender(const Case& c, const Matrices& matrices) {
  return std::make_unique<OpenBlas>(c, matrices);
}

std::string openblas_name() {
  return fmt::format("{}, kernels for {}", openblas_get_config(), openblas_get_corename());
}

void set_peer_threads(int threads) {
  openblas_set_num_threads(threads);
  weft_eigen_set_threads(threads);
}

}  // namespace weft::peers
