// Raw texels of many images as a row-major tensor of floats, channels last as they are stored or
// first:
//
//   raw:   [images][raw_texels][CHANNELS], of which texels [first, first + texels) are taken
//   tile:  [images][texels][CHANNELS]                                    CHANNELS_FIRST 0
//          [images][CHANNELS][texels]                                    CHANNELS_FIRST 1
//   tile = T scale
//
// CHANNELS        C
// CHANNELS_FIRST  see above
// TEXELS          texels that a work-item takes, a multiple of 8
#include "tile_values.cl"
#include "vector_width.cl"
#include "tile_texels.cl"

#ifndef CHANNELS_FIRST
#define CHANNELS_FIRST 0
#endif
#ifndef TEXELS
#define TEXELS 1024
#endif

// Work-item (block of TEXELS texels, image).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void unfold_tile(__global const raw_t* restrict raw, ulong raw_texels, ulong first,
                          ulong texels, float scale, __global float* restrict tile) {
  const ulong image = get_global_id(1);
  const ulong p_begin = get_global_id(0) * TEXELS;
  const ulong p_end = min(p_begin + TEXELS, texels);
  __global const raw_t* from = raw + (image * raw_texels + first) * CHANNELS;
#if CHANNELS_FIRST
  __global float* to = tile + image * CHANNELS * texels;
  ulong p = p_begin;
  for (; p + 8 <= p_end; p += 8) {
    real8 channel[CHANNELS];
    load_texels(from + p * CHANNELS, channel);
    for (uint c = 0; c < CHANNELS; ++c) vstore8(channel[c] * scale, 0, to + c * texels + p);
  }
  for (; p < p_end; ++p) {
    for (uint c = 0; c < CHANNELS; ++c) to[c * texels + p] = load(from + p * CHANNELS + c) * scale;
  }
#else
  __global float* to = tile + image * texels * CHANNELS;
  const ulong end = p_end * CHANNELS;
  ulong i = p_begin * CHANNELS;
  for (; i + 8 <= end; i += 8) vstore8(load8(from + i) * scale, 0, to + i);
  for (; i < end; ++i) to[i] = load(from + i) * scale;
#endif
}
