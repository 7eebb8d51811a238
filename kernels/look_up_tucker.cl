// Look-ups in Tucker models whose factors of texels and channels were multiplied into the core
// (Vasilescu & Terzopoulos 2004, eq. (9)). A filtered value is
//
//   sum_{t,a,b} u_t v_a w_b sum_{i,j} T[p_t, c, i, j] V[v_a, i] L[l_b, c, j]
//     = sum_{i,j} (sum_t u_t T[p_t, c, i, j]) (sum_a v_a V[v_a, i]) (sum_b w_b L[l_b, c, j])
//
// Where views and lights are one mode, L's rows are those of view and light, [V L], and V is 1.
//
//   T: [P][C][RANK_V][L8] vectors of 8 floats, C = 1 where channels are with the lights
//   V: [V][V8] vectors of 8;  L: [L or V L][channels with them][L8] vectors of 8
//   out: [count][CHANNELS]
//
// Work-item (block of LOOKUPS look-ups). Macros beside those of look_up_record.cl:
//
// RANK_V          rank of the views
// VIEWS_MERGED    1: views and lights are one mode
// LIGHT_CHANNELS  1: so are lights and channels
#include "look_up_record.cl"

#ifndef RANK_V
#define RANK_V 1
#endif
#ifndef VIEWS_MERGED
#define VIEWS_MERGED 0
#endif
#ifndef LIGHT_CHANNELS
#define LIGHT_CHANNELS 0
#endif

#if VIEWS_MERGED
#define ROWS (VIEWS * LIGHTS)
#else
#define ROWS LIGHTS
#endif
#define V8 ((RANK_V + 7) / 8)

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_tucker(ulong count, ulong lights, ulong l8, ulong first_lookup,
                             __global const uint* restrict order,
                             __global const uint* restrict lookups,
                             __global const float* restrict V, __global const float* restrict L,
                             __global const float* restrict T, __global float* restrict out) {
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong i = get_global_id(0) * LOOKUPS; i < end; ++i) {
    const ulong at = lookup_at(first_lookup, i, order);
    __global const uint* record = lookups + at * WORDS;
    // the row of views
    float v[RANK_V];
#if VIEWS_MERGED
    v[0] = 1.0f;
#else
    for (uint i = 0; i < RANK_V; ++i) {
      float sum = 0.0f;
      for (uint a = 0; a < VIEWS; ++a) {
        sum = fma(view_weight(record, a), V[(ulong)view_of(record, a) * V8 * 8 + i], sum);
      }
      v[i] = sum;
    }
#endif
    // rows of lights
    ulong row[ROWS];
    float w[ROWS];
    for (uint b = 0; b < LIGHTS; ++b) {
#if VIEWS_MERGED
      for (uint a = 0; a < VIEWS; ++a) {
        row[a * LIGHTS + b] = view_of(record, a) * lights + light_of(record, b);
        w[a * LIGHTS + b] = view_weight(record, a) * light_weight(record, b);
      }
#else
      row[b] = light_of(record, b);
      w[b] = light_weight(record, b);
#endif
    }
    for (uint c = 0; c < CHANNELS; ++c) {
      float8 sum = 0.0f;
      for (ulong j = 0; j < l8; ++j) {
        float8 light = 0.0f;
        for (uint b = 0; b < ROWS; ++b) {
#if LIGHT_CHANNELS
          light = fma((float8)w[b], vload8((row[b] * CHANNELS + c) * l8 + j, L), light);
#else
          light = fma((float8)w[b], vload8(row[b] * l8 + j, L), light);
#endif
        }
        float8 texel = 0.0f;
        for (uint t = 0; t < TEXELS; ++t) {
#if LIGHT_CHANNELS
          const ulong first = (ulong)texel_of(record, t) * RANK_V * l8 + j;
#else
          const ulong first = ((ulong)texel_of(record, t) * CHANNELS + c) * RANK_V * l8 + j;
#endif
          float8 views = 0.0f;
          for (uint i = 0; i < RANK_V; ++i) {
            views = fma((float8)v[i], vload8(first + i * l8, T), views);
          }
          texel = fma((float8)texel_weight(record, t), views, texel);
        }
        sum = fma(light, texel, sum);
      }
      out[at * CHANNELS + c] = sum8(sum);
    }
  }
}

