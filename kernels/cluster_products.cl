// What a clustering of texels into local subspaces is fitted with: sums and products over the texels
// of each cluster, and the nearest subspace of each texel.
//
//   a_p = the rows of texel p, in image-channel rows r      mu_g, B_g: cluster g's mean and basis
//   |a_p - mu_g|^2 - |B_g^T (a_p - mu_g)|^2                  squared distance of p from g
//
// Texels sorted by cluster fill whole panels, as in decode_lpca.cl:
//
//   order:  [panels][NR]       the texel in each slot
//   panels: [panels][2]        a panel's cluster, and how many of its slots are texels
//   first:  [G + 1]            the first panel of each cluster, and the end
//
// A tile is some rows of all texels, [ceil(P / NR)][rows][NR], in texel or in sorted order. Products
// go to one matrix per cluster:
//
//   W: [G][n_padded][ld]       columns j < k: sum over the cluster's texels of (a_p - mu_g) U[p, j];
//                              column k: mu_g
//
// BLOCK    panels whose products are summed before they are added to the rest: float sums stay short
// ROWS     rows that a work-item sorts and centres
// VECTORS  groups of eight texels that a work-item assigns
#include "vector_width.cl"

#ifndef BLOCK
#define BLOCK 32
#endif
#ifndef ROWS
#define ROWS 8
#endif
#ifndef VECTORS
#define VECTORS 8
#endif

inline float sum8(float8 x) {
  const float4 four = x.lo + x.hi;
  return (four.x + four.y) + (four.z + four.w);
}

// Sorts a tile's texels by cluster and removes the mean of each cluster, which becomes column k of W;
// padding is zero. squares[r][g]: sum of the squares of what is left. A texel's rows are near each
// other in the tile, and gathered together. Work-item (cluster, ROWS rows).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void centre_clusters(ulong rows, ulong first_row, ulong clusters, ulong n_padded, ulong ld,
                              ulong k, __global const uint* restrict order,
                              __global const uint* restrict panels, __global const uint* restrict first,
                              __global const float* restrict tile, __global float* restrict sorted,
                              __global float* restrict W, __global float* restrict squares) {
  const ulong g = get_global_id(0);
  const ulong row = get_global_id(1) * ROWS;
  const uint row_count = (uint)min((ulong)ROWS, rows - row);
  __global const float* in = tile + row * NR;
  float means[ROWS], sums[ROWS];
  for (uint r = 0; r < ROWS; ++r) sums[r] = 0.0f;
  // gather, and sum block by block
  uint size = 0;
  for (ulong block = first[g]; block < first[g + 1]; block += BLOCK) {
    const ulong end = min(block + BLOCK, (ulong)first[g + 1]);
    float8 part[ROWS];
    for (uint r = 0; r < ROWS; ++r) part[r] = 0.0f;
    for (ulong panel = block; panel < end; ++panel) {
      __global const uint* slots = order + panel * NR;
      const uint valid = panels[2 * panel + 1];
      ulong offsets[NR];
      for (uint slot = 0; slot < NR; ++slot) {
        const uint p = slots[slot];
        offsets[slot] = (ulong)(p / NR) * rows * NR + p % NR;
      }
      __global float* out = sorted + (panel * rows + row) * NR;
      for (uint r = 0; r < row_count; ++r) {
        float lanes[NR];
        for (uint slot = 0; slot < NR; ++slot) lanes[slot] = in[offsets[slot] + r * NR];
        for (uint slot = valid; slot < NR; ++slot) lanes[slot] = 0.0f;
        for (uint slot = 0; slot < NR; slot += 8) {
          const float8 x = vload8(0, lanes + slot);
          vstore8(x, 0, out + r * NR + slot);
          part[r] += x;
        }
      }
      size += valid;
    }
    for (uint r = 0; r < row_count; ++r) sums[r] += sum8(part[r]);
  }
  for (uint r = 0; r < row_count; ++r) {
    means[r] = size > 0 ? sums[r] / (float)size : 0.0f;
    W[(g * n_padded + first_row + row + r) * ld + k] = means[r];
    sums[r] = 0.0f;
  }
  // centre
  for (ulong block = first[g]; block < first[g + 1]; block += BLOCK) {
    const ulong end = min(block + BLOCK, (ulong)first[g + 1]);
    float8 part[ROWS];
    for (uint r = 0; r < ROWS; ++r) part[r] = 0.0f;
    for (ulong panel = block; panel < end; ++panel) {
      const int valid = (int)panels[2 * panel + 1];
      __global float* out = sorted + (panel * rows + row) * NR;
      for (uint r = 0; r < row_count; ++r) {
        for (uint slot = 0; slot < NR; slot += 8) {
          const int8 lane = (int8)(0, 1, 2, 3, 4, 5, 6, 7) + (int8)(int)slot;
          const float8 centred = vload8(0, out + r * NR + slot) - means[r];
          const float8 x = select((float8)0.0f, centred, lane < (int8)valid);
          vstore8(x, 0, out + r * NR + slot);
          part[r] = fma(x, x, part[r]);
        }
      }
    }
    for (uint r = 0; r < row_count; ++r) sums[r] += sum8(part[r]);
  }
  for (uint r = 0; r < row_count; ++r) squares[(first_row + row + r) * clusters + g] = sums[r];
}

