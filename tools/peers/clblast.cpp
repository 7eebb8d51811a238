// CLBlast, on the same device.
#include <clblast.h>

#include <span>
#include <vector>

#include "contender.hpp"
#include "weft/error.hpp"

namespace weft::peers {
namespace {

template <typename T>
class ClBlast : public Contender {
 public:
  ClBlast(Device& device, const Case& c, const std::vector<T>& A, const std::vector<T>& B)
      : device_(device), case_(c), A_(upload(A)), C_(device, c.M * c.N * sizeof(T), "C") {
    if (!B.empty()) B_ = upload(B);
  }

  std::string name() const override { return "CLBlast"; }

  void run() override {
    cl_command_queue queue = device_.queue();
    const std::size_t M = case_.M, N = case_.N, K = case_.columns();
    if (case_.operation == Operation::gemm) {
      check(clblast::Gemm<T>(clblast::Layout::kRowMajor, clblast::Transpose::kNo,
                             clblast::Transpose::kNo, M, N, K, T{1}, A_.get(), 0, K, B_.get(), 0, N,
                             T{0}, C_.get(), 0, N, &queue));
    } else {
      for (std::size_t chunk = 0; chunk < case_.chunks(); ++chunk) {
        check(clblast::Syrk<T>(clblast::Layout::kRowMajor, clblast::Triangle::kLower,
                               clblast::Transpose::kNo, M, K, T{1}, A_.get(), 0, K,
                               chunk == 0 ? T{0} : T{1}, C_.get(), 0, M, &queue));
      }
    }
    device_.finish();
  }

  Elements result() override {
    std::vector<T> values(case_.M * case_.N);
    device_.read(C_, std::span<T>(values));
    return elements_of(case_, values.data());
  }

 private:
  static void check(clblast::StatusCode status) {
    if (status != clblast::StatusCode::kSuccess) {
      fail_runtime("CLBlast: status {}", static_cast<int>(status));
    }
  }
  Buffer upload(const std::vector<T>& values) {
    Buffer buffer(device_, values.size() * sizeof(T), "matrix");
    device_.write(buffer, std::span<const T>(values));
    return buffer;
  }

  Device& device_;
  const Case& case_;
  Buffer A_, B_, C_;
};

}  // namespace

std::unique_ptr<Contender> clblast_contender(Device& device, const Case& c,
                                             const Matrices& matrices) {
  if (!c.fp64) return std::make_unique<ClBlast<float>>(device, c, matrices.A, matrices.B);
  if (!device.limits().has_fp64) return nullptr;
  return std::make_unique<ClBlast<double>>(device, c, matrices.A64, matrices.B64);
}

}  // namespace weft::peers
