// Weft's own operations, from row-major matrices in buffers of the device: packing is part of every
// run.
#include <cstddef>
#include <span>
#include <vector>

#include "contender.hpp"
#include "weft/ops/matrix_product.hpp"

namespace weft::peers {
namespace {

class Own : public Contender {
 public:
  Own(Device& device, const Case& c, const Matrices& matrices)
      : device_(device), case_(c), arithmetic_(c.fp64 ? Arithmetic::f64 : Arithmetic::f32) {
    A_ = c.fp64 ? upload(matrices.A64) : upload(matrices.A);
    if (c.operation == Operation::gemm) B_ = c.fp64 ? upload(matrices.B64) : upload(matrices.B);
    C_ = Buffer(device, c.M * c.N * size_of(arithmetic_), "C");
  }

  std::string name() const override { return "Weft"; }

  void run() override {
    const std::size_t M = case_.M, N = case_.N, K = case_.columns();
    const ops::ProductOptions options{arithmetic_};
    if (case_.operation == Operation::gemm) {
      ops::gemm(device_, ops::Transpose::no, ops::Transpose::no, M, N, K, 1, {A_, K}, {B_, N}, 0,
                {C_, N}, options);
    } else {
      for (std::size_t chunk = 0; chunk < case_.chunks(); ++chunk) {
        ops::syrk(device_, ops::Triangle::lower, ops::Transpose::no, M, K, 1, {A_, K},
                  chunk == 0 ? 0 : 1, {C_, M}, options);
      }
    }
    device_.finish();
  }

  Elements result() override {
    if (case_.fp64) return download<double>();
    return download<float>();
  }

 private:
  template <typename T>
  Buffer upload(const std::vector<T>& values) {
    Buffer buffer(device_, values.size() * sizeof(T), "matrix");
    device_.write(buffer, std::span<const T>(values));
    return buffer;
  }
  template <typename T>
  Elements download() {
    std::vector<T> values(case_.M * case_.N);
    device_.read(C_, std::span<T>(values));
    return elements_of(case_, values.data());
  }

  Device& device_;
  const Case& case_;
  Arithmetic arithmetic_;
  Buffer A_, B_, C_;
};

}  // namespace

std::unique_ptr<Contender> own_contender(Device& device, const Case& c, const Matrices& matrices) {
  if (c.fp64 && !device.limits().has_fp64) return nullptr;
  return std::make_unique<Own>(device, c, matrices);
}

}  // namespace weft::peers
