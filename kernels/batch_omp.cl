// Orthogonal matching pursuit of many signals in one dictionary: for each signal y at most k unit
// atoms d_n, chosen one by one by the largest |c_n|, c = D r, and their least squares coefficients.
//
//   units:   [A][dimension_p]     d_n = atom / norm; zero rows are never chosen. A: atoms padded to a
//                                 whole number of ITEMS BLOCK VW, dimension_p: to one of VW
//   inverse: [A]                  1 / norm
//   scales:  [signals]            2^-e, which brings a signal's largest magnitude near 1
//   energies:[signals]            |2^-e y|^2; 0 or NaN: the signal gets no atoms
//
// With the atoms' inner products G = D D^T (Rubinstein, Zibulevsky, Elad 2008), code_by_gram never
// sees a residual. In place of their progressive Cholesky factorisation, which solves two triangular
// systems per step, the chosen atoms are orthogonalised in Gram space, without square roots:
//
//   l_tj = q_j[n_t] / p_j,   p_t = G[n_t][n_t] - sum_(j<t) l_tj^2 p_j
//   q_t  = G[n_t] - sum_(j<t) l_tj q_j             inner products of all atoms with the part of d_(n_t)
//                                                  that is orthogonal to those before
//   a_t  = c[n_t] / p_t,     c -= a_t q_t,     |r|^2 -= a_t^2 p_t
//
// and x follows from a by one substitution at the end: a_j -= x_t l_tj. The largest |c| of the next
// step is found while c is updated. Signals that float arithmetic can't follow so are marked by a
// count of RECODE: their residual fell below 1e-3 of their norm, an atom is nearly in the span of
// those before (p_t < LEAST_PIVOT), or correlations are mere rounding.
//
// step_by_residual takes one step for each signal of a batch from the correlations of its residual,
// and orthogonalises in the signals' own space, twice.
//
// A work-group codes one signal after the other: a single work-item with long vectors on CPU devices,
// ITEMS work-items side by side on GPUs.
//
// ITEMS  work-items of a group: see group_largest.cl
// SIDE   signals that a single work-item codes at the same time; 1 with several work-items
// BLOCK  vectors that a work-item holds in registers, 1 to 16
// SMALLEST_CORRELATION, LEAST_DISTANCE, MOST_DEPENDENT
//        where no pursuit goes on: PursuitLimits of weft/reference/batch_omp.hpp
#include "vector_width.cl"

#ifndef SIDE
#define SIDE 1
#endif
#ifndef BLOCK
#define BLOCK 4
#endif
#ifndef SMALLEST_CORRELATION
#define SMALLEST_CORRELATION 0x1p-19f
#endif
#ifndef LEAST_DISTANCE
#define LEAST_DISTANCE 0x1p-12f
#endif
#ifndef MOST_DEPENDENT
#define MOST_DEPENDENT 256
#endif

#define RECODE 0xFFFFFFFFu
#define ENDED RECODE
#define LEAST_PIVOT 0x1p-10f         // of p_t: about 14 bits of a float are left
#define LEAST_ENERGY 0x1p-20f        // of |r|^2 / |y|^2, about (1e-3)^2
#define SMALLEST_FOLLOWED 0x1p-13f   // of |c| / |y|
#define SMALLEST_SCALE 0x1p-104f     // correlations of larger signals might overflow

#include "group_largest.cl"

// 2^-e of a largest magnitude, so that neither it nor 2^e overflows or vanishes.
INLINE float scale_of(float largest) {
  return largest > 0.0f ? ldexp(1.0f, -clamp(ilogb(largest), -126, 126)) : 1.0f;
}

INLINE float largest_magnitude(__global const float* values, ulong count) {
  float largest = 0.0f;
  ulong i = 0;
  realv largest_lanes = 0.0f;
  for (; i + VW <= count; i += VW) {
    const realv x = fabs(loadv(values + i));
    largest_lanes = LARGER(largest_lanes, x);
  }
  for (; i < count; ++i) largest = LARGER(largest, fabs(values[i]));
  const float lane = largest_lane(largest_lanes);
  return LARGER(largest, lane);
}

