// Float values to a stored type, from one encoding to another:
//
//   out[i] = store(encode_TO(decode_FROM(in[i])))
//
// Encodings, continued to negative values as odd functions: 0 linear; 1 sRGB,
// u <= 0.04045 ? u / 12.92 : ((u + 0.055) / 1.055)^2.4; 2 gamma, u^2.2. Between equal encodings the
// value passes unchanged.
//
// Work-item (chunk of CHUNK values).
//
// FROM, TO  encodings
// OUT       0: U8, clamped to [0, 1] and rounded to nearest, NaN is 0; 1: F16, rounded to nearest
//           even, finite values clamped to +-65504; 2: F32
// CHUNK     values of a chunk, a multiple of 8
#ifndef FROM
#define FROM 0
#endif
#ifndef TO
#define TO 0
#endif
#ifndef OUT
#define OUT 2
#endif
#ifndef CHUNK
#define CHUNK 2048
#endif

// The curves on magnitudes u >= 0.
inline float8 decode(float8 x) {
#if FROM == TO || FROM == 0
  return x;
#else
  const float8 u = fabs(x);
#if FROM == 1
  const float8 power = pow((u + 0.055f) / 1.055f, (float8)2.4f);
  return copysign(select(power, u / 12.92f, u <= 0.04045f), x);
#else
  return copysign(pow(u, (float8)2.2f), x);
#endif
#endif
}

inline float8 encode(float8 x) {
#if FROM == TO || TO == 0
  return x;
#else
  const float8 u = fabs(x);
#if TO == 1
  const float8 power = 1.055f * pow(u, (float8)(1.0f / 2.4f)) - 0.055f;
  return copysign(select(power, u * 12.92f, u <= 0.0031308f), x);
#else
  return copysign(pow(u, (float8)(1.0f / 2.2f)), x);
#endif
#endif
}

#if OUT == 0
typedef uchar out_t;
// NaN gives 0, like what is below.
inline void store8(float8 x, __global out_t* p) {
  const float8 unit = fmin(select((float8)0.0f, x, x > 0.0f), 1.0f);
  vstore8(convert_uchar8_sat_rte(unit * 255.0f), 0, p);
}
inline void store1(float x, __global out_t* p) {
  *p = convert_uchar_sat_rte((x > 0.0f ? fmin(x, 1.0f) : 0.0f) * 255.0f);
}
#elif OUT == 1
typedef half out_t;
#define EXPONENT_BITS 0x7f800000
inline void store8(float8 x, __global out_t* p) {
  const int8 non_finite = (as_int8(x) & EXPONENT_BITS) == EXPONENT_BITS;
  vstore_half8_rte(select(clamp(x, -65504.0f, 65504.0f), x, non_finite), 0, p);
}
inline void store1(float x, __global out_t* p) {
  const int non_finite = (as_int(x) & EXPONENT_BITS) == EXPONENT_BITS;
  vstore_half_rte(non_finite ? x : clamp(x, -65504.0f, 65504.0f), 0, p);
}
#else
typedef float out_t;
inline void store8(float8 x, __global out_t* p) { vstore8(x, 0, p); }
inline void store1(float x, __global out_t* p) { *p = x; }
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void transcode_tile(__global const float* restrict in, ulong count,
                             __global out_t* restrict out) {
  ulong i = get_global_id(0) * CHUNK;
  const ulong end = min(i + CHUNK, count);
  for (; i + 8 <= end; i += 8) store8(encode(decode(vload8(0, in + i))), out + i);
  if (i < end) {
    float last[8] = {0, 0, 0, 0, 0, 0, 0, 0};
    for (uint lane = 0; i + lane < end; ++lane) last[lane] = in[i + lane];
    vstore8(encode(decode(vload8(0, last))), 0, last);
    for (uint lane = 0; i + lane < end; ++lane) store1(last[lane], out + i + lane);
  }
}
