// Raw images to centred float panels, the form in which the products take them:
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
// Work-item (block of PANELS panels, image).
//
// CHANNELS  C
// PANELS    panels that a work-item converts
// SQUARES   1: sum the squares
#include "tile_values.cl"
#include "vector_width.cl"

#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef PANELS
#define PANELS 16
#endif
#ifndef SQUARES
#define SQUARES 0
#endif

// Eight texels of the raw image, one vector per channel.
inline void load_texels(__global const raw_t* values, float8* channel) {
#if CHANNELS == 1
  channel[0] = tile_load8(values);
#elif CHANNELS == 3
  const float8 a = tile_load8(values), b = tile_load8(values + 8), c = tile_load8(values + 16);
  channel[0] = (float8)(a.s0, a.s3, a.s6, b.s1, b.s4, b.s7, c.s2, c.s5);
  channel[1] = (float8)(a.s1, a.s4, a.s7, b.s2, b.s5, c.s0, c.s3, c.s6);
  channel[2] = (float8)(a.s2, a.s5, b.s0, b.s3, b.s6, c.s1, c.s4, c.s7);
#else
  for (uint c = 0; c < CHANNELS; ++c) {
    channel[c] = (float8)(tile_load(values + c), tile_load(values + CHANNELS + c),
                          tile_load(values + 2 * CHANNELS + c), tile_load(values + 3 * CHANNELS + c),
                          tile_load(values + 4 * CHANNELS + c), tile_load(values + 5 * CHANNELS + c),
                          tile_load(values + 6 * CHANNELS + c), tile_load(values + 7 * CHANNELS + c));
  }
#endif
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void convert_tile(__global const raw_t* restrict raw, ulong texels, ulong images,
                           __global const float* restrict mean, ulong first_row, float scale,
                           __global float* restrict panels, __global float* restrict squares) {
  const ulong block = get_global_id(0);
  const ulong image = get_global_id(1);
  const ulong rows = images * CHANNELS;
  const ulong panel_count = (texels + NR - 1) / NR;
  const ulong panel_end = min((block + 1) * PANELS, panel_count);
  __global const raw_t* values = raw + image * texels * CHANNELS;
  __global const float* image_mean = mean + first_row + image * CHANNELS;
  float8 sum = 0.0f;
  for (ulong panel = block * PANELS; panel < panel_end; ++panel) {
    __global float* out = panels + (panel * rows + image * CHANNELS) * NR;
    for (uint group = 0; group < NR; group += 8) {
      const ulong p = panel * NR + group;
      float8 channel[CHANNELS];
      if (p + 8 <= texels) {
        load_texels(values + p * CHANNELS, channel);
        for (uint c = 0; c < CHANNELS; ++c) {
          const float8 x = (channel[c] - image_mean[c]) * scale;
          vstore8(x, 0, out + c * NR + group);
#if SQUARES
          sum = fma(x, x, sum);
#endif
        }
      } else {
        for (uint c = 0; c < CHANNELS; ++c) {
          for (uint lane = 0; lane < 8; ++lane) {
            float x = 0.0f;
            if (p + lane < texels) {
              x = (tile_load(values + (p + lane) * CHANNELS + c) - image_mean[c]) * scale;
            }
            out[c * NR + group + lane] = x;
#if SQUARES
            sum.s0 = fma(x, x, sum.s0);
#endif
          }
        }
      }
    }
  }
#if SQUARES
  const float4 four = sum.lo + sum.hi;
  squares[image * get_global_size(0) + block] = (four.x + four.y) + (four.z + four.w);
#endif
}
