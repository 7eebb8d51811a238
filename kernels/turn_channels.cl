// Images with the channels first as images with the channels last, through the channels' factor where
// there is one:
//
//   from: [images][RANK][texels]
//   value(p, c) = sum_r U(c, r) from(r, p), or from(c, p) without a factor
//
//   turn_channels  to: [images][texels][CHANNELS]. Work-item (block of TEXELS texels, image).
//   pack_channels  to: the matrix [images][texels CHANNELS] in panels [ceil(texels CHANNELS / NR)]
//                  [images][NR], as gemm.cl takes them, zero past the last column. Work-item (block of
//                  PANELS panels).
//
// CHANNELS  C
// RANK      channels before the factor; C without one
// FACTOR    1: there is a factor
// TEXELS    texels of a work-item of turn_channels
// PANELS    panels of one of pack_channels
#include "vector_width.cl"

#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef RANK
#define RANK CHANNELS
#endif
#ifndef FACTOR
#define FACTOR 0
#endif
#ifndef TEXELS
#define TEXELS 512
#endif
#ifndef PANELS
#define PANELS 8
#endif

inline float value(__global const float* from, ulong texels, __global const float* U, uint c) {
#if FACTOR
  float sum = 0.0f;
  for (uint r = 0; r < RANK; ++r) sum = fma(U[c * RANK + r], from[r * texels], sum);
  return sum;
#else
  return from[c * texels];
#endif
}

inline float8 values8(__global const float* from, ulong texels, __global const float* U, uint c) {
#if FACTOR
  float8 sum = 0.0f;
  for (uint r = 0; r < RANK; ++r) {
    sum = fma((float8)U[c * RANK + r], vload8(0, from + r * texels), sum);
  }
  return sum;
#else
  return vload8(0, from + c * texels);
#endif
}

// 8 texels of three channels.
inline void turn8(__global const float* from, ulong texels, __global const float* U,
                  __global float* to) {
  const float8 r = values8(from, texels, U, 0);
  const float8 g = values8(from, texels, U, 1);
  const float8 b = values8(from, texels, U, 2);
  vstore8((float8)(r.s0, g.s0, b.s0, r.s1, g.s1, b.s1, r.s2, g.s2), 0, to);
  vstore8((float8)(b.s2, r.s3, g.s3, b.s3, r.s4, g.s4, b.s4, r.s5), 0, to + 8);
  vstore8((float8)(g.s5, b.s5, r.s6, g.s6, b.s6, r.s7, g.s7, b.s7), 0, to + 16);
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void turn_channels(ulong texels, __global const float* restrict from, ulong from_offset,
                            __global const float* restrict U, __global float* restrict to,
                            ulong to_offset) {
  const ulong begin = get_global_id(0) * TEXELS;
  const ulong end = min(begin + TEXELS, texels);
  __global const float* image = from + from_offset + get_global_id(1) * texels * RANK;
  __global float* out = to + to_offset + get_global_id(1) * texels * CHANNELS;
  ulong p = begin;
#if CHANNELS == 3
  for (; p + 8 <= end; p += 8) turn8(image + p, texels, U, out + p * 3);
#endif
  for (; p < end; ++p) {
    for (uint c = 0; c < CHANNELS; ++c) out[p * CHANNELS + c] = value(image + p, texels, U, c);
  }
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void pack_channels(ulong images, ulong texels, __global const float* restrict from,
                            ulong from_offset, __global const float* restrict U,
                            __global float* restrict panels) {
  const ulong columns = texels * CHANNELS;
  const ulong begin = get_global_id(0) * PANELS;
  const ulong end = min(begin + PANELS, (columns + NR - 1) / NR);
  for (ulong k = 0; k < images; ++k) {
    __global const float* image = from + from_offset + k * texels * RANK;
    for (ulong panel = begin; panel < end; ++panel) {
      __global float* to = panels + (panel * images + k) * NR;
      const ulong first = panel * NR;
#if CHANNELS == 3
      if (first + NR <= columns) {
        for (uint i = 0; i < VW; i += 8) {
          turn8(image + panel * VW + i, texels, U, to + 3 * i);
        }
        continue;
      }
#endif
      for (uint j = 0; j < NR; ++j) {
        const ulong p = (first + j) / CHANNELS;
        to[j] = first + j < columns ? value(image + p, texels, U, (first + j) % CHANNELS) : 0.0f;
      }
    }
  }
}
