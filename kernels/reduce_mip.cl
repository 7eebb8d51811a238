// The next mip level of raw images: the averages of 2 x 2 texels in linear light, stored as they
// are. An odd last row or column averages what there is.
//
//   in:  [first_in + images][height][width][CHANNELS]
//   out: [first_out + images][ceil(height / 2)][ceil(width / 2)][CHANNELS]
//
// With NAN_ZERO, NaN and infinite values count as 0. Work-item (row of `out`, image).
//
// VALUE     type of the values: 0 U8, rounded to nearest; 1 F16; 2 F32
// ENCODING  encoding.cl
// CHANNELS  C
#include "tile_values.cl"
#include "encoding.cl"

#ifndef CHANNELS
#define CHANNELS 3
#endif

#if VALUE == 0
inline void raw_store(float x, __global raw_t* p) {
  *p = convert_uchar_sat_rte((x > 0.0f ? fmin(x, 1.0f) : 0.0f) * 255.0f);
}
#elif VALUE == 1
inline void raw_store(float x, __global raw_t* p) {
  vstore_half_rte(clamp(x, -65504.0f, 65504.0f), 0, p);
}
#else
inline void raw_store(float x, __global raw_t* p) { *p = x; }
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void reduce_mip(ulong height, ulong width, ulong first_in, ulong first_out,
                         __global const raw_t* restrict in, __global raw_t* restrict out) {
  const ulong rows = (height + 1) / 2, columns = (width + 1) / 2;
  const ulong y = get_global_id(0), image = get_global_id(1);
  __global const raw_t* above = in + ((first_in + image) * height + 2 * y) * width * CHANNELS;
  __global raw_t* row = out + ((first_out + image) * rows + y) * columns * CHANNELS;
  const ulong below = 2 * y + 1 < height ? width * CHANNELS : 0;  // the same row once more
  for (ulong x = 0; x < columns; ++x) {
    const ulong right = 2 * x + 1 < width ? CHANNELS : 0;
    for (uint c = 0; c < CHANNELS; ++c) {
      __global const raw_t* p = above + 2 * x * CHANNELS + c;
      const float sum = (to_linear(tile_load(p)) + to_linear(tile_load(p + right))) +
                        (to_linear(tile_load(p + below)) + to_linear(tile_load(p + below + right)));
      raw_store(from_linear(0.25f * sum), row + x * CHANNELS + c);
    }
  }
}