// Sum of (scale values)^2.
INLINE float squares_of(__global const float* values, ulong count, float scale) {
  realv sum = 0.0f;
  float rest = 0.0f;
  ulong i = 0;
  for (; i + VW <= count; i += VW) {
    const realv x = scale * loadv(values + i);
    sum = fma(x, x, sum);
  }
  for (; i < count; ++i) rest = fma(scale * values[i], scale * values[i], rest);
  return sum_lanes(sum) + rest;
}

// A power of two by which values can be squared, 1 where that is safe, and their energy with it; NaN
// where one is NaN or infinite.
typedef struct {
  float scale;
  float energy;
} Measure;
INLINE Measure measure_of(__global const float* values, ulong count) {
  Measure measure = {1.0f, squares_of(values, count, 1.0f)};
  if (!(measure.energy > 0x1p-60f && measure.energy < 0x1p60f)) {
    measure.scale = scale_of(largest_magnitude(values, count));
    const float energy = squares_of(values, count, measure.scale);
    measure.energy = energy < INFINITY ? energy : NAN;
  }
  return measure;
}

// units and inverse of row-major atoms; rows past the last are zero. Work-item (atom, padded).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void normalise_atoms(ulong atoms, ulong dimension, ulong dimension_p,
                              __global const float* restrict D, ulong offset, ulong leading,
                              __global float* restrict units, __global float* restrict inverse) {
  const ulong n = get_global_id(0);
  __global float* unit = units + n * dimension_p;
  float scale = 0.0f, factor = 0.0f;
  __global const float* atom = D + offset + n * leading;
  if (n < atoms) {
    const Measure measure = measure_of(atom, dimension);
    scale = measure.scale;
    if (measure.energy > 0.0f) factor = 1.0f / sqrt(measure.energy);
  }
  const bool usable = factor > 0.0f;
  for (ulong i = 0; i < dimension_p; ++i) {
    unit[i] = usable && i < dimension ? scale * atom[i] * factor : 0.0f;
  }
  inverse[n] = usable ? SMALLER(factor * scale, FLT_MAX) : 0.0f;
}

// scales and energies of row-major signals. Work-item (`per_item` signals).
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void measure_signals(ulong signals, ulong per_item, ulong dimension,
                              __global const float* restrict Y, ulong offset, ulong leading,
                              __global float* restrict scales, __global float* restrict energies) {
  const ulong begin = get_global_id(0) * per_item;
  const ulong end = min(begin + per_item, signals);
  for (ulong s = begin; s < end; ++s) {
    const Measure measure = measure_of(Y + offset + s * leading, dimension);
    scales[s] = measure.scale;
    energies[s] = measure.energy;
  }
}

// Writes a code of `count` atoms: x from a and l, then entries past the count. l: [count][l_row], zero
// from its diagonal to the end of a vector.
INLINE void write_code(uint count, uint k, ulong atoms, float scale, __global float* a,
                       __global const float* l, ulong l_row, __global const uint* chosen,
                       __global const float* inverse, __global uint* indices,
                       __global float* coefficients) {
  // a_j -= x_t l_tj, from the last
  for (uint t = count; t-- > 1;) {
    const float x = a[t];
    __global const float* row = l + t * l_row;
    for (uint j = 0; j < t; j += VW) STORE(fma((realv)(-x), LOAD(row + j), LOAD(a + j)), a + j);
  }
  const float unscale = 1.0f / scale;
  for (uint t = 0; t < count; ++t) {
    const uint n = chosen[t];
    const float x = a[t] * inverse[n] * unscale;
    indices[t] = n;
    coefficients[t] = clamp(x, -FLT_MAX, FLT_MAX);
  }
  uint unused = 0;
  for (uint t = count; t < k; ++t) {
    for (uint j = 0; j < count;) {
      const bool taken = chosen[j] == unused;
      if (taken) ++unused;
      j = taken ? 0 : j + 1;
    }
    indices[t] = unused < atoms ? unused++ : 0;
    coefficients[t] = 0.0f;
  }
}

