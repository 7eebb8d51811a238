// Sums and largest magnitudes of long vectors, by a work-group: a single work-item, or ITEMS of them side
// by side.
//
// ITEMS  work-items of a group, a power of two
#ifndef ITEMS
#define ITEMS 1
#endif

// Functions that are not inlined would not have the kernel's vectors.
#if defined(__OPTIMIZE__) && defined(__has_attribute)
#if __has_attribute(always_inline)
#define INLINE inline __attribute__((always_inline))
#endif
#endif
#ifndef INLINE
#define INLINE inline
#endif

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
typedef JOIN(int, VW) intv;
#if VW == 16
#define LANES (intv)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
#elif VW == 8
#define LANES (intv)(0, 1, 2, 3, 4, 5, 6, 7)
#else
#define LANES (intv)(0, 1, 2, 3)
#endif

// Rows of all buffers but the callers' are whole vectors: they are read and written as such. (vstore16
// may become several stores, which a vector read soon after has to wait for.)
#define LOAD(p) (*(__global const realv*)(p))
#define STORE(x, p) (*(__global realv*)(p) = (x))

#define GROUP_STEP (ITEMS * VW)
#if ITEMS > 1
#define SYNCHRONISE barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
#else
#define SYNCHRONISE
#endif

// Sum and largest value of a vector's lanes, least of indices.
#define LARGER(a, b) ((a) > (b) ? (a) : (b))
#define SMALLER(a, b) ((a) < (b) ? (a) : (b))
INLINE float sum_lanes(realv x) {
#if VW == 16
  const float8 eight = x.lo + x.hi;
  const float4 four = eight.lo + eight.hi;
#elif VW == 8
  const float4 four = x.lo + x.hi;
#else
  const float4 four = x;
#endif
  const float2 two = four.lo + four.hi;
  return two.x + two.y;
}
INLINE float largest_lane(realv x) {
#if VW == 16
  const float8 eight = LARGER(x.lo, x.hi);
  const float4 four = LARGER(eight.lo, eight.hi);
#elif VW == 8
  const float4 four = LARGER(x.lo, x.hi);
#else
  const float4 four = x;
#endif
  const float2 two = LARGER(four.lo, four.hi);
  return LARGER(two.x, two.y);
}
INLINE int least_lane(intv x) {
#if VW == 16
  const int8 eight = min(x.lo, x.hi);
  const int4 four = min(eight.lo, eight.hi);
#elif VW == 8
  const int4 four = min(x.lo, x.hi);
#else
  const int4 four = x;
#endif
  const int2 two = min(four.lo, four.hi);
  return min(two.x, two.y);
}

// Values of all work-items of a group added up, and the largest with the least of its indices. Every
// work-item gets the result.
typedef struct {
  float value;
  int index;
} Candidate;

#if ITEMS > 1
INLINE float group_sum(float value, __local float* values, uint item) {
  SYNCHRONISE
  values[item] = value;
  for (uint half_items = ITEMS / 2; half_items > 0; half_items /= 2) {
    SYNCHRONISE
    if (item < half_items) values[item] += values[item + half_items];
  }
  SYNCHRONISE
  return values[0];
}
INLINE Candidate group_largest(Candidate own, __local float* values, __local int* indices, uint item) {
  SYNCHRONISE
  values[item] = own.value;
  indices[item] = own.index;
  for (uint half_items = ITEMS / 2; half_items > 0; half_items /= 2) {
    SYNCHRONISE
    if (item < half_items) {
      const float other = values[item + half_items];
      const int other_index = indices[item + half_items];
      if (other > values[item] || (other == values[item] && other_index < indices[item])) {
        values[item] = other;
        indices[item] = other_index;
      }
    }
  }
  SYNCHRONISE
  const Candidate result = {values[0], indices[0]};
  return result;
}
#define DECLARE_LOCALS                     \
  __local float shared_values[ITEMS];      \
  __local int shared_indices[ITEMS];       \
  const uint item = get_local_id(0);
#define LOCALS , __local float *shared_values, __local int *shared_indices, uint item
#define PASS_LOCALS , shared_values, shared_indices, item
#define GROUP_SUM(x) group_sum(x, shared_values, item)
#define GROUP_LARGEST(x) group_largest(x, shared_values, shared_indices, item)
#else
#define DECLARE_LOCALS const uint item = 0;
#define LOCALS , uint item
#define PASS_LOCALS , item
#define GROUP_SUM(x) (x)
#define GROUP_LARGEST(x) (x)
#endif

// The largest magnitudes that a work-item has seen, lane by lane, and where they were.
typedef struct {
  realv value;
  intv index;
} Best;
INLINE Best see(Best best, realv x, ulong i) {
  const realv magnitude = fabs(x);
  const intv larger = magnitude > best.value;
  const Best result = {select(best.value, magnitude, larger),
                       select(best.index, (intv)(int)i, larger)};
  return result;
}
// The largest of all lanes, at the least of its indices.
INLINE Candidate candidate_of(Best best) {
  const float largest = largest_lane(best.value);
  const intv hit = best.value == (realv)largest;
  const Candidate result = {largest, least_lane(select((intv)INT_MAX, best.index + LANES, hit))};
  return result;
}
#define NOTHING {(realv)(-1.0f), (intv)0}
