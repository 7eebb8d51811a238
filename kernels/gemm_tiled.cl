// General matrix product for GPUs:
//
//   C = alpha op(A) op(B) + beta C      op(A): M x K, op(B): K x N, all row-major
//
// A work-group of NDIMC x MDIMC work-items owns a tile of MWG x NWG of C. KWG columns of op(A) and rows
// of op(B) at a time are brought to local memory; a work-item multiplies (MWG / MDIMC) x (NWG / NDIMC)
// values in registers, in groups of VWM rows and vectors of VWN columns that lie apart:
//
//   row    = VWM (local_y + MDIMC (m / VWM)) + m % VWM
//   column = VWN (local_x + NDIMC n), a vector of VWN
//
// Tiles in local memory: [KWG][MWG + 1] of op(A), [KWG][NWG] of op(B); zero past the matrices' edges.
// Sums over K are blocked: those of KC products are added to C, so that float sums stay short.
//
// With TRIANGLE only that triangle of a square C is read and written, and tiles outside it end at once:
// with B = A and opposite transposes that is the product of a matrix with its own transpose.
//
// ARITHMETIC    32: float, 64: double
// A_TRANSPOSED  1: A is stored K x M; B_TRANSPOSED  1: B is stored N x K
// TRIANGLE      0: all of C, 1: columns up to the row, 2: columns from the row
// MWG NWG       rows and columns of a tile, multiples of MDIMC VWM and NDIMC VWN
// KWG           depth of a tile, a multiple of VWM and VWN
// MDIMC NDIMC   work-items of a work-group across rows and columns
// VWM VWN       lanes of vectors: 1, 2, 4 or 8
// KC            products of a block, a multiple of KWG
#include "vector_width.cl"

#ifndef A_TRANSPOSED
#define A_TRANSPOSED 0
#endif
#ifndef B_TRANSPOSED
#define B_TRANSPOSED 0
#endif
#ifndef TRIANGLE
#define TRIANGLE 0
#endif
#ifndef MWG
#define MWG 64
#endif
#ifndef NWG
#define NWG 64
#endif
#ifndef KWG
#define KWG 16
#endif
#ifndef MDIMC
#define MDIMC 16
#endif
#ifndef NDIMC
#define NDIMC 16
#endif
#ifndef VWM
#define VWM 1
#endif
#ifndef VWN
#define VWN 1
#endif
#ifndef KC
#define KC 512
#endif

#define MWI (MWG / MDIMC)
#define NVI (NWG / NDIMC / VWN)
#define ITEMS (MDIMC * NDIMC)
#define A_PITCH (MWG + 1)

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#if VWN == 1
typedef real realn;
#define LOAD_N(p) (*(p))
#define STORE_N(x, p) *(p) = x
#else
typedef JOIN(real, VWN) realn;
#define LOAD_N(p) JOIN(vload, VWN)(0, p)
#define STORE_N(x, p) JOIN(vstore, VWN)(x, 0, p)
#endif
#if VWM == 1
#define COPY_M(p, x) (x)[0] = *(p)
#else
#define COPY_M(p, x) JOIN(vstore, VWM)(JOIN(vload, VWM)(0, p), 0, x)
#endif
#if VWN == 1
#define COPY_N(p, x) (x)[0] = *(p)
#else
#define COPY_N(p, x) JOIN(vstore, VWN)(JOIN(vload, VWN)(0, p), 0, x)
#endif

// Brings X(i, k), i_begin <= i < i_end, k_begin <= k < k_end, to tile[k][i]. Neighbours in memory are
// neighbours along k (ALONG_K) or along i; LANES of them are read at once.
#define TILE_LOADER(NAME, WIDTH, PITCH, LANES, COPY, ALONG_K)                                        \
  inline void NAME(__local real* tile, __global const real* X, ulong leading, ulong i_begin,         \
                   ulong i_end, ulong k_begin, ulong k_end, uint item) {                             \
    for (uint at = item * LANES; at < WIDTH * KWG; at += ITEMS * LANES) {                            \
      const uint i = ALONG_K ? at / KWG : at % WIDTH;                                                \
      const uint k = ALONG_K ? at % KWG : at / WIDTH;                                                \
      const ulong row = i_begin + i, column = k_begin + k;                                           \
      const ulong count = ALONG_K ? (row < i_end && column < k_end ? k_end - column : 0)             \
                                  : (row < i_end && column < k_end ? i_end - row : 0);               \
      __global const real* from = X + (ALONG_K ? row * leading + column : column * leading + row);   \
      real x[LANES];                                                                                 \
      if (count >= LANES) {                                                                          \
        COPY(from, x);                                                                               \
      } else {                                                                                       \
        for (uint lane = 0; lane < LANES; ++lane) x[lane] = lane < count ? from[lane] : 0;           \
      }                                                                                              \
      for (uint lane = 0; lane < LANES; ++lane) {                                                    \
        tile[ALONG_K ? (k + lane) * PITCH + i : k * PITCH + i + lane] = x[lane];                     \
      }                                                                                              \
    }                                                                                                \
  }