// Begins to fetch a cache line that is read soon. Without optimisation, as on simulators, there may be
// no such thing.
#if ITEMS == 1 && defined(__OPTIMIZE__) && defined(__has_builtin)
#if __has_builtin(__builtin_prefetch)
#define FETCH(p) __builtin_prefetch((const void*)(size_t)(p))
#endif
#endif
#ifndef FETCH
#define FETCH(p)
#endif

// What a group works in while it codes a signal:
//
//   c: [A]   q: [steps][A]   l: [steps][l_row]   a: [l_row]   1 / p: [l_row]   chosen: [l_row]
//
// l_row is `steps` padded to whole vectors.
typedef struct {
  __global float* c;
  __global float* q;
  __global float* l;
  __global float* a;
  __global float* inverses;
  __global uint* chosen;
  float energy, left, wanted, smallest;
  Best best;
  __global const float* g;  // of the last atom: its inner products with all, and what it explains
  float step;
  uint count;
  bool more, recode;
  __global const float* next;  // correlations of the signal behind
} Pursuit;

INLINE Pursuit start_pursuit(__global float* scratch, ulong A, ulong steps, ulong l_row,
                             __global const float* correlations, __global const float* next,
                             float scale, float energy, float target, uint item) {
  Pursuit p;
  p.next = next;
  p.c = scratch;
  p.q = p.c + A;
  p.l = p.q + steps * A;
  p.a = p.l + steps * l_row;
  p.inverses = p.a + l_row;
  p.chosen = (__global uint*)(p.inverses + l_row);
  p.energy = p.left = energy;
  p.wanted = target * scale * (target * scale);
  p.smallest = SMALLEST_FOLLOWED * sqrt(energy);
  p.recode = energy > 0.0f && (scale < SMALLEST_SCALE || scale > 1.0f / SMALLEST_SCALE);
  p.more = energy > p.wanted && !p.recode;
  p.count = 0;
  // c = 2^-e D y
  Best best = NOTHING;
  for (ulong i = item * VW; i < A; i += GROUP_STEP) {
    const realv x = scale * LOAD(correlations + i);
    STORE(x, p.c + i);
    best = see(best, x, i);
  }
  p.best = best;
  return p;
}

// One more atom, the best one, and whether another is wanted.
INLINE Pursuit choose(Pursuit p, __global const float* G, ulong A, ulong steps, ulong l_row LOCALS) {
  const Candidate best = GROUP_LARGEST(candidate_of(p.best));
  p.recode = !(best.value > p.smallest);
  const uint n = min((uint)best.index, (uint)(A - 1));
  const float correlation = p.c[n];

  // its part that is orthogonal to the span of those before
  const uint t = p.count;
  __global const float* g = G + n * A;
  __global float* row = p.l + t * l_row;
  float pivot = g[n];
  if (item == 0) {
    STORE((realv)0.0f, row + t / VW * VW);
    if (t % VW == 0) STORE((realv)0.0f, p.a + t);
  }
  for (uint j = 0; j < t; ++j) {
    const float inner = p.q[j * A + n];
    const float factor = inner * p.inverses[j];
    if (item == 0) row[j] = factor;
    pivot -= factor * inner;
  }
  // this also refuses those before
  p.recode |= !(pivot >= LEAST_PIVOT);
  const float inverse_pivot = 1.0f / pivot;
  const float step = correlation * inverse_pivot;
  SYNCHRONISE
  if (item == 0) {
    p.a[t] = step;
    p.inverses[t] = inverse_pivot;
    p.chosen[t] = n;
  }
  SYNCHRONISE
  p.g = g;
  p.step = step;
  p.left -= step * correlation;
  ++p.count;
  p.more = p.count < steps && p.left > p.wanted && p.left >= LEAST_ENERGY * p.energy && !p.recode;
  return p;
}

