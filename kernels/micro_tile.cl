// The micro-tile of the CPU-shaped products: MR rows x NR columns of C in named vectors, three of VW
// lanes a row, which the compiler keeps in registers. Needs vector_width.cl.
//
//   UNROLL              before a loop over k that multiplies
//   DECLARE(r)          row r of the tile, zero
//   MULTIPLY(r, value)  adds value (b0 b1 b2), the panel's row k
//   MULTIPLY_PAIR       the same with b0 and b1 alone, for tiles of at most 2 VW columns
//   MULTIPLY_NARROW     with b0 alone, for at most VW columns
//   STORE(r)            c = alpha tile + block_beta c with c = c_tile + r c_row, where r < rows
//   STORE_EDGE(r)       the same for the first `columns` columns
//
// MR  rows of a micro-tile: 4, or 8 for a device with 32 vector registers
#ifndef MR
#define MR 4
#endif
#if MR == 8
#define FOR_ROWS(X) X(0) X(1) X(2) X(3) X(4) X(5) X(6) X(7)
#else
#define FOR_ROWS(X) X(0) X(1) X(2) X(3)
#endif

// Clang can't unroll around eight rows, and would warn of every attempt on standard error.
#if MR == 4
#define UNROLL _Pragma("unroll 4")
#else
#define UNROLL
#endif

#define DECLARE(r) realv x##r = 0, y##r = 0, z##r = 0;

#define MULTIPLY(r, value)     \
  {                            \
    const realv t = value;     \
    x##r = fma(t, b0, x##r);   \
    y##r = fma(t, b1, y##r);   \
    z##r = fma(t, b2, z##r);   \
  }

#define MULTIPLY_PAIR(r, value) \
  {                             \
    const realv t = value;      \
    x##r = fma(t, b0, x##r);    \
    y##r = fma(t, b1, y##r);    \
  }
#define MULTIPLY_NARROW(r, value) x##r = fma((realv)(value), b0, x##r);

#define STORE(r)                                                           \
  if (r < rows) {                                                          \
    __global real* c = c_tile + r * c_row;                                 \
    if (block_beta == 0.0f) {                                              \
      storev(alpha * x##r, c);                                             \
      storev(alpha * y##r, c + VW);                                        \
      storev(alpha * z##r, c + 2 * VW);                                    \
    } else {                                                               \
      storev(alpha * x##r + block_beta * loadv(c), c);                     \
      storev(alpha * y##r + block_beta * loadv(c + VW), c + VW);           \
      storev(alpha * z##r + block_beta * loadv(c + 2 * VW), c + 2 * VW);   \
    }                                                                      \
  }

#define STORE_EDGE(r)                                                                    \
  if (r < rows) {                                                                        \
    __global real* c = c_tile + r * c_row;                                               \
    real row[NR];                                                                        \
    storev(x##r, row);                                                                   \
    storev(y##r, row + VW);                                                              \
    storev(z##r, row + 2 * VW);                                                          \
    for (uint j = 0; j < columns; ++j) {                                                 \
      c[j] = block_beta == 0.0f ? alpha * row[j] : alpha * row[j] + block_beta * c[j];   \
    }                                                                                    \
  }
