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

#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef PANELS
#define PANELS 4
#endif
#ifndef IMAGES
#define IMAGES 16
#endif

// Texels [p, p + 8) of C channels, interleaved; `valid` of them exist.
inline void store_texels(const float8* channel, uint valid, __global float* out) {
#if CHANNELS == 1
  if (valid == 8) {
    vstore8(channel[0], 0, out);
    return;
  }
#elif CHANNELS == 3
  if (valid == 8) {
    const float8 r = channel[0], g = channel[1], b = channel[2];
    vstore8((float8)(r.s0, g.s0, b.s0, r.s1, g.s1, b.s1, r.s2, g.s2), 0, out);
    vstore8((float8)(b.s2, r.s3, g.s3, b.s3, r.s4, g.s4, b.s4, r.s5), 0, out + 8);
    vstore8((float8)(g.s5, b.s5, r.s6, g.s6, b.s6, r.s7, g.s7, b.s7), 0, out + 16);
    return;
  }
#endif
  for (uint c = 0; c < CHANNELS; ++c) {
    float lanes[8];
    vstore8(channel[c], 0, lanes);
    for (uint lane = 0; lane < valid; ++lane) out[lane * CHANNELS + c] = lanes[lane];
  }
}

// One channel of 24 texels.
#define CHANNEL(c)                                        \
  float8 x##c = image_mean[c], y##c = x##c, z##c = x##c;

#define ADD(c)                       \
  {                                  \
    const float8 t = b[(c) * k + j]; \
    x##c = fma(t, a0, x##c);         \
    y##c = fma(t, a1, y##c);         \
    z##c = fma(t, a2, z##c);         \
  }

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void decode_pca(ulong texels, ulong first_image, ulong images, ulong k, ulong first_out,
                         __global const float* restrict A, __global const float* restrict B, __global const float* restrict mean,
                         __global float* restrict out) {
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
#if CHANNELS == 3
        CHANNEL(0)
        CHANNEL(1)
        CHANNEL(2)
        for (ulong j = 0; j < k; ++j, a += NR) {
          const float8 a0 = vload8(0, a), a1 = vload8(0, a + 8), a2 = vload8(0, a + 16);
          ADD(0)
          ADD(1)
          ADD(2)
        }
        u[0] = x0, u[1] = x1, u[2] = x2;
        v[0] = y0, v[1] = y1, v[2] = y2;
        w[0] = z0, w[1] = z1, w[2] = z2;
#else
        for (uint c = 0; c < CHANNELS; ++c) {
          __global const float* a_channel = a;
          float8 x = image_mean[c], y = x, z = x;
          for (ulong j = 0; j < k; ++j, a_channel += NR) {
            const float8 t = b[c * k + j];
            x = fma(t, vload8(0, a_channel), x);
            y = fma(t, vload8(0, a_channel + 8), y);
            z = fma(t, vload8(0, a_channel + 16), z);
          }
          u[c] = x, v[c] = y, w[c] = z;
        }
#endif
        __global float* texel = out + ((first_out + image) * texels + p) * CHANNELS;
        const uint valid = (uint)min((ulong)24, texels - p);
        store_texels(u, min(valid, 8u), texel);
        if (valid > 8) store_texels(v, min(valid - 8, 8u), texel + 8 * CHANNELS);
        if (valid > 16) store_texels(w, min(valid - 16, 8u), texel + 16 * CHANNELS);
      }
    }
  }
}