// q_t of the last atom, c without it, and the largest of that.
INLINE Pursuit take_out(Pursuit p, ulong A, ulong l_row, uint item) {
  const uint t = p.count - 1;
  __global const float* row = p.l + t * l_row;
  __global float* q_t = p.q + t * A;
  Best next = NOTHING;
  for (ulong i = item * BLOCK * VW; i < A; i += BLOCK * GROUP_STEP) {
    realv x[BLOCK];
#pragma unroll
    for (uint b = 0; b < BLOCK; ++b) x[b] = LOAD(p.g + i + b * VW);
    if (t == 0) {
#pragma unroll
      for (uint b = 0; b < BLOCK; ++b) FETCH(p.next + i + b * VW);
    }
    for (uint j = 0; j < t; ++j) {
      const realv factor = row[j];
      __global const float* q_j = p.q + j * A + i;
#pragma unroll
      for (uint b = 0; b < BLOCK; ++b) x[b] = fma(-factor, LOAD(q_j + b * VW), x[b]);
    }
#pragma unroll
    for (uint b = 0; b < BLOCK; ++b) {
      STORE(x[b], q_t + i + b * VW);
      const realv rest = fma((realv)(-p.step), x[b], LOAD(p.c + i + b * VW));
      STORE(rest, p.c + i + b * VW);
      next = see(next, rest, i + b * VW);
    }
  }
  p.best = next;
  return p;
}

// A group works on SIDE signals at a time, step by step, so that one's arithmetic goes on while
// another waits for its best atom; each has its own scratch of `stride` floats. The first step
// fetches the correlations of the signals behind.
WIDE_VECTORS __attribute__((reqd_work_group_size(ITEMS, 1, 1)))
__kernel void code_by_gram(ulong signals, ulong per_group, ulong atoms, ulong A, uint k, uint steps,
                           float target, __global const float* restrict correlations,
                           ulong c_offset, __global const float* restrict G,
                           __global const float* restrict inverse,
                           __global const float* restrict scales,
                           __global const float* restrict energies, __global float* scratch,
                           ulong stride, ulong l_row, ulong first, __global uint* restrict indices,
                           __global float* restrict coefficients, __global uint* restrict counts,
                           ulong first_residual, __global float* restrict residuals) {
  DECLARE_LOCALS
  const ulong begin = get_group_id(0) * per_group;
  const ulong end = min(begin + per_group, signals);
  for (ulong s_begin = begin; s_begin < end; s_begin += SIDE) {
    Pursuit pursuits[SIDE];
#pragma unroll
    for (uint side = 0; side < SIDE; ++side) {
      // past the end: the last signal again, which is not written
      const ulong s = min(s_begin + side, end - 1);
      pursuits[side] = start_pursuit(scratch + (get_group_id(0) * SIDE + side) * stride, A, steps,
                                     l_row, correlations + c_offset + s * A,
                                     correlations + c_offset + min(s + SIDE, end - 1) * A, scales[s],
                                     energies[s], target, item);
    }
#if SIDE == 1
    while (pursuits[0].more) {
      pursuits[0] = choose(pursuits[0], G, A, steps, l_row PASS_LOCALS);
      if (pursuits[0].more) pursuits[0] = take_out(pursuits[0], A, l_row, item);
    }
#else
    for (bool more = true; more;) {
      more = false;
#pragma unroll
      for (uint side = 0; side < SIDE; ++side) {
        if (pursuits[side].more) {
          pursuits[side] = choose(pursuits[side], G, A, steps, l_row PASS_LOCALS);
        }
        more |= pursuits[side].more;
      }
#pragma unroll
      for (uint side = 0; side < SIDE; ++side) {
        if (pursuits[side].more) pursuits[side] = take_out(pursuits[side], A, l_row, item);
      }
    }
#endif
#pragma unroll
    for (uint side = 0; side < SIDE; ++side) {
      const ulong s = s_begin + side;
      const Pursuit p = pursuits[side];
      // a residual that this recurrence can't know, or a target that it can't see
      const float precise = LEAST_ENERGY * p.energy;
      const bool recode = p.recode || (p.energy > 0.0f && p.left < precise) ||
                          (p.left <= p.wanted && p.wanted < 4.0f * precise);
      SYNCHRONISE
      if (item == 0 && s < end) {
        const float scale = scales[s];
        residuals[first_residual + s] = sqrt(p.left < 0.0f ? 0.0f : p.left) / scale;
        counts[first + s] = recode ? RECODE : p.count;
        if (!recode) {
          write_code(p.count, k, atoms, scale, p.a, p.l, l_row, p.chosen, inverse,
                     indices + (first + s) * k, coefficients + (first + s) * k);
        }
      }
      SYNCHRONISE
    }
  }
}

