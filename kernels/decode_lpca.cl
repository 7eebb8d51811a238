// Images from a local PCA model (Mueller, Meseth & Klein 2003):
//
//   T[image, p, c] = mean[g, image, c] + sum_{j < k} A[p, j] B[g, image, c, j]      g: p's cluster
//
// in two steps. Texels are decoded cluster by cluster, each cluster filling whole panels of NR slots,
// so that the texels of a panel share their rows of B; then they are put in order.
//
//   slot    0 .. NR-1           NR .. 2 NR-1         2 NR ..
//         +-------------------+-------------------+----------
//         | cluster 0         | cluster 0, padded | cluster 1
//         +-------------------+-------------------+----------
//
//   panels: [panels][2]         a panel's cluster, and how many of its slots are texels
//   slots:  [P]                 the slot of each texel
//   A:      [panels][k][NR]     zero in padding
//   B:      [G][all images][CHANNELS][k]        mean: [G][all images][CHANNELS]
//   sorted: [images][panels NR][CHANNELS], and four values more
//   out:    [first_out + images][P][CHANNELS]: images [first_image, first_image + images) of the
//           model, behind first_out others
//
// CHANNELS  C
// PANELS    panels that a work-item decodes
// IMAGES    images that it decodes them for
// TEXELS    texels that a work-item puts in order
#include "vector_width.cl"
#include "decode_texels.cl"

#ifndef PANELS
#define PANELS 4
#endif
#ifndef IMAGES
#define IMAGES 16
#endif
#ifndef TEXELS
#define TEXELS 4096
#endif

// Work-item (block of panels, block of images).
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void decode_lpca(ulong panel_count, ulong all_images, ulong first_image, ulong images,
                          ulong k, __global const uint* restrict panels,
                          __global const float* restrict A, __global const float* restrict B,
                          __global const float* restrict mean, __global float* restrict sorted) {
  const ulong panel_begin = get_global_id(0) * PANELS;
  const ulong panel_end = min(panel_begin + PANELS, panel_count);
  const ulong image_begin = get_global_id(1) * IMAGES;
  const ulong image_end = min(image_begin + IMAGES, images);
  for (ulong panel = panel_begin; panel < panel_end; ++panel) {
    const ulong cluster_images = panels[2 * panel] * all_images + first_image;
    for (ulong image = image_begin; image < image_end; ++image) {
      __global const float* b = B + (cluster_images + image) * CHANNELS * k;
      __global const float* image_mean = mean + (cluster_images + image) * CHANNELS;
      realv u[CHANNELS], v[CHANNELS], w[CHANNELS];
      decode_texels(k, A + panel * k * NR, b, image_mean, u, v, w);
      __global float* out = sorted + (image * panel_count + panel) * NR * CHANNELS;
      store_texels(u, VW, out);
      store_texels(v, VW, out + VW * CHANNELS);
      store_texels(w, VW, out + 2 * VW * CHANNELS);
    }
  }
}

// Work-item (block of texels, image).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void order_texels(ulong texels, ulong panel_count, ulong first_out,
                           __global const uint* restrict slots,
                           __global const float* restrict sorted, __global float* restrict out) {
  const ulong begin = get_global_id(0) * TEXELS;
  const ulong end = min(begin + TEXELS, texels);
  __global const float* in = sorted + get_global_id(1) * panel_count * NR * CHANNELS;
  __global float* image = out + (first_out + get_global_id(1)) * texels * CHANNELS;
#if CHANNELS == 3
  // One load and one store per texel: what goes into the next texel's place is overwritten by it.
  for (ulong p = begin; p + 1 < end; ++p) {
    vstore4(vload4(0, in + (ulong)slots[p] * CHANNELS), 0, image + p * CHANNELS);
  }
  vstore3(vload3(0, in + (ulong)slots[end - 1] * CHANNELS), 0, image + (end - 1) * CHANNELS);
#else
  for (ulong p = begin; p < end; ++p) {
    __global const float* texel = in + (ulong)slots[p] * CHANNELS;
    for (uint c = 0; c < CHANNELS; ++c) image[p * CHANNELS + c] = texel[c];
  }
#endif
}
