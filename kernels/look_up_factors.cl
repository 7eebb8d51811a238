// Look-ups in models that are products of factors: pca, view-pca and lpca. A filtered value is
//
//   sum_{t,a,b} u_t v_a w_b (mean[v_a, l_b, c] + sum_j A[p_t, j] B[v_a, l_b, c, j])
//     = (sum_t u_t) sum_{a,b} v_a w_b mean[v_a, l_b, c]
//       + sum_j (sum_t u_t A[p_t, j]) (sum_{a,b} v_a w_b B[v_a, l_b, c, j])
//
// so that the rows of each factor are combined first, and one product of length k is left: of 4
// texels, 3 views and 3 lights (9 C + 4 + C) k products and not 36 C k. Where A differs by view
// (view-pca) or B by texel (lpca), there is such a product for every view, or for every cluster
// that the texels lie in.
//
// Rows are K8 vectors of 8 floats, k of them and zeros. Bases of tables count these vectors.
//
//   out: [count][CHANNELS]
//
// Work-item (block of LOOKUPS look-ups). Macros: look_up_record.cl.
#include "look_up_record.cl"

#define IMAGES (VIEWS * LIGHTS)

// sums[c] += sum_j (sum_t u[t] A[a[t] + j]) (sum_i w[i] B[b[i] + c k8 + j])
inline void add_products(uint texels, const ulong* a, const float* u, uint images, const ulong* b,
                         const float* w, ulong k8, __global const float* A,
                         __global const float* B, float8* sums) {
  for (ulong j = 0; j < k8; ++j) {
    float8 row = u[0] * vload8(a[0] + j, A);
    for (uint t = 1; t < texels; ++t) row = fma((float8)u[t], vload8(a[t] + j, A), row);
    for (uint c = 0; c < CHANNELS; ++c) {
      float8 column = w[0] * vload8(b[0] + c * k8 + j, B);
      for (uint i = 1; i < images; ++i) {
        column = fma((float8)w[i], vload8(b[i] + c * k8 + j, B), column);
      }
      sums[c] = fma(row, column, sums[c]);
    }
  }
}

// A: [P][K8], B: [V L C][K8], mean: [V L C].
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_pca(ulong count, ulong lights, ulong k8, __global const uint* restrict lookups,
                          __global const float* restrict A, __global const float* restrict B,
                          __global const float* restrict mean, __global float* restrict out) {
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong i = get_global_id(0) * LOOKUPS; i < end; ++i) {
    __global const uint* record = lookups + i * WORDS;
    ulong a[TEXELS], image[IMAGES], b[IMAGES];
    float u[TEXELS], w[IMAGES];
    float8 sums[CHANNELS];
    float share = 0.0f;
    for (uint t = 0; t < TEXELS; ++t) {
      a[t] = texel_of(record, t) * k8;
      u[t] = texel_weight(record, t);
      share += u[t];
    }
    for (uint v = 0; v < VIEWS; ++v) {
      for (uint l = 0; l < LIGHTS; ++l) {
        const uint at = v * LIGHTS + l;
        image[at] = (view_of(record, v) * lights + light_of(record, l)) * CHANNELS;
        b[at] = image[at] * k8;
        w[at] = view_weight(record, v) * light_weight(record, l);
      }
    }
    for (uint c = 0; c < CHANNELS; ++c) sums[c] = 0.0f;
    add_products(TEXELS, a, u, IMAGES, b, w, k8, A, B, sums);
    for (uint c = 0; c < CHANNELS; ++c) {
      float value = w[0] * mean[image[0] + c];
      for (uint at = 1; at < IMAGES; ++at) value = fma(w[at], mean[image[at] + c], value);
      out[i * CHANNELS + c] = fma(share, value, sum8(sums[c]));
    }
  }
}

