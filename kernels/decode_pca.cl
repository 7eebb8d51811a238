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
// cache while the images pass. Three vectors of 8 texels by up to three channels are held at once.
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

__attribute__((reqd_work_group_size(1, 1, 1)))
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
      for (uint part = 0; part < NR; part += 24) {
        const ulong p = panel * NR + part;
        if (p >= texels) break;
        __global const float* a = A + panel * k * NR + part;
        float8 u[CHANNELS], v[CHANNELS], w[CHANNELS];
        decode_texels(k, a, b, image_mean, u, v, w);
        __global float* texel = out + ((first_out + image) * texels + p) * CHANNELS;
        const uint valid = (uint)min((ulong)24, texels - p);
        store_texels(u, min(valid, 8u), texel);
        if (valid > 8) store_texels(v, min(valid - 8, 8u), texel + 8 * CHANNELS);
        if (valid > 16) store_texels(w, min(valid - 16, 8u), texel + 16 * CHANNELS);
      }
    }
  }
}
