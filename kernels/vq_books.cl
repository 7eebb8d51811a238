// The code-books of multi-level vector quantisation, as lib/weft/model/vq.hpp has them, and the
// values of an apparent BRDF between their nodes (Havran et al., equation 4 and figure 6):
//
//   L = sum over the nodes round the place of their weight c_P4 c_P3 c_P2 P1(P2(M(k, 1), alpha), beta)
//   a = sum of their weight C(I1(I2(M(k, 2), alpha), beta))          k = P3(P4(j, phi), theta)
//
// A place is 2 x 6 words: of the view [phi low, high, theta low, high, two fractions], of the light
// in that view [alpha low, high, beta low, high, two fractions]. Fractions are floats; a node of
// weight zero is not looked at.
//
// COLOURS  chromaticities, C - 1 of the fitted channels
#ifndef COLOURS
#define COLOURS 2
#endif

#define PLACE_WORDS 6
#define PAIR (COLOURS > 0 ? 2 : 1)

typedef struct {
  uint n_phi, n_theta, n_alpha, n_beta;
  __global const uint* P4;
  __global const float* c_P4;
  __global const uint* P3;
  __global const float* c_P3;
  __global const uint* M;
  __global const uint* P2;
  __global const float* c_P2;
  __global const float* P1;
  __global const uint* I2;
  __global const uint* I1;
  __global const float* C;
} Books;

#define BOOK_PARAMETERS                                                                              \
  uint n_phi, uint n_theta, uint n_alpha, uint n_beta, __global const uint *restrict P4,             \
      __global const float *restrict c_P4, __global const uint *restrict P3,                         \
      __global const float *restrict c_P3, __global const uint *restrict M,                          \
      __global const uint *restrict P2, __global const float *restrict c_P2,                         \
      __global const float *restrict P1, __global const uint *restrict I2,                           \
      __global const uint *restrict I1, __global const float *restrict C
#define BOOKS {n_phi, n_theta, n_alpha, n_beta, P4, c_P4, P3, c_P3, M, P2, c_P2, P1, I2, I1, C}

// The weight of the low or the high node.
inline float node_weight(const uint* place, uint level, uint high) {
  const float fraction = as_float(place[4 + level]);
  return high ? fraction : 1.0f - fraction;
}

inline void load_place(__global const uint* from, uint* place) {
  for (uint i = 0; i < PLACE_WORDS; ++i) place[i] = from[i];
}

// values: [1 + COLOURS] of entry j of P4
inline void entry_values(const Books* books, uint j, const uint* view, const uint* light,
                         float* values) {
  for (uint i = 0; i <= COLOURS; ++i) values[i] = 0.0f;
  for (uint of_view = 0; of_view < 4; ++of_view) {
    const float view_weight =
        node_weight(view, 0, of_view >> 1) * node_weight(view, 1, of_view & 1);
    if (view_weight == 0.0f) continue;
    const ulong k4 = (ulong)j * books->n_phi + view[of_view >> 1];
    const ulong k3 = (ulong)books->P4[k4] * books->n_theta + view[2 + (of_view & 1)];
    const float scale = books->c_P4[k4] * books->c_P3[k3];
    const ulong pair = (ulong)books->P3[k3] * PAIR;
    for (uint of_light = 0; of_light < 4; ++of_light) {
      const float weight = view_weight * (node_weight(light, 0, of_light >> 1) *
                                          node_weight(light, 1, of_light & 1));
      if (weight == 0.0f) continue;
      const uint alpha = light[of_light >> 1];
      const uint beta = light[2 + (of_light & 1)];
      const ulong k2 = (ulong)books->M[pair] * books->n_alpha + alpha;
      const float slice = books->P1[(ulong)books->P2[k2] * books->n_beta + beta];
      values[0] = fma(weight, scale * books->c_P2[k2] * slice, values[0]);
#if COLOURS > 0
      const ulong slice_of_colours = books->I2[(ulong)books->M[pair + 1] * books->n_alpha + alpha];
      const ulong colour = (ulong)books->I1[slice_of_colours * books->n_beta + beta] * COLOURS;
      for (uint i = 0; i < COLOURS; ++i) {
        values[1 + i] = fma(weight, books->C[colour + i], values[1 + i]);
      }
#endif
    }
  }
}
