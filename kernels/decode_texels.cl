// Texels from factors: mean[c] + sum_{j < k} a[j] b[c][j] for 24 texels of C channels at once, held in
// three vectors per channel. Included after vector_width.cl.
//
// CHANNELS  C
#ifndef CHANNELS
#define CHANNELS 3
#endif

// Texels [p, p + 8) of C channels, interleaved; `valid` of them exist.
inline void store_texels(const float8* channel, uint valid, __global float* out) {
#if CHANNELS == 1
  if (valid == 8) {
    vstore8(channel[0], 0, out);
    return;
  }
#elif CHANNELS == 3
  if (valid == 8) {
    const float8 r = channel[0], g = channel[1], b = channel[2];
    vstore8((float8)(r.s0, g.s0, b.s0, r.s1, g.s1, b.s1, r.s2, g.s2), 0, out);
    vstore8((float8)(b.s2, r.s3, g.s3, b.s3, r.s4, g.s4, b.s4, r.s5), 0, out + 8);
    vstore8((float8)(g.s5, b.s5, r.s6, g.s6, b.s6, r.s7, g.s7, b.s7), 0, out + 16);
    return;
  }
#endif
  for (uint c = 0; c < CHANNELS; ++c) {
    float lanes[8];
    vstore8(channel[c], 0, lanes);
    for (uint lane = 0; lane < valid; ++lane) out[lane * CHANNELS + c] = lanes[lane];
  }
}

// One channel of 24 texels.
#define CHANNEL(c)                                        \
  float8 x##c = image_mean[c], y##c = x##c, z##c = x##c;

#define ADD(c)                       \
  {                                  \
    const float8 t = b[(c) * k + j]; \
    x##c = fma(t, a0, x##c);         \
    y##c = fma(t, a1, y##c);         \
    z##c = fma(t, a2, z##c);         \
  }

// Texels [0, 8), [8, 16) and [16, 24) in u, v and w. a: [k][NR], b: [CHANNELS][k].
inline void decode_texels(ulong k, __global const float* a, __global const float* b,
                          __global const float* image_mean, float8* u, float8* v, float8* w) {
#if CHANNELS == 3
  CHANNEL(0)
  CHANNEL(1)
  CHANNEL(2)
  for (ulong j = 0; j < k; ++j, a += NR) {
    const float8 a0 = vload8(0, a), a1 = vload8(0, a + 8), a2 = vload8(0, a + 16);
    ADD(0)
    ADD(1)
    ADD(2)
  }
  u[0] = x0, u[1] = x1, u[2] = x2;
  v[0] = y0, v[1] = y1, v[2] = y2;
  w[0] = z0, w[1] = z1, w[2] = z2;
#else
  for (uint c = 0; c < CHANNELS; ++c) {
    __global const float* a_channel = a;
    float8 x = image_mean[c], y = x, z = x;
    for (ulong j = 0; j < k; ++j, a_channel += NR) {
      const float8 t = b[c * k + j];
      x = fma(t, vload8(0, a_channel), x);
      y = fma(t, vload8(0, a_channel + 8), y);
      z = fma(t, vload8(0, a_channel + 16), z);
    }
    u[c] = x, v[c] = y, w[c] = z;
  }
#endif
}
