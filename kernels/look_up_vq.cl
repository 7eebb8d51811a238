// Look-ups in nested code-books: sums over texels, views and lights of chained look-ups, see
// look_up_record.cl for the records and vq_books.cl for the rest.
//
//   views, lights: places, [V] and [V lights_of_view]
//   P6, c_P6: [texels]
//   channels: [CHANNELS], 0 for luminance, n for chromaticity n - 1
//   out: [count][CHANNELS]
//
// Work-item (block of LOOKUPS look-ups).
#include "look_up_record.cl"
#include "vq_books.cl"

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void look_up_vq(BOOK_PARAMETERS, ulong count, ulong lights_of_view,
                         __global const uint* restrict lookups, __global const uint* restrict views,
                         __global const uint* restrict lights, __global const uint* restrict P6,
                         __global const float* restrict c_P6, __global const uint* restrict channels,
                         __global float* restrict out) {
  const Books books = BOOKS;
  const ulong end = min((get_global_id(0) + 1) * LOOKUPS, count);
  for (ulong at = get_global_id(0) * LOOKUPS; at < end; ++at) {
    __global const uint* record = lookups + at * WORDS;
    float sums[CHANNELS];
    for (uint c = 0; c < CHANNELS; ++c) sums[c] = 0.0f;
    for (uint t = 0; t < TEXELS; ++t) {
      const float of_texel = texel_weight(record, t);
      const ulong p = texel_of(record, t);
      for (uint a = 0; a < VIEWS; ++a) {
        const ulong v = view_of(record, a);
        for (uint b = 0; b < LIGHTS; ++b) {
          const float weight = of_texel * (view_weight(record, a) * light_weight(record, b));
          if (weight == 0.0f) continue;
          float values[1 + COLOURS];
          entry_values(&books, P6[p], views + v * PLACE_WORDS,
                       lights + (v * lights_of_view + light_of(record, b)) * PLACE_WORDS, values);
          values[0] *= c_P6[p];
          for (uint c = 0; c < CHANNELS; ++c) sums[c] = fma(weight, values[channels[c]], sums[c]);
        }
      }
    }
    for (uint c = 0; c < CHANNELS; ++c) out[at * CHANNELS + c] = sums[c];
  }
}
