// Images from a sparse tensor decomposition (Ruiters & Klein 2009, eq. (2)), in two steps:
//
//   W[j, n, c]    = sum_i V[i, v, j] L[c, l, i]                 n = v lights + l
//   T[n, p, c]    = mean[n, c] + sum_j P[j, p] W[j, n, c]
//
// where the sums are over the terms of lists. Lanes are VW images, one behind the other, so that
// every term is one load and one fma for each channel; a block of texels is transposed in registers
// before it is written, since texels are neighbours in an image.
//
//   view_atoms, view_coefficients:   [D2][views][k1]
//   texel_atoms, texel_coefficients: [texels][k2]
//   L:    [D1][CHANNELS][VW + lights + VW], zero on both sides of the lights
//   W:    [image blocks][D2][CHANNELS][VW], block b of images b VW and following
//   mean: [CHANNELS][image blocks of the model VW]
//   out:  [images][texels][CHANNELS], images [first, first + images) of the model
//
// combine_views:  work-item (ABRDF j, block of images from first_block on)
// combine_texels: work-item (block of BLOCK VW texels, block of images from first_block on)
//
// CHANNELS  C
// BLOCK     vectors of texels that a work-item decodes
#include "vector_width.cl"
#include "decode_texels.cl"

#ifndef BLOCK
#define BLOCK 16
#endif

#if VW == 16
#define ROUNDS 4
#define intv int16
#define LANES (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
inline realv zip_low(realv a, realv b) {
  return (realv)(a.s0, b.s0, a.s1, b.s1, a.s2, b.s2, a.s3, b.s3, a.s4, b.s4, a.s5, b.s5, a.s6, b.s6,
                 a.s7, b.s7);
}
inline realv zip_high(realv a, realv b) {
  return (realv)(a.s8, b.s8, a.s9, b.s9, a.sa, b.sa, a.sb, b.sb, a.sc, b.sc, a.sd, b.sd, a.se, b.se,
                 a.sf, b.sf);
}
#else
#define ROUNDS 3
#define intv int8
#define LANES (int8)(0, 1, 2, 3, 4, 5, 6, 7)
inline realv zip_low(realv a, realv b) {
  return (realv)(a.s0, b.s0, a.s1, b.s1, a.s2, b.s2, a.s3, b.s3);
}
inline realv zip_high(realv a, realv b) {
  return (realv)(a.s4, b.s4, a.s5, b.s5, a.s6, b.s6, a.s7, b.s7);
}
#endif

// x[r] lane s becomes x[s] lane r: every round turns the bits of (r, s) by one.
inline void transpose(realv* x) {
  realv y[VW];
#pragma unroll
  for (uint round = 0; round < ROUNDS; ++round) {
#pragma unroll
    for (uint r = 0; r < VW / 2; ++r) {
      y[2 * r] = zip_low(x[r], x[r + VW / 2]);
      y[2 * r + 1] = zip_high(x[r], x[r + VW / 2]);
    }
#pragma unroll
    for (uint r = 0; r < VW; ++r) x[r] = y[r];
  }
}

WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void combine_views(ulong abrdfs, ulong views, ulong lights, ulong k1, ulong first_block,
                            __global const uint* restrict view_atoms,
                            __global const float* restrict view_coefficients,
                            __global const float* restrict L, __global float* restrict W) {
  const ulong j = get_global_id(0);
  const ulong begin = (first_block + get_global_id(1)) * VW;
  const ulong end = min(begin + VW, views * lights);
  const ulong row = lights + 2 * VW;
  const intv lanes = LANES;
  realv w[CHANNELS];
  for (uint c = 0; c < CHANNELS; ++c) w[c] = 0.0f;
  // the images of one view after the other
  for (ulong n = begin; n < end;) {
    const ulong v = n / lights;
    const ulong l = n % lights;
    // light l falls on the lane of image n
    __global const float* from = L + VW + l - (n - begin);
    __global const uint* atoms = view_atoms + (j * views + v) * k1;
    __global const float* coefficients = view_coefficients + (j * views + v) * k1;
    for (uint c = 0; c < CHANNELS; ++c) {
      realv sum = 0.0f;
      for (ulong i = 0; i < k1; ++i) {
        sum = fma((realv)coefficients[i], loadv(from + (atoms[i] * CHANNELS + c) * row), sum);
      }
      w[c] = select(w[c], sum, lanes >= (intv)(int)(n - begin));
    }
    n += lights - l;
  }
  __global float* to = W + (get_global_id(1) * abrdfs + j) * CHANNELS * VW;
  for (uint c = 0; c < CHANNELS; ++c) storev(w[c], to + c * VW);
}

// One texel for the lanes' images.
inline void combine_texel(ulong k2, __global const uint* atoms, __global const float* coefficients,
                          __global const float* W, const realv* mean, realv* out) {
#if CHANNELS == 3
  realv r = mean[0], g = mean[1], b = mean[2];
  for (ulong j = 0; j < k2; ++j) {
    const realv a = coefficients[j];
    __global const float* w = W + (ulong)atoms[j] * (3 * VW);
    r = fma(a, loadv(w), r);
    g = fma(a, loadv(w + VW), g);
    b = fma(a, loadv(w + 2 * VW), b);
  }
  out[0] = r, out[VW] = g, out[2 * VW] = b;
#else
  for (uint c = 0; c < CHANNELS; ++c) {
    realv sum = mean[c];
    for (ulong j = 0; j < k2; ++j) {
      sum = fma((realv)coefficients[j], loadv(W + ((ulong)atoms[j] * CHANNELS + c) * VW), sum);
    }
    out[c * VW] = sum;
  }
#endif
}

WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void combine_texels(ulong texels, ulong abrdfs, ulong k2, ulong mean_row, ulong first,
                             ulong images, ulong first_block,
                             __global const uint* restrict texel_atoms,
                             __global const float* restrict texel_coefficients,
                             __global const float* restrict W, __global const float* restrict mean,
                             __global float* restrict out) {
  const ulong block = first_block + get_global_id(1);
  const ulong begin = max(block * VW, first);
  const ulong end = min((block + 1) * VW, first + images);
  __global const float* w = W + get_global_id(1) * abrdfs * CHANNELS * VW;
  realv image_mean[CHANNELS];
  for (uint c = 0; c < CHANNELS; ++c) image_mean[c] = loadv(mean + c * mean_row + block * VW);
  const ulong last = min((get_global_id(0) + 1) * BLOCK * VW, texels);
  for (ulong p = get_global_id(0) * BLOCK * VW; p < last; p += VW) {
    const uint valid = (uint)min((ulong)VW, texels - p);
    realv x[CHANNELS * VW];  // [channel][texel], lanes are images
    for (uint t = 0; t < VW; ++t) {
      const ulong row = (p + min(t, valid - 1)) * k2;
      combine_texel(k2, texel_atoms + row, texel_coefficients + row, w, image_mean, x + t);
    }
    for (uint c = 0; c < CHANNELS; ++c) transpose(x + c * VW);
    for (ulong n = begin; n < end; ++n) {
      realv texel[CHANNELS];
      for (uint c = 0; c < CHANNELS; ++c) texel[c] = x[c * VW + n % VW];
      store_texels(texel, valid, out + ((n - first) * texels + p) * CHANNELS);
    }
  }
}