#define FOR_PAIRS(X)                                                                    \
  X(0, 0) X(0, 1) X(0, 2) X(1, 0) X(1, 1) X(1, 2) X(2, 0) X(2, 1) X(2, 2) X(3, 0) X(3, 1) X(3, 2)
#define FOR_ROWS(X) X(0) X(1) X(2) X(3)
#define TOTAL(r, j) float total##r##j = 0.0f;
#define PART(r, j) float8 s##r##j = 0.0f;
#define LOAD(r) const float8 t##r = vload8(0, tile_row##r + at * NR + slot);
#define ADD(r, j) s##r##j = fma(t##r, u##j, s##r##j);
#define FLUSH(r, j) total##r##j += sum8(s##r##j);
#define STORE(r, j) \
  if (r < row_count && j < column_count) out[r * ld + j] = total##r##j;

// Columns j < k of W from a sorted tile and U: [panels][k][NR], zero in padding. Work-item (cluster,
// four rows).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void project_clusters(ulong rows, ulong first_row, ulong n_padded, ulong ld, ulong k,
                               __global const uint* restrict first, __global const float* restrict sorted,
                               __global const float* restrict U, __global float* restrict W) {
  const ulong g = get_global_id(0);
  const ulong row = get_global_id(1) * 4;
  const uint row_count = (uint)min((ulong)4, rows - row);
  // Rows past the last repeat it: computed, but not stored.
  __global const float* tile_row0 = sorted + row * NR;
  __global const float* tile_row1 = tile_row0 + (row_count > 1 ? NR : 0);
  __global const float* tile_row2 = tile_row1 + (row_count > 2 ? NR : 0);
  __global const float* tile_row3 = tile_row2 + (row_count > 3 ? NR : 0);
  for (ulong column = 0; column < k; column += 3) {
    const uint column_count = (uint)min((ulong)3, k - column);
    const ulong step1 = column_count > 1 ? NR : 0;
    const ulong step2 = step1 + (column_count > 2 ? NR : 0);
    FOR_PAIRS(TOTAL)
    for (ulong block = first[g]; block < first[g + 1]; block += BLOCK) {
      const ulong end = min(block + BLOCK, (ulong)first[g + 1]);
      FOR_PAIRS(PART)
      for (ulong panel = block; panel < end; ++panel) {
        const ulong at = panel * rows;
        __global const float* u = U + (panel * k + column) * NR;
        for (uint slot = 0; slot < NR; slot += 8) {
          const float8 u0 = vload8(0, u + slot);
          const float8 u1 = vload8(0, u + step1 + slot);
          const float8 u2 = vload8(0, u + step2 + slot);
          FOR_ROWS(LOAD)
          FOR_PAIRS(ADD)
        }
      }
      FOR_PAIRS(FLUSH)
    }
    __global float* out = W + (g * n_padded + first_row + row) * ld + column;
    FOR_PAIRS(STORE)
  }
}