// Every view v has factors of its own: views[v] = {K8, base of A_v [P][K8], base of B_v [L C][K8]}.
// mean: [V L C].
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_view_pca(ulong count, ulong lights, __global const ulong* restrict views,
                               __global const uint* restrict lookups,
                               __global const float* restrict A, __global const float* restrict B,
                               __global const float* restrict mean, __global float* restrict out) {
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong i = get_global_id(0) * LOOKUPS; i < end; ++i) {
    __global const uint* record = lookups + i * WORDS;
    float8 sums[CHANNELS];
    float means[CHANNELS];
    for (uint c = 0; c < CHANNELS; ++c) sums[c] = 0.0f, means[c] = 0.0f;
    for (uint v = 0; v < VIEWS; ++v) {
      const ulong view = view_of(record, v);
      const ulong k8 = views[3 * view];
      ulong a[TEXELS], b[LIGHTS];
      float u[TEXELS], w[LIGHTS];
      float share = 0.0f;
      for (uint t = 0; t < TEXELS; ++t) {
        a[t] = views[3 * view + 1] + texel_of(record, t) * k8;
        u[t] = texel_weight(record, t);
        share += u[t];
      }
      for (uint l = 0; l < LIGHTS; ++l) {
        const ulong row = light_of(record, l) * CHANNELS;
        b[l] = views[3 * view + 2] + row * k8;
        w[l] = view_weight(record, v) * light_weight(record, l);
        for (uint c = 0; c < CHANNELS; ++c) {
          means[c] = fma(share * w[l], mean[view * lights * CHANNELS + row + c], means[c]);
        }
      }
      add_products(TEXELS, a, u, LIGHTS, b, w, k8, A, B, sums);
    }
    for (uint c = 0; c < CHANNELS; ++c) out[i * CHANNELS + c] = sum8(sums[c]) + means[c];
  }
}

// clusters: [P], the cluster of each texel; A: [P][K8]; of every cluster
// B: [V L C][K8] and mean: [V L C].
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_lpca(ulong count, ulong images, ulong lights, ulong k8,
                           __global const uint* restrict clusters,
                           __global const uint* restrict lookups,
                           __global const float* restrict A, __global const float* restrict B,
                           __global const float* restrict mean, __global float* restrict out) {
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong i = get_global_id(0) * LOOKUPS; i < end; ++i) {
    __global const uint* record = lookups + i * WORDS;
    float8 sums[CHANNELS];
    float means[CHANNELS];
    uint cluster[TEXELS];
    for (uint c = 0; c < CHANNELS; ++c) sums[c] = 0.0f, means[c] = 0.0f;
    for (uint t = 0; t < TEXELS; ++t) cluster[t] = clusters[texel_of(record, t)];
    for (uint t = 0; t < TEXELS; ++t) {
      // The texels of t's cluster at once, when its first comes.
      bool first = true;
      for (uint s = 0; s < t; ++s) first = first && cluster[s] != cluster[t];
      if (!first) continue;
      ulong a[TEXELS], b[IMAGES];
      float u[TEXELS], w[IMAGES];
      float share = 0.0f;
      for (uint s = 0; s < TEXELS; ++s) {
        a[s] = texel_of(record, s) * k8;
        u[s] = cluster[s] == cluster[t] ? texel_weight(record, s) : 0.0f;
        share += u[s];
      }
      const ulong base = cluster[t] * images;
      for (uint v = 0; v < VIEWS; ++v) {
        for (uint l = 0; l < LIGHTS; ++l) {
          const uint at = v * LIGHTS + l;
          const ulong row =
              (base + view_of(record, v) * lights + light_of(record, l)) * CHANNELS;
          b[at] = row * k8;
          w[at] = view_weight(record, v) * light_weight(record, l);
          for (uint c = 0; c < CHANNELS; ++c) {
            means[c] = fma(share * w[at], mean[row + c], means[c]);
          }
        }
      }
      add_products(TEXELS, a, u, IMAGES, b, w, k8, A, B, sums);
    }
    for (uint c = 0; c < CHANNELS; ++c) out[i * CHANNELS + c] = sum8(sums[c]) + means[c];
  }
}
