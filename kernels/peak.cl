// What the machine can do: multiply-adds per second, and bytes copied per second.
//
// peak_fma: every work-item runs `rounds` rounds of twelve independent vector multiply-adds,
//   x <- x a + b,   2 * 12 * 8 flops a round
// in named vectors, as the products hold them; the sum is written so that none is left out.
// Work-item (any number); a is below 1, so that values stay finite.
//
// peak_copy: to[i] = from[i], vectors of 16 floats; a work-item copies `chunk` of them.
#define FOR_ALL(X) X(0) X(1) X(2) X(3) X(4) X(5) X(6) X(7) X(8) X(9) X(10) X(11)
#define DECLARE(i) float8 x##i = (float8)(i) + start;
#define STEP(i) x##i = fma(x##i, a, b);
#define ADD(i) sum += x##i;

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void peak_fma(ulong rounds, float factor, float offset, __global float* restrict out) {
  const float8 a = factor, b = offset;
  const float8 start = (float8)(0.0f, 0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f);
  FOR_ALL(DECLARE)
  for (ulong round = 0; round < rounds; ++round) {
    FOR_ALL(STEP)
  }
  float8 sum = 0.0f;
  FOR_ALL(ADD)
  vstore8(sum, get_global_id(0), out);
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void peak_copy(ulong count, ulong chunk, __global const float* restrict from,
                        __global float* restrict to) {
  const ulong begin = get_global_id(0) * chunk;
  const ulong end = min(begin + chunk, count);
  for (ulong i = begin; i < end; ++i) vstore16(vload16(i, from), i, to);
}
