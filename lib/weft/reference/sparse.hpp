// Sparse tensor decomposition (Ruiters & Klein 2009) in double: the truth that the device is
// checked against.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

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

// Squared errors of the texels and of the views by the length of their lists, from 0 on, as parts
// of |T|^2.
struct SparseLengthErrors {
  std::vector<double> views;
  std::vector<double> texels;
};

// The fit step by step, so that lengths and rank can be chosen on the way (section 4.2). Fits are
// unrounded, and their info holds nothing yet.
class SparseEncoder {
 public:
  virtual ~SparseEncoder() = default;
  // The truncated SVD, which later fits are of. Throws an input error where it, or they, would take
  // more memory than there is.
  virtual void project(std::size_t rank) = 0;
  // Components that it has; 0: the data is its mean, as every fit is then.
  virtual std::size_t rank() const = 0;
  // What it leaves, as a part of |T|.
  virtual double projection_error() const = 0;
  // Both K-SVDs.
  virtual SparseFit fit(std::size_t view_terms, std::size_t texel_terms,
                        std::size_t iterations) = 0;
  // What shorter lists of that fit would leave.
  virtual SparseLengthErrors length_errors() = 0;
  // Both K-SVDs from the dictionaries of that fit, whatever was refitted since.
  virtual SparseFit refit(std::size_t view_terms, std::size_t texel_terms,
                          std::size_t iterations) = 0;
};

namespace reference {

std::unique_ptr<SparseEncoder> sparse_encoder(TileSource& source, const SparseRequest& request,
                                              Job& job);

// Section 4.1: truncated SVD, K-SVD over the texels, back-projection, weights, K-SVD over the
// views. The tensors of the result are float; info holds nothing yet. Throws as the device encoder
// does.
SparseFit encode_sparse(TileSource& source, const SparseRequest& request, Job& job);

// Images [first, first + count) of a model, [count][Y][X][C].
void decode_sparse(const SparseModel& model, std::size_t first, std::size_t count,
                   std::span<double> out);

}  // namespace reference
}  // namespace weft
