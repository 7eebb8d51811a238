// Some of the channels of texels:
//
//   out[(first + p) K + k] = in[p C + list[k]]
//
//   in:   [count][CHANNELS]
//   out:  [...][KEPT]
//   list: [KEPT], indices below CHANNELS
//
// Work-item (chunk of CHUNK texels).
//
// CHANNELS  C
// KEPT      K
// CHUNK     texels of a chunk
#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef KEPT
#define KEPT 1
#endif
#ifndef CHUNK
#define CHUNK 1024
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void pick_channels(__global const float* restrict in, ulong count,
                            __global const uint* restrict list, ulong first,
                            __global float* restrict out) {
  const ulong begin = get_global_id(0) * CHUNK;
  const ulong end = min(begin + CHUNK, count);
  for (uint k = 0; k < KEPT; ++k) {
    const uint c = list[k];
    for (ulong p = begin; p < end; ++p) out[(first + p) * KEPT + k] = in[p * CHANNELS + c];
  }
}