// A batch of signals that step_by_residual works on, and their state:
//
//   list:     [batch]              places of the signals in Y and among the codes
//   r:        [batch][dimension_p] residuals, scaled and padded with zero; |r|^2 in `left`
//   q:        [batch][steps][dimension_p]  parts of the chosen atoms, orthogonal to those before
//   l:        [batch][steps][l_row]        d_(n_t) = q_t + sum_(j<t) l_tj q_j
//   a, inverses, chosen: [batch][l_row]    coefficients of q_t, 1 / |q_t|^2, n_t
//   count:    [batch]              atoms so far; ENDED once the code is written
//
// Work-item (signal of the batch).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void gather_signals(ulong dimension, ulong dimension_p, __global const uint* restrict list,
                             __global const float* restrict Y, ulong offset, ulong leading,
                             __global float* restrict r, __global float* restrict scales,
                             __global float* restrict energies, __global float* restrict left,
                             __global uint* restrict count) {
  const ulong b = get_global_id(0);
  __global const float* y = Y + offset + list[b] * leading;
  const Measure measure = measure_of(y, dimension);
  for (ulong i = 0; i < dimension_p; ++i) {
    r[b * dimension_p + i] = i < dimension && measure.energy > 0.0f ? measure.scale * y[i] : 0.0f;
  }
  scales[b] = measure.scale;
  energies[b] = left[b] = measure.energy;
  count[b] = 0;
}

// v . w, and w -= f v, of a work-item's share.
INLINE float own_dot(__global const float* v, __global const float* w, ulong count, uint item) {
  realv sum = 0.0f;
  for (ulong i = item * VW; i < count; i += GROUP_STEP) {
    sum = fma(LOAD(v + i), LOAD(w + i), sum);
  }
  return sum_lanes(sum);
}
INLINE void own_subtract(float f, __global const float* v, __global float* w, ulong count, uint item) {
  for (ulong i = item * VW; i < count; i += GROUP_STEP) {
    STORE(fma((realv)(-f), LOAD(v + i), LOAD(w + i)), w + i);
  }
}

