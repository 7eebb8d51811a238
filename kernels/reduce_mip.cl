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
  // Eight values of the row at a time: powers of vectors take a fraction of those of scalars.
  const ulong values = columns * CHANNELS;
  for (ulong first = 0; first < values; first += 8) {
    const uint count = (uint)min((ulong)8, values - first);
    float corners[4][8];
    for (uint lane = 0; lane < 8; ++lane) {
      const ulong i = first + min(lane, count - 1);
      const ulong x = i / CHANNELS;
      const ulong right = 2 * x + 1 < width ? CHANNELS : 0;
      __global const raw_t* p = above + i + x * CHANNELS;  // 2 x C + c
      corners[0][lane] = tile_load(p);
      corners[1][lane] = tile_load(p + right);
      corners[2][lane] = tile_load(p + below);
      corners[3][lane] = tile_load(p + below + right);
    }
    const float8 sum = (to_linear8(vload8(0, corners[0])) + to_linear8(vload8(0, corners[1]))) +
                       (to_linear8(vload8(0, corners[2])) + to_linear8(vload8(0, corners[3])));
    float means[8];
    vstore8(from_linear8(0.25f * sum), 0, means);
    for (uint lane = 0; lane < count; ++lane) raw_store(means[lane], row + first + lane);
  }
}
