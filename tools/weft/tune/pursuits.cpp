// Trials of sparse coding.
#include <fmt/core.h>

#include <cmath>
#include <memory>
#include <utility>

#include "tune/trial.hpp"
#include "weft/ops/batch_omp.hpp"
#include "weft/reference/batch_omp.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {

constexpr std::size_t timed_signals = 50000, timed_atoms = 256, timed_dimension = 300, timed_k = 10;

// A pursuit takes its parameters as it is made, so that every run makes its own.
class Pursuit {
 public:
  Pursuit(Device& device, std::size_t signals, std::size_t atoms, std::size_t dimension,
          std::size_t k)
      : device_(device),
        signals_(signals),
        atoms_(atoms),
        dimension_(dimension),
        options_{.target = {k, 0}, .form = ops::OmpForm::gram, .family = ops::Family::panels},
        D_(random_buffer(device, atoms * dimension, "atoms")),
        Y_(random_buffer(device, signals * dimension, "signals")),
        indices_(device, signals * k * sizeof(std::uint32_t), "indices"),
        coefficients_(device, signals * k * sizeof(float), "coefficients"),
        counts_(device, signals * sizeof(std::uint32_t), "counts") {
    ops::BatchOmp omp = made();
    C_ = Buffer(device, signals * omp.row_of_correlations() * sizeof(float), "correlations");
    omp.correlate(signals, {Y_, dimension}, C_);
    device.finish();
  }

  void run() {
    made().code_correlated(signals_, {Y_, dimension_}, C_, {indices_, coefficients_, counts_});
  }

  // Empty if its atoms are those of the reference, with the same coefficients.
  std::string check() {
    run();
    const std::size_t k = options_.target.sparsity;
    const reference::SparseCodes expected =
        reference::batch_omp(atoms_, dimension_, read(D_), read(Y_), options_.target);
    std::vector<std::uint32_t> indices(signals_ * k);
    std::vector<float> coefficients(signals_ * k);
    device_.read(indices_, std::span<std::uint32_t>(indices));
    device_.read(coefficients_, std::span<float>(coefficients));
    for (std::size_t i = 0; i < indices.size(); ++i) {
      if (indices[i] != expected.indices[i]) {
        return fmt::format("atom {} of signal {} is {} instead of {}", i % k, i / k, indices[i],
                           expected.indices[i]);
      }
    }
    // random atoms of so many dimensions are near orthogonal: their least singular value is above
    // a quarter, its square the condition of the least squares
    double largest = 0;
    for (const double x : expected.coefficients) largest = std::max(largest, std::abs(x));
    const double bound =
        16 * error_bound(static_cast<double>(dimension_ + k * k), float_unit) * largest;
    return difference(coefficients, expected.coefficients, [&](std::size_t) { return bound; });
  }

 private:
  ops::BatchOmp made() {
    ops::BatchOmp omp(device_, atoms_, dimension_, options_);
    omp.set_dictionary({D_, dimension_});
    return omp;
  }
  std::vector<double> read(const Buffer& buffer) {
    std::vector<float> values(buffer.size() / sizeof(float));
    device_.read(buffer, std::span<float>(values));
    return {values.begin(), values.end()};
  }

  Device& device_;
  std::size_t signals_, atoms_, dimension_;
  ops::OmpOptions options_;
  Buffer D_, Y_, indices_, coefficients_, counts_, C_;
};

}  // namespace

std::vector<Trial> pursuit_trials() {
  Benchmark timed{"omp_pursuit", fmt::format("{} x {}, k {}", timed_signals, timed_atoms, timed_k)};
  timed.prepare = [](Device& device) -> Run {
    const auto pursuit =
        std::make_shared<Pursuit>(device, timed_signals, timed_atoms, timed_dimension, timed_k);
    return [pursuit] { pursuit->run(); };
  };
  return {{&tunables::batch_omp, std::move(timed), [](Device& device) -> Check {
             const auto small = std::make_shared<Pursuit>(device, 61, 130, 40, 5);
             return [small] { return small->check(); };
           }}};
}

}  // namespace weft
