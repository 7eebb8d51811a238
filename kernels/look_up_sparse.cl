// Look-ups in sparse tensor decompositions (Ruiters & Klein 2009, section 4.3). A filtered value is
//
//   sum_{a,b} v_a w_b (sum_t u_t) mean[v_a, l_b, c]
//     + sum_j (sum_t u_t P[j, p_t]) sum_a v_a sum_i V[i, v_a, j] sum_b w_b L[c, l_b, i]
//
// j runs over the atoms of the texels' lists, which ascend and are merged on the way, so that an
// atom that several texels have in common goes through the views' lists once. Dictionaries of up to
// some hundred atoms are summed into coefficients of their own first,
//
//   s_i = sum_j (sum_t u_t P[j, p_t]) sum_a v_a V[i, v_a, j]
//
// so that light and colour cost one vector product of s and the lights' rows, however long the lists
// are. Larger ones are read term by term.
//
//   texel_atoms, texel_coefficients: [P][K2 + 1], the last entry of a list is END, and 0
//   view_atoms, view_coefficients: [D2][V][K1]
//   L:    [lights][CHANNELS][ATOMS], zero-padded; of larger dictionaries [D1][lights][C4] vectors of 4
//         floats, C4 = ceil(C / 4), zero-padded
//   mean: [V][lights][CHANNELS]
//   out:  [count][CHANNELS]
//
// Work-item (block of LOOKUPS look-ups). Macros beside those of look_up_record.cl:
//
// K1, K2  terms of a list
// ATOMS   D1 rounded up to whole vectors of VW, or 0 for larger dictionaries
// MERGE   0: every texel by itself, to see what merging is worth
#include "vector_width.cl"
#include "look_up_record.cl"

#ifndef K1
#define K1 9
#endif
#ifndef K2
#define K2 11
#endif
#ifndef ATOMS
#define ATOMS 256
#endif
#ifndef MERGE
#define MERGE 1
#endif

#define END 0xffffffffu
#define C4 ((CHANNELS + 3) / 4)

#if VW == 16
#define SUM(x) sum8((x).lo + (x).hi)
#else
#define SUM(x) sum8(x)
#endif

// What look-ups of one model have in common.
typedef struct {
  ulong views;
  ulong lights;
  __global const uint* view_atoms;
  __global const float* view_coefficients;
  __global const float* L;
} Model;

#if ATOMS > 0

// Adds `coefficient` times ABRDF j, between the record's views, to s.
inline void add_abrdf(const Model* model, __global const uint* record, ulong j, float coefficient,
                      float* s) {
  for (uint a = 0; a < VIEWS; ++a) {
    const float factor = coefficient * view_weight(record, a);
    const ulong row = (j * model->views + view_of(record, a)) * K1;
    for (uint i = 0; i < K1; ++i) {
      const uint atom = model->view_atoms[row + i];
      s[atom] = fma(factor, model->view_coefficients[row + i], s[atom]);
    }
  }
}

// sum_i s_i sum_b w_b L[c, l_b, i].
inline float between_lights(const Model* model, __global const uint* record, uint c,
                            const float* s) {
  realv sum = 0.0f;
  for (uint i = 0; i < ATOMS; i += VW) {
    realv light = 0.0f;
    for (uint b = 0; b < LIGHTS; ++b) {
      const ulong row = ((ulong)light_of(record, b) * CHANNELS + c) * ATOMS;
      light = fma((realv)light_weight(record, b), loadv(model->L + row + i), light);
    }
    sum = fma(loadv(s + i), light, sum);
  }
  return SUM(sum);
}

#else

// Adds `coefficient` times ABRDF j, between the record's directions, to s, the channels' sums.
inline void add_abrdf(const Model* model, __global const uint* record, ulong j, float coefficient,
                      float* s) {
  for (uint q = 0; q < C4; ++q) {
    float4 value = 0.0f;
    for (uint a = 0; a < VIEWS; ++a) {
      const ulong row = (j * model->views + view_of(record, a)) * K1;
      float4 sum[LIGHTS];
      for (uint b = 0; b < LIGHTS; ++b) sum[b] = 0.0f;
      for (uint i = 0; i < K1; ++i) {
        const ulong atom = model->view_atoms[row + i] * model->lights;
        const float4 factor = model->view_coefficients[row + i];
        for (uint b = 0; b < LIGHTS; ++b) {
          sum[b] = fma(factor, vload4((atom + light_of(record, b)) * C4 + q, model->L), sum[b]);
        }
      }
      float4 light = 0.0f;
      for (uint b = 0; b < LIGHTS; ++b) light = fma((float4)light_weight(record, b), sum[b], light);
      value = fma((float4)view_weight(record, a), light, value);
    }
    vstore4(fma((float4)coefficient, value, vload4(q, s)), q, s);
  }
}

inline float between_lights(const Model* model, __global const uint* record, uint c,
                            const float* s) {
  return s[c];
}

#endif

WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_sparse(ulong count, ulong views, ulong lights,
                             __global const uint* restrict lookups,
                             __global const uint* restrict texel_atoms,
                             __global const float* restrict texel_coefficients,
                             __global const uint* restrict view_atoms,
                             __global const float* restrict view_coefficients,
                             __global const float* restrict L, __global const float* restrict mean,
                             __global float* restrict out) {
  const Model model = {views, lights, view_atoms, view_coefficients, L};
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong at = get_global_id(0) * LOOKUPS; at < end; ++at) {
    __global const uint* record = lookups + at * WORDS;
    float s[ATOMS > 0 ? ATOMS : 4 * C4];
    for (uint i = 0; i < sizeof(s) / sizeof(float); ++i) s[i] = 0.0f;
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
      if (coefficient != 0.0f) add_abrdf(&model, record, j, coefficient, s);
    }
#else
    for (uint t = 0; t < TEXELS; ++t) {
      const ulong row = (ulong)texel_of(record, t) * (K2 + 1);
      for (uint n = 0; n < K2; ++n) {
        const float coefficient = texel_weight(record, t) * texel_coefficients[row + n];
        if (coefficient != 0.0f) add_abrdf(&model, record, texel_atoms[row + n], coefficient, s);
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
      out[at * CHANNELS + c] = fma(texels, sum, between_lights(&model, record, c, s));
    }
  }
}
