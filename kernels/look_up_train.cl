// Look-ups in tensor trains. With the channels' core in the middle, a filtered value is
//
//   value[c] = u G_c w        u = the product of the slices before it, w^T = of those behind it
//
// where the slice of a view or a light is that between measured ones, sum_a v_a G[:, v_a, :]: the
// chain is linear in each slice. Texels are one tap at a time, since theirs are two slices: u or w is
// the weighted sum over the taps; where both hold one of the texels' modes, the value is.
//
// Steps: on either side from the outermost core inwards, [left_steps + right_steps][4] ulongs
//   {mode, length of the vector that comes in, vectors of 8 of that which goes out, core's offset}
// mode: 0 view, 1 light, 2 row, 3 column. Cores are [index][in][out], so that a step multiplies a row
// vector by a matrix; `out` is padded with zeros to whole vectors of 8 floats. The channels' core is
// [CHANNELS][left][right], likewise.
//
//   out: [count][CHANNELS]
//
// A work-item does LOOKUPS look-ups one behind the other, and keeps u with its products u G_c, or
// w, while what it is made of stays: sorted look-ups are faster, and have the same bits. Work-item (block of LOOKUPS look-ups).
// Macros: look_up_record.cl, and
//
// LONGEST  the longest vector, a multiple of 8
#include "look_up_record.cl"

#ifndef LONGEST
#define LONGEST 64
#endif

// Vector k of `in` times a slice [length][out8] of vectors.
inline float8 column(const float* in, ulong length, __global const float* slice, ulong out8,
                     ulong k) {
  float8 x = 0, y = 0, z = 0, w = 0;
  ulong a = 0;
  for (; a + 4 <= length; a += 4) {
    x = fma((float8)in[a], vload8(a * out8 + k, slice), x);
    y = fma((float8)in[a + 1], vload8((a + 1) * out8 + k, slice), y);
    z = fma((float8)in[a + 2], vload8((a + 2) * out8 + k, slice), z);
    w = fma((float8)in[a + 3], vload8((a + 3) * out8 + k, slice), w);
  }
  for (; a < length; ++a) x = fma((float8)in[a], vload8(a * out8 + k, slice), x);
  return (x + y) + (z + w);
}

// to = weight (in slice) + (add ? to : 0). Four vectors at a time: the slice is read line by line.
inline void multiply(const float* in, ulong length, __global const float* slice, ulong out8,
                     float weight, bool add, float* to) {
  ulong k = 0;
  for (; k + 4 <= out8; k += 4) {
    float8 x = 0, y = 0, z = 0, w = 0;
    __global const float* row = slice + k * 8;
    for (ulong a = 0; a < length; ++a, row += out8 * 8) {
      const float8 t = in[a];
      x = fma(t, vload8(0, row), x);
      y = fma(t, vload8(1, row), y);
      z = fma(t, vload8(2, row), z);
      w = fma(t, vload8(3, row), w);
    }
    x *= weight, y *= weight, z *= weight, w *= weight;
    if (add) {
      x += vload8(k, to), y += vload8(k + 1, to), z += vload8(k + 2, to), w += vload8(k + 3, to);
    }
    vstore8(x, k, to), vstore8(y, k + 1, to), vstore8(z, k + 2, to), vstore8(w, k + 3, to);
  }
  for (; k < out8; ++k) {
    float8 x = weight * column(in, length, slice, out8, k);
    if (add) x += vload8(k, to);
    vstore8(x, k, to);
  }
}

// The chain of `steps` for one tap of the texels; returns which of the two vectors it ends in.
inline uint chain(__global const ulong* steps, uint count, __global const float* cores,
                  __global const uint* record, uint texel, ulong width, float vectors[2][LONGEST]) {
  uint from = 0;
  // A side without cores is a vector of one; what pads it meets zeros, and must not be NaN.
  vstore8((float8)(1.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f), 0, vectors[0]);
  for (uint s = 0; s < count; ++s, from = 1 - from) {
    const uint mode = (uint)steps[4 * s];
    const ulong length = steps[4 * s + 1], out8 = steps[4 * s + 2];
    __global const float* core = cores + steps[4 * s + 3];
    const ulong slice = length * out8 * 8;
    if (mode == 0) {
      for (uint v = 0; v < VIEWS; ++v) {
        multiply(vectors[from], length, core + view_of(record, v) * slice, out8,
                 view_weight(record, v), v > 0, vectors[1 - from]);
      }
    } else if (mode == 1) {
      for (uint l = 0; l < LIGHTS; ++l) {
        multiply(vectors[from], length, core + light_of(record, l) * slice, out8,
                 light_weight(record, l), l > 0, vectors[1 - from]);
      }
    } else {
      const ulong p = texel_of(record, texel);
      multiply(vectors[from], length, core + (mode == 2 ? p / width : p % width) * slice, out8, 1.0f,
               false, vectors[1 - from]);
    }
  }
  return from;
}

