// Look-ups in raw images: those of a run of images [first, first + images), added to what other runs
// gave.
//
//   out[i, c] += sum_{a,b: image in the run} v_a w_b sum_t u_t T[image, p_t, c]
//
//   image = v_a L + l_b; raw: [images][P][CHANNELS]; out: [count][CHANNELS], zero at first
//
// Views and lights are taken in ascending order of their indices, and runs come in ascending order,
// so that a sum is the same whatever the runs. With NAN_ZERO, NaN and infinite values count as 0.
//
// And look-ups in single values that came from elsewhere: their taps in the order [a][b][t], and the sum
// of these taps' values with the weights of the record.
//
// Work-item (block of LOOKUPS look-ups). Macros: look_up_record.cl, and VALUE of tile_values.cl.
#include "tile_values.cl"
#include "look_up_record.cl"

#if VALUE == 1
// The bits of a half: hardware conversions of single ones are not to be had everywhere.
typedef ushort texel_t;
inline float texel_value(__global const texel_t* p) {
  const uint bits = *p;
  const uint magnitude = bits & 0x7fff;
  const float value = as_float(magnitude << 13) * 0x1p112f;
  const float finite = magnitude >= 0x7c00 ? 0.0f : value;
  return bits & 0x8000 ? -finite : finite;
}
#else
typedef raw_t texel_t;
inline float texel_value(__global const texel_t* p) { return tile_load(p); }
#endif

#define TAP_WORDS (DIRECTIONS ? 7 : 3)

inline void sort_two(uint* index, float* weight, uint a, uint b) {
  if (index[a] <= index[b]) return;
  const uint i = index[a];
  const float w = weight[a];
  index[a] = index[b], weight[a] = weight[b];
  index[b] = i, weight[b] = w;
}

// Ascending, the weights of equal ones in the first of them.
inline void sort_taps(uint* index, float* weight, uint taps) {
  if (taps < 3) return;
  sort_two(index, weight, 0, 1);
  sort_two(index, weight, 1, 2);
  sort_two(index, weight, 0, 1);
  for (uint t = taps - 1; t > 0; --t) {
    if (index[t] != index[t - 1]) continue;
    weight[t - 1] += weight[t];
    weight[t] = 0.0f;
  }
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_raw(ulong count, ulong lights, ulong texels, ulong first, ulong images,
                          __global const uint* restrict lookups,
                          __global const texel_t* restrict raw, __global float* restrict out) {
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong i = get_global_id(0) * LOOKUPS; i < end; ++i) {
    __global const uint* record = lookups + i * WORDS;
    uint view[VIEWS], light[LIGHTS];
    float v[VIEWS], w[LIGHTS];
    for (uint a = 0; a < VIEWS; ++a) view[a] = view_of(record, a), v[a] = view_weight(record, a);
    for (uint b = 0; b < LIGHTS; ++b) light[b] = light_of(record, b), w[b] = light_weight(record, b);
    sort_taps(view, v, VIEWS);
    sort_taps(light, w, LIGHTS);
    float sums[CHANNELS];
    for (uint c = 0; c < CHANNELS; ++c) sums[c] = out[i * CHANNELS + c];
    for (uint a = 0; a < VIEWS; ++a) {
      for (uint b = 0; b < LIGHTS; ++b) {
        const ulong image = view[a] * lights + light[b];
        const float weight = v[a] * w[b];
        if (image < first || image - first >= images || weight == 0.0f) continue;
        __global const texel_t* values = raw + (image - first) * texels * CHANNELS;
        for (uint c = 0; c < CHANNELS; ++c) {
          float value = 0.0f;
          for (uint t = 0; t < TEXELS; ++t) {
            value = fma(texel_weight(record, t),
                        texel_value(values + (ulong)texel_of(record, t) * CHANNELS + c), value);
          }
          sums[c] = fma(weight, value, sums[c]);
        }
      }
    }
    for (uint c = 0; c < CHANNELS; ++c) out[i * CHANNELS + c] = sums[c];
  }
}

// taps[i, a, b, t] = (p_t, v_a, l_b) of look-ups [first, first + count): records of one tap each. Of
// directions, these are their vectors.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void expand_taps(ulong first, ulong count, __global const uint* restrict lookups,
                          __global uint* restrict taps) {
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong i = get_global_id(0) * LOOKUPS; i < end; ++i) {
    __global const uint* record = lookups + (first + i) * WORDS;
    __global uint* tap = taps + i * (VIEWS * LIGHTS * TEXELS * TAP_WORDS);
    for (uint a = 0; a < VIEWS; ++a) {
      for (uint b = 0; b < LIGHTS; ++b) {
        for (uint t = 0; t < TEXELS; ++t, tap += TAP_WORDS) {
          tap[0] = texel_of(record, t);
#if DIRECTIONS
          for (uint k = 0; k < 6; ++k) tap[1 + k] = record[TEXELS + k];
#else
          tap[1] = view_of(record, a);
          tap[2] = light_of(record, b);
#endif
        }
      }
    }
  }
}

// out[first + i, c] = sum_{a,b} v_a w_b sum_t u_t values[i, a, b, t, c], in this order. A tap of weight
// zero is not looked at.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void sum_taps(ulong first, ulong count, __global const uint* restrict lookups,
                       __global const float* restrict values, __global float* restrict out) {
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong i = get_global_id(0) * LOOKUPS; i < end; ++i) {
    __global const uint* record = lookups + (first + i) * WORDS;
    __global const float* tap = values + i * (VIEWS * LIGHTS * TEXELS * CHANNELS);
    float sums[CHANNELS];
    for (uint c = 0; c < CHANNELS; ++c) sums[c] = 0.0f;
    for (uint a = 0; a < VIEWS; ++a) {
      for (uint b = 0; b < LIGHTS; ++b, tap += TEXELS * CHANNELS) {
        const float weight = view_weight(record, a) * light_weight(record, b);
        if (weight == 0.0f) continue;
        for (uint c = 0; c < CHANNELS; ++c) {
          float value = 0.0f;
          for (uint t = 0; t < TEXELS; ++t) {
            const float u = texel_weight(record, t);
            if (u != 0.0f) value = fma(u, tap[t * CHANNELS + c], value);
          }
          sums[c] = fma(weight, value, sums[c]);
        }
      }
    }
    for (uint c = 0; c < CHANNELS; ++c) out[(first + i) * CHANNELS + c] = sums[c];
  }
}
