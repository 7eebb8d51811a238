// Values clamped in place to what is physical:
//
//   values[i] = min(max(values[i], 0), largest)          NaN gives 0
//
// `largest` may be infinite. Work-item (chunk of CHUNK values).
//
// CHUNK   values of a chunk, a multiple of 8
#ifndef CHUNK
#define CHUNK 2048
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void clamp_values(__global float* values, ulong count, float largest) {
  const ulong begin = get_global_id(0) * CHUNK;
  const ulong end = min(begin + CHUNK, count);
  ulong i = begin;
  for (; i + 8 <= end; i += 8) {
    const float8 x = vload8(0, values + i);
    const float8 positive = select((float8)0.0f, x, x > 0.0f);
    vstore8(select(positive, (float8)largest, positive > largest), 0, values + i);
  }
  for (; i < end; ++i) {
    const float x = values[i] > 0.0f ? values[i] : 0.0f;
    values[i] = x > largest ? largest : x;
  }
}
