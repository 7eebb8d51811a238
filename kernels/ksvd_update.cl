// The atoms of a dictionary, updated one after another (Aharon, Elad & Bruckstein 2006, section IV;
// Rubinstein, Zibulevsky & Elad 2008, section 4), with the residual R = Y - X D kept up to date:
//
//   E = R_I + x d^T                       what the signals I that use atom d lack without it
//   d' = E^T w / |E^T w|,  x' = E d'      w: x, then E d' in steps of the power iteration
//   R_I = E - x' d'^T
//
// E is not formed: E^T w = R_I^T w + (x . w) d, and E d' = R_I d' + (d . d') x.
//
//   Y, R: [signals][leading]  D: [atoms][leading]     zero from the dimension on
//   indices, coefficients: [signals][k]; an entry's number is signal k + slot
//   entries: the numbers of the entries of each atom, by atom, then by signal
//   partial: [granules][leading], sums: [granules][2]
//   state: overlap d . d', then |E^T E d - rho d| / rho of the last step with rho = |E d|^2
//
// A work-group goes through the rows of a granule, `granule` entries of an atom, its lanes across the
// row.
//
// LANES  work-items of a work-group, a power of two: 1 for CPUs
// VW     floats of a vector; `leading` is a multiple of it
// POWER  1: the weights w are E d', 0: the coefficients
#include "vector_width.cl"

#ifndef LANES
#define LANES 1
#endif
#ifndef POWER
#define POWER 0
#endif

#define GROUP __attribute__((reqd_work_group_size(LANES, 1, 1))) WIDE_VECTORS

inline float sum_lanes(realv x) {
  float lanes[VW];
  storev(x, lanes);
  for (uint step = VW / 2; step > 0; step /= 2) {
    for (uint i = 0; i < step; ++i) lanes[i] += lanes[i + step];
  }
  return lanes[0];
}

