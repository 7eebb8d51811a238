// Eigen, built for this machine.
#include <vector>

#include "contender.hpp"
#include "eigen_products.hpp"

namespace weft::peers {
namespace {

class EigenProducts : public Contender {
 public:
  EigenProducts(const Case& c, const Matrices& matrices)
      : case_(c), matrices_(matrices), C_(c.fp64 ? 0 : c.M * c.N), C64_(c.fp64 ? c.M * c.N : 0) {}

  std::string name() const override { return "Eigen"; }

  void run() override {
    const auto M = static_cast<long>(case_.M), N = static_cast<long>(case_.N);
    const auto K = static_cast<long>(case_.columns());
    if (case_.operation == Operation::gemm) {
      if (case_.fp64) {
        weft_eigen_dgemm(M, N, K, matrices_.A64.data(), matrices_.B64.data(), C64_.data());
      } else {
        weft_eigen_sgemm(M, N, K, matrices_.A.data(), matrices_.B.data(), C_.data());
      }
      return;
    }
    for (std::size_t chunk = 0; chunk < case_.chunks(); ++chunk) {
      if (case_.fp64) {
        weft_eigen_dsyrk(M, K, matrices_.A64.data(), chunk > 0, C64_.data());
      } else {
        weft_eigen_ssyrk(M, K, matrices_.A.data(), chunk > 0, C_.data());
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

std::unique_ptr<Contender> eigen_contender(const Case& c, const Matrices& matrices) {
  return std::make_unique<EigenProducts>(c, matrices);
}

}  // namespace weft::peers
