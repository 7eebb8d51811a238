// Raw images to centred panels, the form in which the products take them:
//
//   panels(image C + c, p) = (T[image, p, c] - mean[image, c]) scale
//
//   raw:    [images][P][CHANNELS]
//   panels: [ceil(P / NR)][images CHANNELS][NR]      zero past the last texel
//   mean:   [images][CHANNELS], from mean[first_row] on
//
//          p = 0 .. NR-1            NR .. 2 NR-1
//        +-----------------------+-----------------------+--
//   row  | image 0, c = 0        |                       |
//        | image 0, c = 1        |                       |
//        | ...                   |                       |
//        +-----------------------+-----------------------+--
//
// With SQUARES each work-item also leaves the sum of its squared values in squares[image][block].
//
// convert_tile_transposed makes panels of the transpose, columns of which are rows of the above:
//
//   panels: [ceil(images CHANNELS / NR)][P][NR]      panels(p, image C + c), zero past the last row
//
// CHANNELS  C
// PANELS    panels that a work-item of convert_tile converts
// TEXELS    texels that a work-item of convert_tile_transposed converts, a multiple of 8
// SQUARES   1: sum the squares
#include "tile_values.cl"
#include "vector_width.cl"
#include "tile_texels.cl"

#ifndef PANELS
#define PANELS 16
#endif
#ifndef TEXELS
#define TEXELS 512
#endif
#ifndef SQUARES
#define SQUARES 0
#endif

// Work-item (block of PANELS panels, image).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void convert_tile(__global const raw_t* restrict raw, ulong texels, ulong images,
                           __global const float* restrict mean, ulong first_row, real scale,
                           __global real* restrict panels, __global real* restrict squares) {
  const ulong block = get_global_id(0);
  const ulong image = get_global_id(1);
  const ulong rows = images * CHANNELS;
  const ulong p_end = min((block + 1) * PANELS, (texels + NR - 1) / NR) * NR;
  __global const raw_t* values = raw + image * texels * CHANNELS;
  __global const float* image_mean = mean + first_row + image * CHANNELS;
  real8 sum = 0;
  const ulong vector_end = min(p_end, texels);
  // A panel's width is a multiple of 4: halves of a vector of texels stay in one panel.
  for (ulong p = block * PANELS * NR; p < p_end; p += 8) {
    __global real* low = panels + (p / NR * rows + image * CHANNELS) * NR + p % NR;
    __global real* high = panels + ((p + 4) / NR * rows + image * CHANNELS) * NR + (p + 4) % NR;
    if (p + 8 <= vector_end) {
      real8 channel[CHANNELS];
      load_texels(values + p * CHANNELS, channel);
      for (uint c = 0; c < CHANNELS; ++c) {
        const real8 x = (channel[c] - (real)image_mean[c]) * scale;
#if NR % 8 == 0
        vstore8(x, 0, low + c * NR);
#else
        vstore4(x.lo, 0, low + c * NR);
        vstore4(x.hi, 0, high + c * NR);
#endif
#if SQUARES
        sum = fma(x, x, sum);
#endif
      }
    } else {
      for (uint c = 0; c < CHANNELS; ++c) {
        for (uint lane = 0; lane < 8 && p + lane < p_end; ++lane) {
          real x = 0;
          if (p + lane < texels) {
            x = (load(values + (p + lane) * CHANNELS + c) - (real)image_mean[c]) * scale;
          }
          (lane < 4 ? low + lane : high + lane - 4)[c * NR] = x;
#if SQUARES
          sum.s0 = fma(x, x, sum.s0);
#endif
        }
      }
    }
  }
#if SQUARES
  const real4 four = sum.lo + sum.hi;
  squares[image * get_global_size(0) + block] = (four.x + four.y) + (four.z + four.w);
#endif
}

// Four rows of eight texels as eight texels of four rows.
#define STORE_TEXEL(s) \
  vstore4((real4)(row[r].s, row[r + 1].s, row[r + 2].s, row[r + 3].s), 0, out + r), out += NR;
#define FOR_TEXELS(X) X(s0) X(s1) X(s2) X(s3) X(s4) X(s5) X(s6) X(s7)

// Work-item (block of TEXELS texels, panel of rows).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void convert_tile_transposed(__global const raw_t* restrict raw, ulong texels, ulong images,
                                      __global const float* restrict mean, ulong first_row,
                                      real scale, __global real* restrict panels) {
  const ulong p_begin = get_global_id(0) * TEXELS;
  const ulong p_end = min(p_begin + TEXELS, texels);
  const ulong panel = get_global_id(1);
  const ulong row_begin = panel * NR;
  const ulong row_end = min(row_begin + NR, images * CHANNELS);
  const ulong image_begin = row_begin / CHANNELS;
  const ulong image_end = (row_end + CHANNELS - 1) / CHANNELS;
  ulong p = p_begin;
  real8 row[NR];
  for (uint r = (uint)(row_end - row_begin); r < NR; ++r) row[r] = 0;
  for (; p + 8 <= p_end; p += 8) {
    for (ulong image = image_begin; image < image_end; ++image) {
      real8 channel[CHANNELS];
      load_texels(raw + (image * texels + p) * CHANNELS, channel);
      for (uint c = 0; c < CHANNELS; ++c) {
        const ulong at = image * CHANNELS + c;
        if (at < row_begin || at >= row_end) continue;
        row[at - row_begin] = (channel[c] - (real)mean[first_row + at]) * scale;
      }
    }
    for (uint r = 0; r < NR; r += 4) {
      __global real* out = panels + (panel * texels + p) * NR;
      FOR_TEXELS(STORE_TEXEL)
    }
  }
  for (; p < p_end; ++p) {
    __global real* out = panels + (panel * texels + p) * NR;
    for (uint r = 0; r < NR; ++r) {
      const ulong at = row_begin + r;
      if (at < row_end) {
        const real x = load(raw + (at / CHANNELS * texels + p) * CHANNELS + at % CHANNELS);
        out[r] = (x - (real)mean[first_row + at]) * scale;
      } else {
        out[r] = 0;
      }
    }
  }
}