// u or w: the chain for texels [texel, texel + taps), summed with their weights if they are several.
inline void side(__global const ulong* steps, uint count, __global const float* cores,
                 __global const uint* record, uint texel, uint taps, ulong width, ulong end8,
                 float* to) {
  float vectors[2][LONGEST];
  for (uint t = 0; t < taps; ++t) {
    const uint end = chain(steps, count, cores, record, texel + t, width, vectors);
    const float weight = taps > 1 ? texel_weight(record, t) : 1.0f;
    for (ulong k = 0; k < end8; ++k) {
      const float8 part = vload8(k, vectors[end]);
      vstore8(t == 0 ? weight * part : fma((float8)weight, part, vload8(k, to)), k, to);
    }
  }
}

// Whether two records agree in what `groups` takes.
inline bool agree(__global const uint* one, __global const uint* other, uint groups) {
  bool same = true;
  if (groups & 1) {
    for (uint i = 0; i < TEXELS; ++i) same = same && one[i] == other[i];
    for (uint i = 0; i < TEXEL_WEIGHTS; ++i) same = same && one[TAPS + i] == other[TAPS + i];
  }
  if (groups & 2) {
    for (uint i = 0; i < VIEWS; ++i) same = same && one[TEXELS + i] == other[TEXELS + i];
    for (uint i = 0; i < VIEW_WEIGHTS; ++i) {
      same = same && one[TAPS + TEXEL_WEIGHTS + i] == other[TAPS + TEXEL_WEIGHTS + i];
    }
  }
  if (groups & 4) {
    for (uint i = 0; i < LIGHTS; ++i) {
      same = same && one[TEXELS + VIEWS + i] == other[TEXELS + VIEWS + i];
    }
    for (uint i = 0; i < LIGHT_WEIGHTS; ++i) {
      same = same && one[TAPS + TEXEL_WEIGHTS + VIEW_WEIGHTS + i] ==
                         other[TAPS + TEXEL_WEIGHTS + VIEW_WEIGHTS + i];
    }
  }
  return same;
}

// left, right: ranks of the channels' core; width: X; channel_core: its offset. left_groups,
// right_groups: what the sides take, 1 texels, 2 views, 4 lights.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_train(ulong count, ulong first_lookup, ulong width, uint left_steps, uint right_steps,
                            uint left_groups, uint right_groups, ulong left, ulong right,
                            ulong channel_core,
                            __global const ulong* restrict steps,
                            __global const float* restrict cores,
                            __global const uint* restrict order,
                            __global const uint* restrict lookups, __global float* restrict out) {
  const ulong begin = get_global_id(0) * LOOKUPS;
  const ulong end = min(begin + LOOKUPS, count);
  const ulong left8 = (left + 7) / 8, right8 = (right + 7) / 8;
  // Where both sides have modes of the texels, taps of texels are summed at the very end.
  const uint split = (TEXELS > 1 ? 1 : 0) & left_groups & right_groups;
  const uint left_taps = ((left_groups & 1) ^ split) ? TEXELS : 1;
  const uint right_taps = ((right_groups & 1) ^ split) ? TEXELS : 1;
  float u[LONGEST], w[LONGEST];
  float products[CHANNELS][LONGEST];  // u G_c
  for (uint k = 0; k < LONGEST; ++k) u[k] = 0.0f, w[k] = 0.0f;
  __global const uint* before = lookups;
  for (ulong i = begin; i < end; ++i) {
    const ulong at = lookup_at(first_lookup, i, order);
    __global const uint* record = lookups + at * WORDS;
    float values[CHANNELS];
    for (uint c = 0; c < CHANNELS; ++c) values[c] = 0.0f;
    for (uint t = 0; t < (split ? TEXELS : 1); ++t) {
      const bool again = !split && i > begin;
      if (!(again && agree(record, before, left_groups))) {
        side(steps, left_steps, cores, record, t, left_taps, width, left8, u);
        for (uint c = 0; c < CHANNELS; ++c) {
          multiply(u, left, cores + channel_core + c * left * right8 * 8, right8, 1.0f, false,
                   products[c]);
        }
      }
      if (!(again && agree(record, before, right_groups))) {
        side(steps + 4 * left_steps, right_steps, cores, record, t, right_taps, width, right8, w);
      }
      for (uint c = 0; c < CHANNELS; ++c) {
        float8 sum = 0;
        for (ulong k = 0; k < right8; ++k) sum = fma(vload8(k, products[c]), vload8(k, w), sum);
        values[c] += (split ? texel_weight(record, t) : 1.0f) * sum8(sum);
      }
    }
    for (uint c = 0; c < CHANNELS; ++c) out[at * CHANNELS + c] = values[c];
    before = record;
  }
}
