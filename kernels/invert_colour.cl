// The inverse of a colour transform, in place on texels of C channels (btf/colour_transform.hpp):
//
//   KIND 0  linear  x = D t
//   KIND 1  log     x[c] = sgn(a) s (exp(min(|a|, LIMIT)) - 1),  a = t[c] / w[c]
//   KIND 2  logluv  Y of t[0] likewise, u' = t[1] / w[1] + u'_n, v' = t[2] / w[2] + v'_n, both
//                   clamped; x[c] = max(Y (k0[c] + (k1[c] u' + k2[c]) / v'), 0)
//
//   texels:  [count][CHANNELS]
//   numbers: KIND 0: D [C][C]; 1: 1 / w [C], s, LIMIT; 2: 1 / w [3], s, LIMIT, k [3][3], u'_n, v'_n,
//            lowest and highest u', lowest and highest v'
//
// Work-item (chunk of CHUNK texels).
//
// CHANNELS  C
// CHUNK     texels of a chunk, a multiple of 8
#ifndef KIND
#define KIND 0
#endif
#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef CHUNK
#define CHUNK 1024
#endif

#if KIND != 0
#define SCALE numbers[CHANNELS]
#define LIMIT numbers[CHANNELS + 1]

inline float8 signed_exp(float8 a, float scale, float limit) {
  // written so that a NaN stays one
  const float8 u = fabs(a);
  return copysign(scale * expm1(select(u, (float8)limit, u > limit)), a);
}
#endif

// Eight texels, one vector per channel.
inline void invert_eight(float8* channel, __global const float* numbers) {
#if KIND == 0
  float8 t[CHANNELS];
  for (uint c = 0; c < CHANNELS; ++c) t[c] = channel[c];
  for (uint c = 0; c < CHANNELS; ++c) {
    float8 sum = 0.0f;
    for (uint k = 0; k < CHANNELS; ++k) sum = fma(numbers[c * CHANNELS + k], t[k], sum);
    channel[c] = sum;
  }
#elif KIND == 1
  for (uint c = 0; c < CHANNELS; ++c) {
    channel[c] = signed_exp(channel[c] * numbers[c], SCALE, LIMIT);
  }
#else
  __global const float* k = numbers + 5;
  __global const float* bounds = numbers + 14;
  const float8 a = channel[0] * numbers[0];
  const float8 luminance = signed_exp(select(a, (float8)0.0f, a < 0.0f), SCALE, LIMIT);
  float8 u = channel[1] * numbers[1] + bounds[0];
  float8 v = channel[2] * numbers[2] + bounds[1];
  u = select(u, (float8)bounds[2], u < bounds[2]);
  u = select(u, (float8)bounds[3], u > bounds[3]);
  v = select(v, (float8)bounds[4], v < bounds[4]);
  v = select(v, (float8)bounds[5], v > bounds[5]);
  for (uint c = 0; c < 3; ++c) {
    const float8 x = luminance * (k[3 * c] + (k[3 * c + 1] * u + k[3 * c + 2]) / v);
    channel[c] = select(x, (float8)0.0f, x < 0.0f);
  }
#endif
}

// Texels [0, valid) of eight.
inline void load_eight(__global const float* in, uint valid, float8* channel) {
#if CHANNELS == 1
  if (valid == 8) {
    channel[0] = vload8(0, in);
    return;
  }
#elif CHANNELS == 3
  if (valid == 8) {
    const float8 a = vload8(0, in), b = vload8(1, in), c = vload8(2, in);
    channel[0] = (float8)(a.s0, a.s3, a.s6, b.s1, b.s4, b.s7, c.s2, c.s5);
    channel[1] = (float8)(a.s1, a.s4, a.s7, b.s2, b.s5, c.s0, c.s3, c.s6);
    channel[2] = (float8)(a.s2, a.s5, b.s0, b.s3, b.s6, c.s1, c.s4, c.s7);
    return;
  }
#endif
  for (uint c = 0; c < CHANNELS; ++c) {
    float lanes[8] = {0, 0, 0, 0, 0, 0, 0, 0};
    for (uint lane = 0; lane < valid; ++lane) lanes[lane] = in[lane * CHANNELS + c];
    channel[c] = vload8(0, lanes);
  }
}

inline void store_eight(const float8* channel, uint valid, __global float* out) {
#if CHANNELS == 1
  if (valid == 8) {
    vstore8(channel[0], 0, out);
    return;
  }
#elif CHANNELS == 3
  if (valid == 8) {
    const float8 r = channel[0], g = channel[1], b = channel[2];
    vstore8((float8)(r.s0, g.s0, b.s0, r.s1, g.s1, b.s1, r.s2, g.s2), 0, out);
    vstore8((float8)(b.s2, r.s3, g.s3, b.s3, r.s4, g.s4, b.s4, r.s5), 1, out);
    vstore8((float8)(g.s5, b.s5, r.s6, g.s6, b.s6, r.s7, g.s7, b.s7), 2, out);
    return;
  }
#endif
  for (uint c = 0; c < CHANNELS; ++c) {
    float lanes[8];
    vstore8(channel[c], 0, lanes);
    for (uint lane = 0; lane < valid; ++lane) out[lane * CHANNELS + c] = lanes[lane];
  }
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void invert_colour(__global float* texels, ulong count,
                            __global const float* restrict numbers) {
  const ulong begin = get_global_id(0) * CHUNK;
  const ulong end = min(begin + CHUNK, count);
  for (ulong i = begin; i < end; i += 8) {
    const uint valid = (uint)min(end - i, (ulong)8);
    float8 channel[CHANNELS];
    load_eight(texels + i * CHANNELS, valid, channel);
    invert_eight(channel, numbers);
    store_eight(channel, valid, texels + i * CHANNELS);
  }
}