TILE_LOADER(load_a, MWG, A_PITCH, VWM, COPY_M, !A_TRANSPOSED)
TILE_LOADER(load_b, NWG, NWG, VWN, COPY_N, B_TRANSPOSED)

// Work-group (tile of columns, tile of rows, matrix of the batch).
__attribute__((reqd_work_group_size(NDIMC, MDIMC, 1)))
__kernel void gemm_tiled(ulong M, ulong N, ulong K, real alpha, __global const real* restrict A,
                         ulong a_offset, ulong a_leading, ulong a_batch,
                         __global const real* restrict B, ulong b_offset, ulong b_leading,
                         ulong b_batch, real beta, __global real* restrict C, ulong c_offset,
                         ulong c_leading, ulong c_batch) {
  __local real a_tile[KWG * A_PITCH];
  __local real b_tile[KWG * NWG];
  const ulong i_begin = get_group_id(1) * MWG;
  const ulong j_begin = get_group_id(0) * NWG;
#if TRIANGLE == 1
  if (j_begin >= i_begin + MWG) return;
#elif TRIANGLE == 2
  if (i_begin >= j_begin + NWG) return;
#endif
  const uint x = get_local_id(0);
  const uint y = get_local_id(1);
  const uint item = y * NDIMC + x;
  const ulong batch = get_global_id(2);
  __global const real* a = A + a_offset + batch * a_batch;
  __global const real* b = B + b_offset + batch * b_batch;
  __global real* c = C + c_offset + batch * c_batch;

  for (ulong block = 0; block < K; block += KC) {
    const ulong block_end = min(block + KC, K);
    const real block_beta = block == 0 ? beta : 1;
    realn sum[MWI][NVI];
    for (uint m = 0; m < MWI; ++m) {
      for (uint n = 0; n < NVI; ++n) sum[m][n] = 0;
    }
    for (ulong k_begin = block; k_begin < block_end; k_begin += KWG) {
      load_a(a_tile, a, a_leading, i_begin, M, k_begin, block_end, item);
      load_b(b_tile, b, b_leading, j_begin, N, k_begin, block_end, item);
      barrier(CLK_LOCAL_MEM_FENCE);
      for (uint k = 0; k < KWG; ++k) {
        realn row[NVI];
#pragma unroll
        for (uint n = 0; n < NVI; ++n) {
          row[n] = LOAD_N(b_tile + k * NWG + VWN * (x + NDIMC * n));
        }
#pragma unroll
        for (uint m = 0; m < MWI; ++m) {
          const realn value = a_tile[k * A_PITCH + VWM * (y + MDIMC * (m / VWM)) + m % VWM];
#pragma unroll
          for (uint n = 0; n < NVI; ++n) sum[m][n] = fma(value, row[n], sum[m][n]);
        }
      }
      barrier(CLK_LOCAL_MEM_FENCE);
    }

#pragma unroll
    for (uint m = 0; m < MWI; ++m) {
      const ulong i = i_begin + VWM * (y + MDIMC * (m / VWM)) + m % VWM;
#pragma unroll
      for (uint n = 0; n < NVI; ++n) {
        const ulong j = j_begin + VWN * (x + NDIMC * n);
        // columns [first, last) of the vector are C's
        const ulong first = TRIANGLE == 2 ? (i > j ? i - j : 0) : 0;
        const ulong end = TRIANGLE == 1 ? min(i + 1, N) : N;
        const ulong last = i < M && j < end ? end - j : 0;
        __global real* out = c + i * c_leading + j;
        if (first == 0 && last >= VWN) {
          realn result = alpha * sum[m][n];
          if (block_beta != 0) result += block_beta * LOAD_N(out);
          STORE_N(result, out);
        } else {
          real lanes[VWN];
          STORE_N(sum[m][n], lanes);
          for (uint lane = (uint)min(first, (ulong)VWN); lane < VWN && lane < last; ++lane) {
            real result = alpha * lanes[lane];
            if (block_beta != 0) result += block_beta * out[lane];
            out[lane] = result;
          }
        }
      }
    }
  }
}
