// Images from nested code-books, in two steps: the values of every apparent BRDF of P4 in each image,
// then each texel's among them.
//
//   views, lights: places, [V] and [V L] (vq_books.cl)
//   entries: [images][S4][1 + COLOURS]
//   P6, c_P6: [texels]
//   channels: [CHANNELS], 0 for luminance, n for chromaticity n - 1
//   out:     [images][texels][CHANNELS], images [first, first + images) of the model
//
// vq_entries: work-item (block of BLOCK entries, image)
// vq_texels:  work-item (block of BLOCK texels, image)
//
// CHANNELS  C
// BLOCK     entries or texels that a work-item decodes
#include "vq_books.cl"

#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef BLOCK
#define BLOCK 64
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void vq_entries(BOOK_PARAMETERS, ulong lights_of_view, ulong first, ulong size,
                         __global const uint* restrict views, __global const uint* restrict lights,
                         __global float* restrict entries) {
  const Books books = BOOKS;
  const ulong image = first + get_global_id(1);
  uint view[PLACE_WORDS], light[PLACE_WORDS];
  load_place(views + image / lights_of_view * PLACE_WORDS, view);
  load_place(lights + image * PLACE_WORDS, light);
  __global float* out = entries + get_global_id(1) * size * (1 + COLOURS);
  const ulong end = min((get_global_id(0) + 1) * BLOCK, size);
  for (ulong j = get_global_id(0) * BLOCK; j < end; ++j) {
    float values[1 + COLOURS];
    entry_values(&books, (uint)j, view, light, values);
    for (uint i = 0; i <= COLOURS; ++i) out[j * (1 + COLOURS) + i] = values[i];
  }
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void vq_texels(ulong texels, ulong size, __global const uint* restrict P6,
                        __global const float* restrict c_P6, __global const uint* restrict channels,
                        __global const float* restrict entries, __global float* restrict out) {
  __global const float* from = entries + get_global_id(1) * size * (1 + COLOURS);
  __global float* to = out + get_global_id(1) * texels * CHANNELS;
  const ulong end = min((get_global_id(0) + 1) * BLOCK, texels);
  for (ulong p = get_global_id(0) * BLOCK; p < end; ++p) {
    __global const float* entry = from + (ulong)P6[p] * (1 + COLOURS);
    for (uint c = 0; c < CHANNELS; ++c) {
      const uint channel = channels[c];
      to[p * CHANNELS + c] = channel == 0 ? c_P6[p] * entry[0] : entry[channel];
    }
  }
}
