// Images with the channels first as images with the channels last:
//
//   from: [images][CHANNELS][texels]      to: [images][texels][CHANNELS]
//
// Work-item (block of TEXELS texels, image).
//
// CHANNELS  C
// TEXELS    texels of a work-item
#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef TEXELS
#define TEXELS 512
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void turn_channels(ulong texels, __global const float* restrict from,
                            __global float* restrict to) {
  const ulong begin = get_global_id(0) * TEXELS;
  const ulong end = min(begin + TEXELS, texels);
  const ulong image = get_global_id(1) * texels * CHANNELS;
  ulong p = begin;
#if CHANNELS == 3
  for (; p + 8 <= end; p += 8) {
    const float8 r = vload8(0, from + image + p);
    const float8 g = vload8(0, from + image + texels + p);
    const float8 b = vload8(0, from + image + 2 * texels + p);
    __global float* out = to + image + p * 3;
    vstore8((float8)(r.s0, g.s0, b.s0, r.s1, g.s1, b.s1, r.s2, g.s2), 0, out);
    vstore8((float8)(b.s2, r.s3, g.s3, b.s3, r.s4, g.s4, b.s4, r.s5), 0, out + 8);
    vstore8((float8)(g.s5, b.s5, r.s6, g.s6, b.s6, r.s7, g.s7, b.s7), 0, out + 16);
  }
#endif
  for (; p < end; ++p) {
    for (uint c = 0; c < CHANNELS; ++c) {
      to[image + p * CHANNELS + c] = from[image + c * texels + p];
    }
  }
}