// The sum (the maximum) over a work-group, the same in every work-item.
#if LANES == 1
#define LANE 0
#define SCRATCH
#define sum_group(x) (x)
#define max_group(x) (x)
#else
#define LANE get_local_id(0)
#define SCRATCH __local float scratch[LANES];
#define sum_group(x) reduce_group(x, scratch, 0)
#define max_group(x) reduce_group(x, scratch, 1)
inline float reduce_group(float x, __local float* scratch, int largest) {
  const uint lane = get_local_id(0);
  barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
  scratch[lane] = x;
  for (uint step = LANES / 2; step > 0; step /= 2) {
    barrier(CLK_LOCAL_MEM_FENCE);
    if (lane < step) {
      const float a = scratch[lane], b = scratch[lane + step];
      scratch[lane] = largest ? (a > b ? a : b) : a + b;
    }
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  return scratch[0];
}
#endif
#define FOR_ROW(j) for (ulong j = LANE * VW; j < leading; j += LANES * VW)

// r = y - sum over s < count of coefficients[s] D[indices[s]]; this lane's part of |r|^2.
inline float subtract_atoms(ulong leading, uint count, __global const float* restrict y,
                            __global const float* restrict D, __global const uint* restrict indices,
                            __global const float* restrict coefficients, __global float* restrict r) {
  realv squares = 0.0f;
  ulong j = LANE * VW;
  for (; j + 3 * LANES * VW < leading; j += 4 * LANES * VW) {
    realv r0 = loadv(y + j);
    realv r1 = loadv(y + j + LANES * VW);
    realv r2 = loadv(y + j + 2 * LANES * VW);
    realv r3 = loadv(y + j + 3 * LANES * VW);
    for (uint s = 0; s < count; ++s) {
      const realv x = coefficients[s];
      __global const float* d = D + indices[s] * leading + j;
      r0 -= x * loadv(d);
      r1 -= x * loadv(d + LANES * VW);
      r2 -= x * loadv(d + 2 * LANES * VW);
      r3 -= x * loadv(d + 3 * LANES * VW);
    }
    storev(r0, r + j);
    storev(r1, r + j + LANES * VW);
    storev(r2, r + j + 2 * LANES * VW);
    storev(r3, r + j + 3 * LANES * VW);
    squares = fma(r0, r0, squares);
    squares = fma(r1, r1, squares);
    squares = fma(r2, r2, squares);
    squares = fma(r3, r3, squares);
  }
  for (; j < leading; j += LANES * VW) {
    realv r0 = loadv(y + j);
    for (uint s = 0; s < count; ++s) {
      r0 -= coefficients[s] * loadv(D + indices[s] * leading + j);
    }
    storev(r0, r + j);
    squares = fma(r0, r0, squares);
  }
  return sum_lanes(squares);
}

// R and errors[i] = |r_i|^2 of new codes. With `kept` of the codes before, whose residuals R holds, a
// signal goes back to its code before where that is the better one by the atoms as they are now.
// Work-group (signal).
GROUP __kernel void code_residuals(ulong k, ulong leading, uint kept, __global const float* restrict Y,
                                   __global const float* restrict D, __global uint* restrict indices,
                                   __global float* restrict coefficients, __global uint* restrict counts,
                                   __global const uint* restrict old_indices,
                                   __global const float* restrict old_coefficients,
                                   __global const uint* restrict old_counts, __global float* restrict R,
                                   __global float* restrict errors) {
  SCRATCH
  const ulong i = get_group_id(0);
  const ulong code = i * k;
  __global const float* y = Y + i * leading;
  __global float* r = R + i * leading;
  // Conditions are the same in all work-items, but no barrier is under one: drivers may take it ill.
  realv squares = 0.0f;
  if (kept) {
    FOR_ROW(j) {
      const realv x = loadv(r + j);
      squares = fma(x, x, squares);
    }
  }
  const float claimed = sum_group(sum_lanes(squares));
  float part = subtract_atoms(leading, counts[i], y, D, indices + code, coefficients + code, r);
  float error = sum_group(part);
  const int doubted = kept && claimed < error;
  if (doubted) {
    part = subtract_atoms(leading, old_counts[i], y, D, old_indices + code, old_coefficients + code, r);
  }
  const float before = sum_group(part);
  if (doubted && before < error) {
    error = before;
    for (ulong s = LANE; s < k; s += LANES) {
      indices[code + s] = old_indices[code + s];
      coefficients[code + s] = old_coefficients[code + s];
    }
    if (LANE == 0) counts[i] = old_counts[i];
  } else if (doubted) {
    subtract_atoms(leading, counts[i], y, D, indices + code, coefficients + code, r);
  }
  if (LANE == 0) errors[i] = error;
}

// partial and sums of the granules of one atom: R_I^T w; x . w and |w|^2.
// Work-group (granule).
GROUP __kernel void atom_products(ulong k, ulong leading, ulong first, ulong count, ulong granule,
                                  ulong atom, __global const uint* restrict entries,
                                  __global const float* restrict coefficients,
                                  __global const float* restrict R, __global const float* restrict D_new,
                                  __global const float* restrict state, __global float* restrict partial,
                                  __global float* restrict sums) {
  SCRATCH
  const ulong begin = get_group_id(0) * granule;
  const ulong end = min(begin + granule, count);
  __global float* out = partial + get_group_id(0) * leading;
#if POWER
  __global const float* d = D_new + atom * leading;
  const float overlap = state[0];
#endif
  float xw = 0.0f, ww = 0.0f;
  for (ulong e = begin; e < end; e += 4) {
    // four rows at once; those past the last repeat it without weight
    const ulong last = end - 1;
    const uint n0 = entries[first + e];
    const uint n1 = entries[first + min(e + 1, last)];
    const uint n2 = entries[first + min(e + 2, last)];
    const uint n3 = entries[first + min(e + 3, last)];
    __global const float* r0 = R + n0 / k * leading;
    __global const float* r1 = R + n1 / k * leading;
    __global const float* r2 = R + n2 / k * leading;
    __global const float* r3 = R + n3 / k * leading;
    const float x0 = coefficients[n0], x1 = coefficients[n1];
    const float x2 = coefficients[n2], x3 = coefficients[n3];
#if POWER
    realv s0 = 0.0f, s1 = 0.0f, s2 = 0.0f, s3 = 0.0f;
    FOR_ROW(j) {
      const realv dj = loadv(d + j);
      s0 = fma(loadv(r0 + j), dj, s0);
      s1 = fma(loadv(r1 + j), dj, s1);
      s2 = fma(loadv(r2 + j), dj, s2);
      s3 = fma(loadv(r3 + j), dj, s3);
    }
    const float w0 = fma(x0, overlap, sum_group(sum_lanes(s0)));
    float w1 = fma(x1, overlap, sum_group(sum_lanes(s1)));
    float w2 = fma(x2, overlap, sum_group(sum_lanes(s2)));
    float w3 = fma(x3, overlap, sum_group(sum_lanes(s3)));
#else
    const float w0 = x0;
    float w1 = x1, w2 = x2, w3 = x3;
#endif
    if (e + 1 > last) w1 = 0.0f;
    if (e + 2 > last) w2 = 0.0f;
    if (e + 3 > last) w3 = 0.0f;
    xw += fma(x0, w0, x1 * w1) + fma(x2, w2, x3 * w3);
    ww += fma(w0, w0, w1 * w1) + fma(w2, w2, w3 * w3);
    FOR_ROW(j) {
      realv sum = w0 * loadv(r0 + j);
      if (e > begin) sum += loadv(out + j);
      sum = fma((realv)w1, loadv(r1 + j), sum);
      sum = fma((realv)w2, loadv(r2 + j), sum);
      sum = fma((realv)w3, loadv(r3 + j), sum);
      storev(sum, out + j);
    }
  }
  if (LANE == 0) {
    sums[2 * get_group_id(0)] = xw;
    sums[2 * get_group_id(0) + 1] = ww;
  }
}

// The atom of E^T w, and the state. An atom whose E^T w vanishes stays. One work-group.
GROUP __kernel void normalise_atom(ulong leading, ulong granules, ulong atom,
                                   __global const float* restrict D_old,
                                   __global float* restrict partial, __global const float* restrict sums,
                                   __global float* restrict D_new, __global float* restrict state) {
  SCRATCH
  __global const float* old = D_old + atom * leading;
  __global float* d = D_new + atom * leading;
  float xw = 0.0f, ww = 0.0f;
  for (ulong g = 0; g < granules; ++g) {
    xw += sums[2 * g];
    ww += sums[2 * g + 1];
  }
  // z = E^T w into the first row of partial
  float largest = 0.0f;
  realv residual = 0.0f;
  FOR_ROW(j) {
    realv z = 0.0f;
    for (ulong g = 0; g < granules; ++g) z += loadv(partial + g * leading + j);
    z = fma((realv)xw, loadv(old + j), z);
    storev(z, partial + j);
    float lanes[VW];
    storev(z, lanes);
    for (uint i = 0; i < VW; ++i) largest = fabs(lanes[i]) > largest ? fabs(lanes[i]) : largest;
#if POWER
    const realv left = (z - ww * loadv(d + j)) / ww;
    residual = fma(left, left, residual);
#endif
  }
  largest = max_group(largest);
  // |z / largest|
  realv squares = 0.0f;
  FOR_ROW(j) {
    const realv z = loadv(partial + j) / largest;
    squares = fma(z, z, squares);
  }
  const float length = largest * sqrt(sum_group(sum_lanes(squares)));
  // what rounding leaves of signals that cancel, or of denormal numbers, is no direction
  const int moves = length > 0x1p-18f * fabs(xw) && length > 0x1p-100f;
  realv product = 0.0f;
  FOR_ROW(j) {
    const realv before = loadv(old + j);
    const realv now = moves ? loadv(partial + j) / length : before;
    storev(now, d + j);
    product = fma(before, now, product);
  }
  const float overlap = sum_group(sum_lanes(product));
#if POWER
  const float change = moves ? sqrt(sum_group(sum_lanes(residual))) : 0.0f;
#else
  const float change = moves ? 1.0f : 0.0f;
#endif
  if (LANE == 0) {
    state[0] = overlap;
    state[1] = change;
  }
}

// x' and the residuals of the signals of one atom. Work-group (granule).
GROUP __kernel void apply_atom(ulong k, ulong leading, ulong first, ulong count, ulong granule,
                               ulong atom, __global const uint* restrict entries,
                               __global const float* restrict D_old, __global const float* restrict D_new,
                               __global const float* restrict state, __global float* restrict coefficients,
                               __global float* restrict R) {
  SCRATCH
  const ulong begin = get_group_id(0) * granule;
  const ulong end = min(begin + granule, count);
  __global const float* old = D_old + atom * leading;
  __global const float* d = D_new + atom * leading;
  const float overlap = state[0];
  for (ulong e = begin; e < end; ++e) {
    const uint number = entries[first + e];
    __global float* r = R + number / k * leading;
    const float x = coefficients[number];
    realv products = 0.0f;
    FOR_ROW(j) products = fma(loadv(r + j), loadv(d + j), products);
    const float now = fma(x, overlap, sum_group(sum_lanes(products)));
    FOR_ROW(j) {
      const realv without = fma((realv)x, loadv(old + j), loadv(r + j));
      storev(without - now * loadv(d + j), r + j);
    }
    if (LANE == 0) coefficients[number] = now;
  }
}
