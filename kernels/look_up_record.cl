// A record of a look-up, as lib/weft/btf/lookup.hpp lays it out:
//
//   [ texels | views | lights | weights of each group of more than one ]
//   [ texels | view x, y, z | light x, y, z | weights of texels ]              DIRECTIONS
//
// TEXELS    1 or 4 texels
// VIEWS     1 or 3 views
// LIGHTS    1 or 3 lights
// DIRECTIONS  1: of one view and one light as vectors
// CHANNELS  C
// LOOKUPS   look-ups that a work-item does, one behind the other
// ORDERED   1: they are taken in the order of order_lookups.cl
#ifndef TEXELS
#define TEXELS 1
#endif
#ifndef VIEWS
#define VIEWS 1
#endif
#ifndef LIGHTS
#define LIGHTS 1
#endif
#ifndef DIRECTIONS
#define DIRECTIONS 0
#endif
#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef LOOKUPS
#define LOOKUPS 64
#endif

#ifndef ORDERED
#define ORDERED 0
#endif

#define TAPS (TEXELS + (DIRECTIONS ? 6 : VIEWS + LIGHTS))
#define TEXEL_WEIGHTS (TEXELS > 1 ? TEXELS : 0)
#define VIEW_WEIGHTS (VIEWS > 1 ? VIEWS : 0)
#define LIGHT_WEIGHTS (LIGHTS > 1 ? LIGHTS : 0)
#define WORDS (TAPS + TEXEL_WEIGHTS + VIEW_WEIGHTS + LIGHT_WEIGHTS)

// The number of a look-up that is the `at`-th.
inline ulong lookup_at(ulong first, ulong at, __global const uint* order) {
  return ORDERED ? first + order[at] : at;
}

inline uint texel_of(__global const uint* record, uint tap) { return record[tap]; }
inline uint view_of(__global const uint* record, uint tap) { return record[TEXELS + tap]; }
inline uint light_of(__global const uint* record, uint tap) { return record[TEXELS + VIEWS + tap]; }

// The view (0) or the light (1) of DIRECTIONS.
inline float3 direction_of(__global const uint* record, uint light) {
  return as_float3(vload3(0, record + TEXELS + 3 * light));
}

inline float texel_weight(__global const uint* record, uint tap) {
  return TEXELS > 1 ? as_float(record[TAPS + tap]) : 1.0f;
}
inline float view_weight(__global const uint* record, uint tap) {
  return VIEWS > 1 ? as_float(record[TAPS + TEXEL_WEIGHTS + tap]) : 1.0f;
}
inline float light_weight(__global const uint* record, uint tap) {
  return LIGHTS > 1 ? as_float(record[TAPS + TEXEL_WEIGHTS + VIEW_WEIGHTS + tap]) : 1.0f;
}

inline float sum8(float8 x) {
  const float4 four = x.lo + x.hi;
  const float2 two = four.lo + four.hi;
  return two.lo + two.hi;
}
