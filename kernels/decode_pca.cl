// Images from a PCA model (Ruiters & Klein 2009, section 2.1):
//
//   T[image, p, c] = mean[image, c] + sum_{j < k} A[p, j] B[j, image, c]
//
//   A:    panels [ceil(P / NR)][k][NR], A(p, j) = A[((p / NR) k + j) NR + p % NR], zero-padded
//   B:    [images CHANNELS][k]: the k coefficients of an image's channel are neighbours
//   mean: [images][CHANNELS]
//   out:  [first_out + images][P][CHANNELS]: images [first_image, first_image + images) of the model,
//         behind first_out others
//
// One work-item decodes PANELS panels of texels for IMAGES images: the panels stay in the first
// cache while the images pass. Three vectors of texels by up to three channels are held at once.
// Work-item (block of panels, block of images).
//
// CHANNELS  C
// PANELS    panels that a work-item decodes
// IMAGES    images that it decodes them for
#include "vector_width.cl"
#include "decode_texels.cl"

#ifndef PANELS
#define PANELS 4
#endif
#ifndef IMAGES
#define IMAGES 16
#endif

WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void decode_pca(ulong texels, ulong first_image, ulong images, ulong k, ulong first_out,
                         __global const float* restrict A, __global const float* restrict B,
                         __global const float* restrict mean, __global float* restrict out) {
  const ulong panel_count = (texels + NR - 1) / NR;
  const ulong panel_begin = get_global_id(0) * PANELS;
  const ulong panel_end = min(panel_begin + PANELS, panel_count);
  const ulong image_begin = get_global_id(1) * IMAGES;
  const ulong image_end = min(image_begin + IMAGES, images);
  for (ulong panel = panel_begin; panel < panel_end; ++panel) {
    for (ulong image = image_begin; image < image_end; ++image) {
      __global const float* b = B + (first_image + image) * CHANNELS * k;
      __global const float* image_mean = mean + (first_image + image) * CHANNELS;
      const ulong p = panel * NR;
      realv u[CHANNELS], v[CHANNELS], w[CHANNELS];
      decode_texels(k, A + panel * k * NR, b, image_mean, u, v, w);
      __global float* texel = out + ((first_out + image) * texels + p) * CHANNELS;
      const uint valid = (uint)min((ulong)NR, texels - p);
      store_texels(u, valid, texel);
      if (valid > VW) store_texels(v, valid - VW, texel + VW * CHANNELS);
      if (valid > 2 * VW) store_texels(w, valid - 2 * VW, texel + 2 * VW * CHANNELS);
    }
  }
}
