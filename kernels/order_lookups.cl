// Look-ups by their first texel, those of a texel as they come: a stable counting sort. Neighbours then
// read the same part of a model, and share what is of the texel alone.
//
//   lookups: records of WORDS words, see look_up_record.cl; the first is a texel
//   starts:  [texels], zeros; scratch then
//   order:   [count] numbers of the records [first, first + count), less `first`
//
// One work-item, for CPU devices.
//
// WORDS  words of a record
#ifndef WORDS
#define WORDS 3
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void order_lookups(ulong first, ulong count, ulong texels,
                            __global const uint* restrict lookups, __global uint* restrict starts,
                            __global uint* restrict order) {
  __global const uint* records = lookups + first * WORDS;
  for (ulong i = 0; i < count; ++i) ++starts[records[i * WORDS]];
  uint before = 0;
  for (ulong p = 0; p < texels; ++p) {
    const uint here = starts[p];
    starts[p] = before;
    before += here;
  }
  for (ulong i = 0; i < count; ++i) order[starts[records[i * WORDS]]++] = (uint)i;
}
