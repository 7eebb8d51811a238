// Sum of squares of a buffer, in chunks whose partial sums the host adds:
//
//   sums[chunk] = sum over i in chunk of values[i]^2
//
// Work-item (chunk of CHUNK values).
//
// CHUNK   values that a work-item sums, a multiple of 8
// DOUBLE  1: sums are double; 0 (no fp64): eight floats, of CHUNK / 8 terms each
#include "vector_width.cl"

#ifndef CHUNK
#define CHUNK 2048
#endif
#ifndef DOUBLE
#define DOUBLE 0
#endif

#if DOUBLE
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double sum_t;
typedef double8 sum8;
#define LOAD8(p) convert_double8(vload8(0, p))
#else
typedef float sum_t;
typedef float8 sum8;
#define LOAD8(p) vload8(0, p)
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void sum_squares(__global const real* restrict values, ulong count,
                          __global sum_t* restrict sums) {
  const ulong chunk = get_global_id(0);
  const ulong end = min((chunk + 1) * CHUNK, count);
  ulong i = chunk * CHUNK;
  sum8 sum = 0;
  for (; i + 8 <= end; i += 8) {
    const sum8 x = LOAD8(values + i);
    sum = fma(x, x, sum);
  }
  for (; i < end; ++i) sum.s0 = fma((sum_t)values[i], (sum_t)values[i], sum.s0);
  sums[chunk] = ((sum.s0 + sum.s4) + (sum.s2 + sum.s6)) + ((sum.s1 + sum.s5) + (sum.s3 + sum.s7));
}
