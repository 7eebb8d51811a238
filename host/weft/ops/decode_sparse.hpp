// Images from a sparse tensor decomposition on the device: kernels/decode_sparse.cl.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/device/device.hpp"

namespace weft::ops {

struct DecodeSparseShape {
  std::size_t first_image = 0;
  std::size_t images = 0;  // to decode
  std::size_t views = 0;
  std::size_t lights = 0;
  std::size_t texels = 0;
  std::size_t channels = 0;
  std::size_t light_atoms = 0;  // D1
  std::size_t abrdf_atoms = 0;  // D2
  std::size_t view_terms = 0;   // k1
  std::size_t texel_terms = 0;  // k2
};

// Lists of terms on the device: indices as uint, coefficients as floats.
struct SparseTerms {
  const Buffer& atoms;
  const Buffer& coefficients;
};

// Floats of the dictionary, of the mean and of the ABRDFs as kernels of `width` lanes read them; of
// the ABRDFs for as many images as shape.images, wherever they begin. No device has more lanes than
// `most_sparse_lanes`, and more lanes take more.
inline constexpr std::size_t most_sparse_lanes = 16;
std::size_t sparse_dictionary_floats(std::size_t width, const DecodeSparseShape& shape);
std::size_t sparse_mean_floats(std::size_t width, const DecodeSparseShape& shape);
std::size_t sparse_abrdf_floats(std::size_t width, const DecodeSparseShape& shape);

// dictionary: [D1][L][C]; mean: [V][L][C].
std::vector<float> sparse_dictionary(std::size_t width, const DecodeSparseShape& shape,
                                     std::span<const float> dictionary);
std::vector<float> sparse_mean(std::size_t width, const DecodeSparseShape& shape,
                               std::span<const float> mean);

// out[image, p, c] = mean[image, c] + sum_j P[j, p] sum_i V[i, v, j] L[c, l, i]
//   V: terms [D2][V][k1]; P: terms [P][k2]
//   abrdfs: sparse_abrdf_floats(), work space
//   out:    [images][P][C] floats: images [first_image, first_image + images) of the model
void decode_sparse(Device& device, const DecodeSparseShape& shape, const SparseTerms& V,
                   const SparseTerms& P, const Buffer& dictionary, const Buffer& mean,
                   Buffer& abrdfs, Buffer& out);

}  // namespace weft::ops
