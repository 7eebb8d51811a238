// The arithmetic and the vectors that the CPU-shaped kernels are written in.
//
// ARITHMETIC  32: real is float; 64: real is double
// VW  lanes of a vector: 8 or 16 floats, 4 or 8 doubles. Panels are NR = 3 VW columns wide.
#ifndef ARITHMETIC
#define ARITHMETIC 32
#endif
#ifndef VW
#if ARITHMETIC == 32
#define VW 8
#else
#define VW 4
#endif
#endif
#define NR (3 * VW)

#if ARITHMETIC == 64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double real;
typedef double2 real2;
typedef double4 real4;
typedef double8 real8;
typedef double16 real16;
#define convert_real8(x) convert_double8(x)
#else
typedef float real;
typedef float2 real2;
typedef float4 real4;
typedef float8 real8;
typedef float16 real16;
#define convert_real8(x) (x)
#endif

#if VW == 4
typedef real4 realv;
#define loadv(p) vload4(0, p)
#define storev(x, p) vstore4(x, 0, p)
#elif VW == 8
typedef real8 realv;
#define loadv(p) vload8(0, p)
#define storev(x, p) vstore8(x, 0, p)
#else
typedef real16 realv;
#define loadv(p) vload16(0, p)
#define storev(x, p) vstore16(x, 0, p)
#endif

// Clang halves vectors of 512 bits unless the function asks for them.
#if VW * ARITHMETIC == 512 && defined(__has_attribute)
#if __has_attribute(min_vector_width)
#define WIDE_VECTORS __attribute__((min_vector_width(512)))
#endif
#endif
#ifndef WIDE_VECTORS
#define WIDE_VECTORS
#endif
