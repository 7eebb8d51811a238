// Look-ups in nested code-books: sums over texels, views and lights of chained look-ups, see
// look_up_record.cl for the records and vq_books.cl for the rest. Of directions, a view and a light
// have one place between the nodes, wherever they are (figure 6).
//
//   views, lights: places, [V] and [V lights_of_view]
//   P6, c_P6: [texels]
//   channels: [CHANNELS], 0 for luminance, n for chromaticity n - 1
//   out: [count][CHANNELS]
//
// Work-item (block of LOOKUPS look-ups).
#include "look_up_record.cl"
#include "onion_slices.cl"
#include "vq_books.cl"

// Adds the weighted values of a record's texels at a place.
inline void add_texels(const Books* books, __global const uint* record, float of_place,
                       const uint* view, const uint* light, __global const uint* P6,
                       __global const float* c_P6, __global const uint* channels, float* sums) {
  for (uint t = 0; t < TEXELS; ++t) {
    const float weight = texel_weight(record, t) * of_place;
    if (weight == 0.0f) continue;
    const ulong p = texel_of(record, t);
    float values[1 + COLOURS];
    entry_values(books, P6[p], view, light, values);
    values[0] *= c_P6[p];
    for (uint c = 0; c < CHANNELS; ++c) sums[c] = fma(weight, values[channels[c]], sums[c]);
  }
}

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
    uint view[PLACE_WORDS], light[PLACE_WORDS];
    float sums[CHANNELS];
    for (uint c = 0; c < CHANNELS; ++c) sums[c] = 0.0f;
#if DIRECTIONS
    onion_place(direction_of(record, 0), direction_of(record, 1), n_phi, n_theta, n_alpha, n_beta,
                view, light);
    add_texels(&books, record, 1.0f, view, light, P6, c_P6, channels, sums);
#else
    for (uint a = 0; a < VIEWS; ++a) {
      const ulong v = view_of(record, a);
      load_place(views + v * PLACE_WORDS, view);
      for (uint b = 0; b < LIGHTS; ++b) {
        load_place(lights + (v * lights_of_view + light_of(record, b)) * PLACE_WORDS, light);
        add_texels(&books, record, view_weight(record, a) * light_weight(record, b), view, light,
                   P6, c_P6, channels, sums);
      }
    }
#endif
    for (uint c = 0; c < CHANNELS; ++c) out[at * CHANNELS + c] = sums[c];
  }
}
