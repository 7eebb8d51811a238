// A library that computes a case. Several hold the data of one case at a time and take turns.
#pragma once

#include <memory>
#include <string>

#include "cases.hpp"
#include "weft/device/device.hpp"

namespace weft::peers {

class Contender {
 public:
  virtual ~Contender() = default;
  virtual std::string name() const = 0;
  // Computes all of the case once, from data where the library wants it (host memory, device
  // buffers) to a result likewise. Returns when it is there.
  virtual void run() = 0;
  virtual Elements result() = 0;
};

// Each refers to `c` and `matrices`, which outlive it. Null where the library doesn't do the case.
std::unique_ptr<Contender> own_contender(Device& device, const Case& c, const Matrices& matrices);
std::unique_ptr<Contender> openblas_contender(const Case& c, const Matrices& matrices);
std::unique_ptr<Contender> eigen_contender(const Case& c, const Matrices& matrices);
#ifdef WEFT_HAS_CLBLAST
std::unique_ptr<Contender> clblast_contender(Device& device, const Case& c,
                                             const Matrices& matrices);
#endif

// What OpenBLAS computes with: its version, and the name of the kernels that it chose.
std::string openblas_name();
// Threads of OpenBLAS and of Eigen.
void set_peer_threads(int threads);

// The lower triangle of a row-major matrix, or all of it.
template <typename T>
Elements elements_of(const Case& c, const T* C) {
  Elements elements;
  for (std::size_t i = 0; i < c.M; ++i) {
    const std::size_t end = c.operation == Operation::syrk ? i + 1 : c.N;
    elements.insert(elements.end(), C + i * c.N, C + i * c.N + end);
  }
  return elements;
}

}  // namespace weft::peers
