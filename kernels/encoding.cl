// Stored values to linear light and back, one at a time or eight, continued to negative values as
// odd functions.
//
// ENCODING  0 linear; 1 sRGB, u <= 0.04045 ? u / 12.92 : ((u + 0.055) / 1.055)^2.4; 2 gamma, u^2.2
#ifndef ENCODING
#define ENCODING 0
#endif

inline float to_linear(float x) {
#if ENCODING == 0
  return x;
#else
  const float u = fabs(x);
#if ENCODING == 1
  return copysign(u <= 0.04045f ? u / 12.92f : pow((u + 0.055f) / 1.055f, 2.4f), x);
#else
  return copysign(pow(u, 2.2f), x);
#endif
#endif
}

inline float from_linear(float x) {
#if ENCODING == 0
  return x;
#else
  const float u = fabs(x);
#if ENCODING == 1
  return copysign(u <= 0.0031308f ? u * 12.92f : 1.055f * pow(u, 1.0f / 2.4f) - 0.055f, x);
#else
  return copysign(pow(u, 1.0f / 2.2f), x);
#endif
#endif
}

inline float8 to_linear8(float8 x) {
#if ENCODING == 0
  return x;
#else
  const float8 u = fabs(x);
#if ENCODING == 1
  const float8 above = powr((u + 0.055f) / 1.055f, (float8)2.4f);
  return copysign(select(above, u / 12.92f, u <= 0.04045f), x);
#else
  return copysign(powr(u, (float8)2.2f), x);
#endif
#endif
}

inline float8 from_linear8(float8 x) {
#if ENCODING == 0
  return x;
#else
  const float8 u = fabs(x);
#if ENCODING == 1
  const float8 above = 1.055f * powr(u, (float8)(1.0f / 2.4f)) - 0.055f;
  return copysign(select(above, u * 12.92f, u <= 0.0031308f), x);
#else
  return copysign(powr(u, (float8)(1.0f / 2.2f)), x);
#endif
#endif
}
