// What the machine can do: multiply-adds per second, and bytes copied per second.
//
// peak_fma: every work-item runs `rounds` rounds of twelve independent vector multiply-adds,
//   x <- x a + b,   2 * 12 * VW flops a round
// in named vectors, as the products hold them; the sum is written so that none is left out.
// Vectors are as wide as those of the products (VW). Work-item (any number); a is below 1, so that values stay finite.
//
// peak_copy: to[i] = from[i], vectors of 16 floats; a work-item copies `chunk` of them.
#include "vector_width.cl"

#define FOR_ALL(X) X(0) X(1) X(2) X(3) X(4) X(5) X(6) X(7) X(8) X(9) X(10) X(11)
#define DECLARE(i) realv x##i = (realv)(i) + start;
#define STEP(i) x##i = fma(x##i, a, b);
#define ADD(i) sum += x##i;

WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void peak_fma(ulong rounds, real factor, real offset, __global real* restrict out) {
  const realv a = factor, b = offset;
  real lanes[VW];
  for (uint lane = 0; lane < VW; ++lane) lanes[lane] = (real)0.1f * lane;
  const realv start = loadv(lanes);
  FOR_ALL(DECLARE)
  for (ulong round = 0; round < rounds; ++round) {
    FOR_ALL(STEP)
  }
  realv sum = 0;
  FOR_ALL(ADD)
  storev(sum, out + get_global_id(0) * VW);
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void peak_copy(ulong count, ulong chunk, __global const float* restrict from,
                        __global float* restrict to) {
  const ulong begin = get_global_id(0) * chunk;
  const ulong end = min(begin + chunk, count);
  for (ulong i = begin; i < end; ++i) vstore16(vload16(i, from), i, to);
}
