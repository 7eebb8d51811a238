// Texels of raw tiles, one vector per channel. Included behind tile_values.cl and vector_width.cl.
//
// CHANNELS  C
#ifndef CHANNELS
#define CHANNELS 3
#endif

#if ARITHMETIC == 64 && VALUE == 0
inline real8 load8(__global const raw_t* p) { return convert_double8(vload8(0, p)) / 255.0; }
inline real load(__global const raw_t* p) { return *p / 255.0; }
#else
inline real8 load8(__global const raw_t* p) { return convert_real8(tile_load8(p)); }
inline real load(__global const raw_t* p) { return tile_load(p); }
#endif

// Eight texels of the raw image.
inline void load_texels(__global const raw_t* values, real8* channel) {
#if CHANNELS == 1
  channel[0] = load8(values);
#elif CHANNELS == 3
  const real8 a = load8(values), b = load8(values + 8), c = load8(values + 16);
  channel[0] = (real8)(a.s0, a.s3, a.s6, b.s1, b.s4, b.s7, c.s2, c.s5);
  channel[1] = (real8)(a.s1, a.s4, a.s7, b.s2, b.s5, c.s0, c.s3, c.s6);
  channel[2] = (real8)(a.s2, a.s5, b.s0, b.s3, b.s6, c.s1, c.s4, c.s7);
#else
  for (uint c = 0; c < CHANNELS; ++c) {
    channel[c] = (real8)(load(values + c), load(values + CHANNELS + c),
                         load(values + 2 * CHANNELS + c), load(values + 3 * CHANNELS + c),
                         load(values + 4 * CHANNELS + c), load(values + 5 * CHANNELS + c),
                         load(values + 6 * CHANNELS + c), load(values + 7 * CHANNELS + c));
  }
#endif
}