// One more atom for each signal of a batch, or the end of its code. correlations: [batch][A], of its
// residual; those of atoms that can't be chosen become zero. A group takes `per_group` signals.
WIDE_VECTORS __attribute__((reqd_work_group_size(ITEMS, 1, 1)))
__kernel void step_by_residual(ulong batch, ulong per_group, ulong atoms, ulong A, ulong dimension_p,
                               uint k, uint steps, float target, __global float* correlations,
                               __global const float* restrict units,
                               __global const float* restrict inverse,
                               __global const uint* restrict list,
                               __global const float* restrict scales,
                               __global const float* restrict energies, __global float* r,
                               __global float* left, __global float* q, __global float* l,
                               ulong l_row, __global float* a, __global float* inverses,
                               __global uint* chosen, __global uint* count, ulong first,
                               __global uint* restrict indices, __global float* restrict coefficients,
                               __global uint* restrict counts, ulong first_residual,
                               __global float* restrict residuals) {
  DECLARE_LOCALS
  const ulong begin = get_group_id(0) * per_group;
  const ulong end = min(begin + per_group, batch);
  for (ulong s = begin; s < end; ++s) {
    const uint t = count[s];
    const float scale = scales[s];
    const float energy = energies[s];
    const float wanted = target * scale * (target * scale);
    const float smallest = SMALLEST_CORRELATION * sqrt(energy);
    float rest = left[s];
    __global float* c = correlations + s * A;
    __global float* r_s = r + s * dimension_p;
    __global float* q_s = q + s * steps * dimension_p;
    __global float* q_t = q_s + t * dimension_p;  // not used where t is steps or more
    __global float* l_s = l + s * steps * l_row;
    __global float* a_s = a + s * l_row;
    __global float* inverses_s = inverses + s * l_row;
    __global uint* chosen_s = chosen + s * l_row;
    bool more = t < steps && energy > 0.0f && rest > wanted;
    bool found = false;
    SYNCHRONISE
    if (item == 0 && more) {
      for (uint j = 0; j < t; ++j) c[chosen_s[j]] = 0.0f;
    }
    SYNCHRONISE
    uint dependent = 0;
    while (more) {
      // the best atom
      Best lanes = NOTHING;
      for (ulong i = item * VW; i < A; i += GROUP_STEP) lanes = see(lanes, LOAD(c + i), i);
      const Candidate best = GROUP_LARGEST(candidate_of(lanes));
      const uint n = min((uint)best.index, (uint)(A - 1));
      const bool correlated = best.value > smallest;

      // its part orthogonal to the span of those before; twice is enough
      for (ulong i = item * VW; i < dimension_p; i += GROUP_STEP) {
        STORE(LOAD(units + n * dimension_p + i), q_t + i);
      }
      if (item == 0) {
        STORE((realv)0.0f, l_s + t * l_row + t / VW * VW);
        if (t % VW == 0) STORE((realv)0.0f, a_s + t);
      }
      for (uint turn = 0; turn < 2; ++turn) {
        for (uint j = 0; j < t; ++j) {
          __global const float* q_j = q_s + j * dimension_p;
          const float inner = GROUP_SUM(own_dot(q_j, q_t, dimension_p, item));
          const float factor = inner * inverses_s[j];
          own_subtract(factor, q_j, q_t, dimension_p, item);
          if (item == 0) l_s[t * l_row + j] = turn == 0 ? factor : l_s[t * l_row + j] + factor;
        }
      }
      const float pivot = GROUP_SUM(own_dot(q_t, q_t, dimension_p, item));
      const float product = GROUP_SUM(own_dot(q_t, r_s, dimension_p, item));
      found = correlated && pivot > LEAST_DISTANCE * LEAST_DISTANCE;
      const float step = found ? product / pivot : 0.0f;
      own_subtract(step, q_t, r_s, dimension_p, item);
      const float now = GROUP_SUM(own_dot(r_s, r_s, dimension_p, item));
      rest = found ? now : rest;
      if (item == 0) {
        if (found) {
          a_s[t] = step;
          inverses_s[t] = 1.0f / pivot;
          chosen_s[t] = n;
        } else {
          c[n] = 0.0f;
        }
      }
      SYNCHRONISE
      ++dependent;
      more = correlated && !found && dependent < MOST_DEPENDENT;
    }
    if (item == 0 && t != ENDED) {
      const uint now = t + (found ? 1 : 0);
      const ulong place = list[s];
      left[s] = rest;
      count[s] = now;
      if (!found || now == steps || rest <= wanted) {
        residuals[first_residual + place] = sqrt(rest) / scale;
        counts[first + place] = now;
        write_code(now, k, atoms, scale, a_s, l_s, l_row, chosen_s, inverse,
                   indices + (first + place) * k, coefficients + (first + place) * k);
        count[s] = ENDED;
      }
    }
    SYNCHRONISE
  }
}