// squares[p] += sum over the rows of a tile in texel order of a^2; begins with zero at the first
// row. Work-item (panel).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void add_texel_squares(ulong rows, ulong first_row, __global const float* restrict tile,
                                __global float* restrict squares) {
  const ulong panel = get_global_id(0);
  for (uint slot = 0; slot < NR; slot += 8) {
    __global const float* in = tile + panel * rows * NR + slot;
    __global float* out = squares + panel * NR + slot;
    float8 sum = 0.0f;
    for (ulong row = 0; row < rows; ++row) {
      const float8 x = vload8(0, in + row * NR);
      sum = fma(x, x, sum);
    }
    vstore8(first_row == 0 ? sum : sum + vload8(0, out), 0, out);
  }
}

// Each texel's nearest subspace, and its coefficients there.
//
//   scores:  [G (k + 1)][leading]    b_gj . a_p, and mu_g . a_p behind them
//   offsets: [G (k + 1)]             b_gj . mu_g, and |mu_g|^2 behind them
//   squares: [leading]               |a_p|^2
//   label:   [leading]               the cluster, before and after: a texel stays where it is unless
//                                    another is nearer by more than `margin` |a_p|^2
//   error:   [leading]               squared distance from it, 0 where that is below the margin
//   coefficients: [leading][k]       b_gj . (a_p - mu_g)
//
// Work-item (8 VECTORS texels).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void assign_clusters(ulong clusters, ulong k, ulong leading, float margin,
                              __global const float* restrict scores, __global const float* restrict offsets,
                              __global const float* restrict squares, __global uint* restrict label,
                              __global float* restrict error, __global float* restrict coefficients) {
  const ulong begin = get_global_id(0) * 8 * VECTORS;
  const uint count = (uint)min((ulong)VECTORS, (leading - begin) / 8);
  float8 least[VECTORS], own_distance[VECTORS], distance[VECTORS];
  uint8 own[VECTORS], nearest[VECTORS];
  for (uint v = 0; v < count; ++v) {
    own[v] = nearest[v] = vload8(0, label + begin + 8 * v);
    least[v] = own_distance[v] = INFINITY;
  }
  for (ulong g = 0; g < clusters; ++g) {
    __global const float* offset = offsets + g * (k + 1);
    __global const float* score = scores + g * (k + 1) * leading + begin;
    // offset[k] is infinite for a cluster that nothing may be put into
    for (uint v = 0; v < count; ++v) {
      distance[v] = offset[k] - 2.0f * vload8(0, score + k * leading + 8 * v);
    }
    for (ulong j = 0; j < k; ++j) {
      for (uint v = 0; v < count; ++v) {
        const float8 c = vload8(0, score + j * leading + 8 * v) - offset[j];
        distance[v] = fma(-c, c, distance[v]);
      }
    }
    for (uint v = 0; v < count; ++v) {
      const int8 nearer = distance[v] < least[v];
      least[v] = select(least[v], distance[v], nearer);
      nearest[v] = select(nearest[v], (uint8)(uint)g, nearer);
      own_distance[v] = select(own_distance[v], distance[v], own[v] == (uint8)(uint)g);
    }
  }
  for (uint v = 0; v < count; ++v) {
    const ulong p = begin + 8 * v;
    const float8 square = vload8(0, squares + p);
    const int8 moves = least[v] < own_distance[v] - margin * square;
    const uint8 chosen = select(own[v], nearest[v], moves);
    const float8 squared = square + select(own_distance[v], least[v], moves);
    vstore8(chosen, 0, label + p);
    vstore8(squared > margin * square ? squared : (float8)0.0f, 0, error + p);
    uint lanes[8];
    vstore8(chosen, 0, lanes);
    for (uint lane = 0; lane < 8; ++lane) {
      const ulong row = lanes[lane] * (k + 1);
      for (ulong j = 0; j < k; ++j) {
        coefficients[(p + lane) * k + j] = scores[(row + j) * leading + p + lane] - offsets[row + j];
      }
    }
  }
}
