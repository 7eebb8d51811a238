// Images from a local PCA model (Mueller, Meseth & Klein 2003):
//
//   T[image, p, c] = mean[g, image, c] + sum_{j < k} A[p, j] B[g, image, c, j]      g: p's cluster
//
// Texels are taken cluster by cluster, each cluster filling whole panels of NR texels, so that the
// texels of a panel share their rows of B:
//
//   slot    0 .. NR-1           NR .. 2 NR-1         2 NR ..
//         +-------------------+-------------------+----------
//         | cluster 0         | cluster 0, padded | cluster 1
//         +-------------------+-------------------+----------
//
//   order:  [panels][NR]        the texel p in each slot, ascending within a cluster
//   panels: [panels][2]         a panel's cluster, and how many of its slots are texels
//   A:      [panels][k][NR]     zero in padding
//   B:      [G][all images][CHANNELS][k]        mean: [G][all images][CHANNELS]
//   out:    [images][P][CHANNELS]: images [first_image, first_image + images) of the model
//
// Where eight slots hold neighbouring texels they are stored as vectors, else one by one.
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

// Eight slots, of which `valid` hold texels; image points at the image's first texel.
inline void store_slots(const float8* channel, __global const uint* slots, uint valid,
                        __global float* image) {
  if (valid == 8 && slots[7] - slots[0] == 7) {
    store_texels(channel, 8, image + (ulong)slots[0] * CHANNELS);
    return;
  }
  float lanes[CHANNELS][8];
  for (uint c = 0; c < CHANNELS; ++c) vstore8(channel[c], 0, lanes[c]);
  for (uint lane = 0; lane < valid; ++lane) {
    __global float* texel = image + (ulong)slots[lane] * CHANNELS;
    for (uint c = 0; c < CHANNELS; ++c) texel[c] = lanes[c][lane];
  }
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void decode_lpca(ulong texels, ulong panel_count, ulong all_images, ulong first_image,
                          ulong images, ulong k, __global const uint* restrict order,
                          __global const uint* restrict panels, __global const float* restrict A,
                          __global const float* restrict B, __global const float* restrict mean,
                          __global float* restrict out) {
  const ulong panel_begin = get_global_id(0) * PANELS;
  const ulong panel_end = min(panel_begin + PANELS, panel_count);
  const ulong image_begin = get_global_id(1) * IMAGES;
  const ulong image_end = min(image_begin + IMAGES, images);
  for (ulong panel = panel_begin; panel < panel_end; ++panel) {
    const ulong cluster_images = panels[2 * panel] * all_images + first_image;
    const uint valid = panels[2 * panel + 1];
    for (ulong image = image_begin; image < image_end; ++image) {
      __global const float* b = B + (cluster_images + image) * CHANNELS * k;
      __global const float* image_mean = mean + (cluster_images + image) * CHANNELS;
      __global float* out_image = out + image * texels * CHANNELS;
      for (uint part = 0; part < valid; part += 24) {
        __global const float* a = A + panel * k * NR + part;
        __global const uint* slots = order + panel * NR + part;
        float8 u[CHANNELS], v[CHANNELS], w[CHANNELS];
        decode_texels(k, a, b, image_mean, u, v, w);
        const uint left = valid - part;
        store_slots(u, slots, min(left, 8u), out_image);
        if (left > 8) store_slots(v, slots + 8, min(left - 8, 8u), out_image);
        if (left > 16) store_slots(w, slots + 16, min(left - 16, 8u), out_image);
      }
    }
  }
}