// Look-ups in clustered tensor models whose slices are views (Tsai & Shih 2012, section 6.3.3), with
// the factors of texels and channels multiplied into the cores. Of a view only the rows of its
// MIXTURES clusters are not zero, and neighbouring views share clusters: a filtered value is
//
//   sum_{t,b} u_t w_b sum_c sum_{r,j} (sum_{a: c of v_a} v_a U_c[v_a, r]) T[p_t, ch, c, r, j] L_c[l_b, ch, j]
//
// with one product for each cluster c that any of the views has. L_c is L for all of them unless
// lights have a factor for each cluster.
//
//   clusters: [V][MIXTURES], U: [V][MIXTURES][RANK_V]
//   T: [P][C][clusters][RANK_V][L8] vectors of 8 floats, C = 1 where channels are with the lights
//   L: [1 or clusters][L][channels with them][L8] vectors of 8
//   out: [count][CHANNELS]
//
// Work-item (block of LOOKUPS look-ups). Macros beside those of look_up_record.cl:
//
// MIXTURES        clusters of each view
// RANK_V          rank of each cluster in the views
// LIGHT_CHANNELS  1: lights and channels are one mode
// LOCAL_LIGHTS    1: lights have a factor for each cluster
#ifndef MIXTURES
#define MIXTURES 1
#endif
#ifndef LOCAL_LIGHTS
#define LOCAL_LIGHTS 0
#endif

#if LIGHT_CHANNELS
#define LIGHT_ROWS CHANNELS
#else
#define LIGHT_ROWS 1
#endif

// Row of lights j of 8, filtered, for one cluster and channel.
inline float8 light_vector(__global const uint* record, __global const float* L, ulong base,
                           uint channel, ulong l8, ulong j) {
  float8 light = 0.0f;
  for (uint b = 0; b < LIGHTS; ++b) {
    const ulong row = base + light_of(record, b) * LIGHT_ROWS + (LIGHT_CHANNELS ? channel : 0);
    light = fma((float8)light_weight(record, b), vload8(row * l8 + j, L), light);
  }
  return light;
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_kcta(ulong count, ulong lights, ulong l8, ulong all_clusters,
                           ulong first_lookup, __global const uint* restrict order,
                           __global const uint* restrict lookups,
                           __global const uint* restrict clusters,
                           __global const float* restrict U, __global const float* restrict L,
                           __global const float* restrict T, __global float* restrict out) {
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong i = get_global_id(0) * LOOKUPS; i < end; ++i) {
    const ulong at = lookup_at(first_lookup, i, order);
    __global const uint* record = lookups + at * WORDS;
    // the clusters of all views, and what the views' rows add up to
    ulong own[VIEWS * MIXTURES];
    float v[VIEWS * MIXTURES][RANK_V];
    uint used = 0;
    for (uint a = 0; a < VIEWS; ++a) {
      const float weight = view_weight(record, a);
      for (uint k = 0; k < MIXTURES; ++k) {
        const ulong row = (ulong)view_of(record, a) * MIXTURES + k;
        const ulong cluster = clusters[row];
        uint s = 0;
        while (s < used && own[s] != cluster) ++s;
        if (s == used) {
          own[used++] = cluster;
          for (uint r = 0; r < RANK_V; ++r) v[s][r] = 0.0f;
        }
        for (uint r = 0; r < RANK_V; ++r) v[s][r] = fma(weight, U[row * RANK_V + r], v[s][r]);
      }
    }
    for (uint c = 0; c < CHANNELS; ++c) {
      float8 sum = 0.0f;
      for (ulong j = 0; j < l8; ++j) {
#if !LOCAL_LIGHTS
        const float8 light = light_vector(record, L, 0, c, l8, j);
        float8 all = 0.0f;
#endif
        for (uint s = 0; s < used; ++s) {
          float8 part = 0.0f;
          for (uint t = 0; t < TEXELS; ++t) {
            const ulong texel = (ulong)texel_of(record, t) * (LIGHT_CHANNELS ? 1 : CHANNELS) +
                                (LIGHT_CHANNELS ? 0 : c);
            const ulong first = (texel * all_clusters + own[s]) * RANK_V * l8 + j;
            float8 views = 0.0f;
            for (uint r = 0; r < RANK_V; ++r) {
              views = fma((float8)v[s][r], vload8(first + r * l8, T), views);
            }
            part = fma((float8)texel_weight(record, t), views, part);
          }
#if LOCAL_LIGHTS
          sum = fma(light_vector(record, L, own[s] * lights * LIGHT_ROWS, c, l8, j), part, sum);
#else
          all += part;
#endif
        }
#if !LOCAL_LIGHTS
        sum = fma(light, all, sum);
#endif
      }
      out[at * CHANNELS + c] = sum8(sum);
    }
  }
}
