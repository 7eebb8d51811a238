// Data of sparse tensors with noise: some structure for every step of a sparse decomposition.
#pragma once

#include <memory>
#include <vector>

#include "model/random_sparse.hpp"
#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "weft/reference/sparse.hpp"

namespace weft::test {

inline constexpr BtfShape sparse_material{6, 7, 20, 18, 3};

inline std::shared_ptr<MemorySource> sparse_source(const BtfShape& shape, double noise = 0.02) {
  const SparseModel model = random_sparse(shape, {20, 16, 3, 3});
  std::vector<double> values(shape.values());
  reference::decode_sparse(model, 0, shape.images(), values);
  Random random(31);
  for (double& value : values) value += noise * random.normal();
  return source_of(shape, DType::f32, values);
}

}  // namespace weft::test
