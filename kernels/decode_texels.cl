// Texels from factors: mean[c] + sum_{j < k} a[j] b[c][j] for a panel of NR texels of C channels at once,
// held in three vectors per channel. Included after vector_width.cl.
//
// CHANNELS  C
#ifndef CHANNELS
#define CHANNELS 3
#endif

// Texels [p, p + 8) of C channels, interleaved; `valid` of them exist.
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

// The same of a vector's texels.
inline void store_texels(const realv* channel, uint valid, __global float* out) {
#if VW == 8
  store_eight(channel, min(valid, 8u), out);
#else
  float8 eight[CHANNELS];
  for (uint c = 0; c < CHANNELS; ++c) eight[c] = channel[c].lo;
  store_eight(eight, min(valid, 8u), out);
  if (valid <= 8) return;
  for (uint c = 0; c < CHANNELS; ++c) eight[c] = channel[c].hi;
  store_eight(eight, min(valid - 8, 8u), out + 8 * CHANNELS);
#endif
}

// One channel of a panel.
#define CHANNEL(c)                                       \
  realv x##c = image_mean[c], y##c = x##c, z##c = x##c;

#define ADD(c)                      \
  {                                 \
    const realv t = b[(c) * k + j]; \
    x##c = fma(t, a0, x##c);        \
    y##c = fma(t, a1, y##c);        \
    z##c = fma(t, a2, z##c);        \
  }

// Texels [0, VW), [VW, 2 VW) and [2 VW, NR) in u, v and w. a: [k][NR], b: [CHANNELS][k].
inline void decode_texels(ulong k, __global const float* a, __global const float* b,
                          __global const float* image_mean, realv* u, realv* v, realv* w) {
#if CHANNELS == 3
  CHANNEL(0)
  CHANNEL(1)
  CHANNEL(2)
  for (ulong j = 0; j < k; ++j, a += NR) {
    const realv a0 = loadv(a), a1 = loadv(a + VW), a2 = loadv(a + 2 * VW);
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
    realv x = image_mean[c], y = x, z = x;
    for (ulong j = 0; j < k; ++j, a_channel += NR) {
      const realv t = b[c * k + j];
      x = fma(t, loadv(a_channel), x);
      y = fma(t, loadv(a_channel + VW), y);
      z = fma(t, loadv(a_channel + 2 * VW), z);
    }
    u[c] = x, v[c] = y, w[c] = z;
  }
#endif
}
