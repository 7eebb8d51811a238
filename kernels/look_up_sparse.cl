// Look-ups in sparse tensor decompositions (Ruiters & Klein 2009, section 4.3). A filtered value is
//
//   sum_{a,b} v_a w_b (sum_t u_t) mean[v_a, l_b, c]
//     + sum_j (sum_t u_t P[j, p_t]) sum_a v_a sum_i V[i, v_a, j] sum_b w_b L[c, l_b, i]
//
// j runs over the atoms of the texels' lists, one list after the other. With MERGE the lists, which
// ascend, are merged on the way, so that an atom that several texels have in common goes through the
// views' lists once. Dictionaries of up to some hundred atoms are blended between the lights first,
//
//   B[c, i] = sum_b w_b L[c, l_b, i]
//
// a few vector products however long the lists are, so that a term is one product of vectors from a
// cache, and nothing is stored. (Sums of coefficients s_i, scattered by the terms, would wait for
// their own stores.) Larger dictionaries are read light by light for every term.
//
//   texel_atoms, texel_coefficients: [P][K2 + 1], the last entry of a list is END, and 0
//   view_rows: [D2][V][ROW], K1 coefficients, then K1 indices of 16 bits, so that short lists take a
//         cache line each
//   L:    [lights][D1 rounded up to 4][C4] vectors of 4 floats, C4 = ceil(C / 4), zero-padded
//   mean: [V][lights][CHANNELS]
//   out:  [count][CHANNELS]
//
// Work-item (block of LOOKUPS look-ups). Macros beside those of look_up_record.cl:
//
// K1, K2  terms of a list
// ROW     floats of a row of the views
// ATOMS   D1 rounded up to 4
// BLEND   1: the dictionary is blended between the lights first
// MERGE   1: merge the texels' lists
#include "vector_width.cl"
#include "look_up_record.cl"

#ifndef K1
#define K1 9
#endif
#ifndef K2
#define K2 11
#endif
#ifndef ROW
#define ROW 16
#endif
#ifndef ATOMS
#define ATOMS 256
#endif
#ifndef BLEND
#define BLEND 1
#endif
#ifndef MERGE
#define MERGE 0
#endif

#define END 0xffffffffu
#define C4 ((CHANNELS + 3) / 4)

// What look-ups of one model have in common.
typedef struct {
  ulong views;
  ulong lights;
  __global const float* view_rows;
  __global const float* L;
} Model;

#define LIGHT_FLOATS (ATOMS * C4 * 4)

// What the terms read: as many lights as are left to be summed for each.
#if BLEND && LIGHTS > 1
#define ROWS 1
#else
#define ROWS LIGHTS
#endif

// Adds `coefficient` times ABRDF j, between the record's views, to the values of each row.
inline void add_abrdf(const Model* model, __global const uint* record, ulong j, float coefficient,
                      const float* blended, float4* values) {
  for (uint a = 0; a < VIEWS; ++a) {
    const float4 factor = coefficient * view_weight(record, a);
    __global const float* coefficients =
        model->view_rows + (j * model->views + view_of(record, a)) * ROW;
    __global const ushort* atoms = (__global const ushort*)(coefficients + K1);
    for (uint q = 0; q < C4; ++q) {
      for (uint b = 0; b < ROWS; ++b) {
#if BLEND && LIGHTS > 1
        const float* row = blended;
#else
        __global const float* row = model->L + (ulong)light_of(record, b) * LIGHT_FLOATS;
#endif
        float4 sum = 0.0f;
        for (uint i = 0; i < K1; ++i) {
          sum = fma((float4)coefficients[i], vload4(atoms[i] * C4 + q, row), sum);
        }
        values[q * ROWS + b] = fma(factor, sum, values[q * ROWS + b]);
      }
    }
  }
}

WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_sparse(ulong count, ulong views, ulong lights,
                             __global const uint* restrict lookups,
                             __global const uint* restrict texel_atoms,
                             __global const float* restrict texel_coefficients,
                             __global const float* restrict view_rows,
                             __global const float* restrict L, __global const float* restrict mean,
                             __global float* restrict out) {
  const Model model = {views, lights, view_rows, L};
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong at = get_global_id(0) * LOOKUPS; at < end; ++at) {
    __global const uint* record = lookups + at * WORDS;
    float4 values[C4 * ROWS];
    for (uint i = 0; i < C4 * ROWS; ++i) values[i] = 0.0f;
#if BLEND && LIGHTS > 1
    float blended[LIGHT_FLOATS];
    for (uint i = 0; i < LIGHT_FLOATS; i += 16) {
      float16 light = 0.0f;
      for (uint b = 0; b < LIGHTS; ++b) {
        const float16 row = vload16(0, L + (ulong)light_of(record, b) * LIGHT_FLOATS + i);
        light = fma((float16)light_weight(record, b), row, light);
      }
      vstore16(light, 0, blended + i);
    }
#else
    const float* blended = 0;
#endif
#if K2 == 0
    // nothing but the mean
#elif MERGE
    ulong next[TEXELS];  // the terms that are next
    float weight[TEXELS];
    for (uint t = 0; t < TEXELS; ++t) {
      next[t] = (ulong)texel_of(record, t) * (K2 + 1);
      weight[t] = texel_weight(record, t);
    }
    while (true) {
      uint j = END;
      for (uint t = 0; t < TEXELS; ++t) j = min(j, texel_atoms[next[t]]);
      if (j == END) break;
      // without branches, which nobody could predict
      float coefficient = 0.0f;
      for (uint t = 0; t < TEXELS; ++t) {
        const uint hit = texel_atoms[next[t]] == j;
        coefficient = fma(hit ? weight[t] : 0.0f, texel_coefficients[next[t]], coefficient);
        next[t] += hit;
      }
      // not a list's padding, nor a texel of weight zero
      if (coefficient != 0.0f) add_abrdf(&model, record, j, coefficient, blended, values);
    }
#else
    for (uint t = 0; t < TEXELS; ++t) {
      const ulong row = (ulong)texel_of(record, t) * (K2 + 1);
      for (uint n = 0; n < K2; ++n) {
        const float coefficient = texel_weight(record, t) * texel_coefficients[row + n];
        if (coefficient == 0.0f) continue;
        add_abrdf(&model, record, texel_atoms[row + n], coefficient, blended, values);
      }
    }
#endif
    float texels = 0.0f;
    for (uint t = 0; t < TEXELS; ++t) texels += texel_weight(record, t);
    for (uint c = 0; c < CHANNELS; ++c) {
      float sum = 0.0f;
      for (uint a = 0; a < VIEWS; ++a) {
        float light = 0.0f;
        for (uint b = 0; b < LIGHTS; ++b) {
          const ulong image = (ulong)view_of(record, a) * lights + light_of(record, b);
          light = fma(light_weight(record, b), mean[image * CHANNELS + c], light);
        }
        sum = fma(view_weight(record, a), light, sum);
      }
      float value = 0.0f;
      for (uint b = 0; b < ROWS; ++b) {
        const float weight = ROWS > 1 ? light_weight(record, b) : 1.0f;
        value = fma(weight, ((const float*)(values + c / 4 * ROWS + b))[c % 4], value);
      }
      out[at * CHANNELS + c] = fma(texels, sum, value);
    }
  }
}
