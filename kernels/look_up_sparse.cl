// Look-ups in sparse tensor decompositions (Ruiters & Klein 2009, section 4.3). A filtered value is
//
//   sum_{a,b} v_a w_b (sum_t u_t) mean[v_a, l_b, c]
//     + sum_j (sum_t u_t P[j, p_t]) sum_{a,b} v_a w_b sum_i V[i, v_a, j] L[c, l_b, i]
//
// j runs over the atoms of the texels' lists, which ascend and are merged on the way, so that an
// atom that several texels have in common is interpolated over the directions once.
//
//   texel_atoms:       [P][K2 + 1], the last entry of a list is END
//   texel_coefficients [P][K2]
//   view_atoms, view_coefficients: [D2][V][K1]
//   L:    [D1][lights][C4] vectors of 4 floats, C4 = ceil(C / 4), zero-padded;  mean: [V][lights][C4]
//   out:  [count][CHANNELS]
//
// Work-item (block of LOOKUPS look-ups). Macros beside those of look_up_record.cl:
//
// K1, K2  terms of a list
// MERGE   0: every texel by itself, to see what merging is worth
#include "look_up_record.cl"

#ifndef K1
#define K1 9
#endif
#ifndef K2
#define K2 11
#endif
#ifndef MERGE
#define MERGE 1
#endif

#define END 0xffffffffu
#define C4 ((CHANNELS + 3) / 4)

// What atom j is for the record's directions: channels [4 q, 4 q + 4).
inline float4 between_directions(__global const uint* record, ulong j, uint q, ulong views,
                                 ulong lights, __global const uint* view_atoms,
                                 __global const float* view_coefficients,
                                 __global const float* L) {
  __global const float* lit[LIGHTS];
  for (uint b = 0; b < LIGHTS; ++b) lit[b] = L + ((ulong)light_of(record, b) * C4 + q) * 4;
  float4 value = 0.0f;
  for (uint a = 0; a < VIEWS; ++a) {
    const ulong row = (j * views + view_of(record, a)) * K1;
    float4 sum[LIGHTS];
    for (uint b = 0; b < LIGHTS; ++b) sum[b] = 0.0f;
    for (uint i = 0; i < K1; ++i) {
      const ulong atom = (ulong)view_atoms[row + i] * lights * C4 * 4;
      const float4 coefficient = view_coefficients[row + i];
      for (uint b = 0; b < LIGHTS; ++b) sum[b] = fma(coefficient, vload4(0, lit[b] + atom), sum[b]);
    }
    float4 light = 0.0f;
    for (uint b = 0; b < LIGHTS; ++b) light = fma((float4)light_weight(record, b), sum[b], light);
    value = fma((float4)view_weight(record, a), light, value);
  }
  return value;
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_sparse(ulong count, ulong views, ulong lights,
                             __global const uint* restrict lookups,
                             __global const uint* restrict texel_atoms,
                             __global const float* restrict texel_coefficients,
                             __global const uint* restrict view_atoms,
                             __global const float* restrict view_coefficients,
                             __global const float* restrict L, __global const float* restrict mean,
                             __global float* restrict out) {
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong at = get_global_id(0) * LOOKUPS; at < end; ++at) {
    __global const uint* record = lookups + at * WORDS;
    float texels = 0.0f;
    for (uint t = 0; t < TEXELS; ++t) texels += texel_weight(record, t);
    for (uint q = 0; q < C4; ++q) {
      float4 sum = 0.0f;
      for (uint a = 0; a < VIEWS; ++a) {
        float4 light = 0.0f;
        for (uint b = 0; b < LIGHTS; ++b) {
          const ulong image = (ulong)view_of(record, a) * lights + light_of(record, b);
          light = fma((float4)light_weight(record, b), vload4(image * C4 + q, mean), light);
        }
        sum = fma((float4)view_weight(record, a), light, sum);
      }
      sum *= texels;
#if K2 == 0
      // nothing but the mean
#elif MERGE
      __global const uint* atoms[TEXELS];
      __global const float* coefficients[TEXELS];
      for (uint t = 0; t < TEXELS; ++t) {
        atoms[t] = texel_atoms + (ulong)texel_of(record, t) * (K2 + 1);
        coefficients[t] = texel_coefficients + (ulong)texel_of(record, t) * K2;
      }
      while (true) {
        uint j = END;
        for (uint t = 0; t < TEXELS; ++t) j = min(j, *atoms[t]);
        if (j == END) break;
        float coefficient = 0.0f;
        for (uint t = 0; t < TEXELS; ++t) {
          if (*atoms[t] != j) continue;
          coefficient = fma(texel_weight(record, t), *coefficients[t], coefficient);
          ++atoms[t];
          ++coefficients[t];
        }
        // a list's padding, or a texel of weight zero
        if (coefficient == 0.0f) continue;
        sum = fma((float4)coefficient,
                  between_directions(record, j, q, views, lights, view_atoms, view_coefficients, L),
                  sum);
      }
#else
      for (uint t = 0; t < TEXELS; ++t) {
        const ulong p = texel_of(record, t);
        for (uint n = 0; n < K2; ++n) {
          const float coefficient = texel_weight(record, t) * texel_coefficients[p * K2 + n];
          if (coefficient == 0.0f) continue;
          sum = fma((float4)coefficient,
                    between_directions(record, texel_atoms[p * (K2 + 1) + n], q, views, lights,
                                       view_atoms, view_coefficients, L),
                    sum);
        }
      }
#endif
      float channels[4];
      vstore4(sum, 0, channels);
      for (uint c = 4 * q; c < min(4 * q + 4, (uint)CHANNELS); ++c) {
        out[at * CHANNELS + c] = channels[c - 4 * q];
      }
    }
  }
}
