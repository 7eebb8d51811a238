// Values of raw tiles as floats.
//
// VALUE     the stored type: 0 = U8 (scaled to [0, 1]), 1 = F16, 2 = F32
// NAN_ZERO  1: NaN and infinities are read as 0
#ifndef VALUE
#define VALUE 2
#endif
#ifndef NAN_ZERO
#define NAN_ZERO 0
#endif

#define EXPONENT_BITS 0x7f800000

// True in the lanes that are NaN or infinite. By bits: no compiler option can fold it away.
inline int8 non_finite8(float8 x) {
  return (as_int8(x) & (int8)EXPONENT_BITS) == (int8)EXPONENT_BITS;
}
inline int non_finite(float x) { return (as_int(x) & EXPONENT_BITS) == EXPONENT_BITS; }

#if VALUE == 0
typedef uchar raw_t;
inline float8 raw_load8(__global const raw_t* p) { return convert_float8(vload8(0, p)) / 255.0f; }
inline float raw_load(__global const raw_t* p) { return (float)*p / 255.0f; }
#elif VALUE == 1
typedef half raw_t;
inline float8 raw_load8(__global const raw_t* p) { return vload_half8(0, p); }
inline float raw_load(__global const raw_t* p) { return vload_half(0, p); }
#else
typedef float raw_t;
inline float8 raw_load8(__global const raw_t* p) { return vload8(0, p); }
inline float raw_load(__global const raw_t* p) { return *p; }
#endif

// The value as the codecs see it.
inline float8 tile_load8(__global const raw_t* p) {
  const float8 x = raw_load8(p);
#if NAN_ZERO
  return select(x, (float8)0.0f, non_finite8(x));
#else
  return x;
#endif
}
inline float tile_load(__global const raw_t* p) {
  const float x = raw_load(p);
#if NAN_ZERO
  return non_finite(x) ? 0.0f : x;
#else
  return x;
#endif
}
