#include "weft/reference/gram.hpp"

namespace weft::reference {

std::vector<double> gram(std::size_t n, std::size_t columns_x, std::span<const double> X,
                         std::size_t columns_z, std::span<const double> Z) {
  std::vector<double> G(columns_x * columns_z, 0.0);
  for (std::size_t p = 0; p < n; ++p) {
    for (std::size_t i = 0; i < columns_x; ++i) {
      for (std::size_t j = 0; j < columns_z; ++j) {
        G[i * columns_z + j] += X[p * columns_x + i] * Z[p * columns_z + j];
      }
    }
  }
  return G;
}

}  // namespace weft::reference
