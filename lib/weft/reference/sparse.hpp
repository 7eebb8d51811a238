// Sparse tensor decomposition (Ruiters & Klein 2009) in double: the truth that the device is
// checked against.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/sparse.hpp"
#include "weft/reference/ksvd.hpp"

namespace weft {

struct SparseRequest {
  std::size_t view_terms = 9;     // k1
  std::size_t texel_terms = 11;   // k2
  std::size_t light_atoms = 256;  // D1
  std::size_t abrdf_atoms = 256;  // D2
  std::size_t rank = 300;         // components of the projection
  std::size_t iterations = 30;    // of each K-SVD
  KsvdUpdate update = KsvdUpdate::approximate;
};

// What the three approximations of section 4.1 leave, relative to |T|.
struct SparseErrors {
  double projection = 0;
  double texels = 0;
  double views = 0;
  // The error of the model, as their squares add up (section 4.2).
  double foreseen() const;
};

struct SparseFit {
  std::unique_ptr<SparseModel> model;
  std::size_t rank = 0;  // of the projection
  SparseErrors errors;
};

namespace reference {

// Section 4.1: truncated SVD, K-SVD over the texels, back-projection, weights, K-SVD over the
// views. The tensors of the result are float; info holds nothing yet. Throws as the device encoder
// does.
SparseFit encode_sparse(TileSource& source, const SparseRequest& request, Job& job);

// Images [first, first + count) of a model, [count][Y][X][C].
void decode_sparse(const SparseModel& model, std::size_t first, std::size_t count,
                   std::span<double> out);

}  // namespace reference
}  // namespace weft
