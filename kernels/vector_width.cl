// The vector type that the CPU-shaped kernels are written in.
//
// VW  lanes of a vector: 8 or 16. Panels are NR = 3 VW columns wide.
#ifndef VW
#define VW 8
#endif
#define NR (3 * VW)

#if VW == 16
typedef float16 floatv;
#define loadv(p) vload16(0, p)
#define storev(x, p) vstore16(x, 0, p)
#else
typedef float8 floatv;
#define loadv(p) vload8(0, p)
#define storev(x, p) vstore8(x, 0, p)
#endif
