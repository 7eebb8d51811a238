// Images from a PCA model on the device: kernels/decode_pca.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"

namespace weft::ops {

struct DecodePcaShape {
  std::size_t first_image = 0;
  std::size_t images = 0;
  std::size_t texels = 0;
  std::size_t channels = 0;
  std::size_t rank = 0;
  std::size_t first_out = 0;  // where in `out` the first of these images goes
};

// out[image, p, c] = mean + sum_j A[p, j] B[j, image, c].
//   A:    packed panels of the k x P matrix A^T (ops::pack_panels)
//   B:    [all images C][k]; mean: [all images C]
//   out:  [first_out + images][P][C] floats: images [first_image, first_image + images) of the
//         model, behind `first_out` others
void decode_pca(Device& device, const DecodePcaShape& shape, const Buffer& A, const Buffer& B,
                const Buffer& mean, Buffer& out);

}  // namespace weft::ops
