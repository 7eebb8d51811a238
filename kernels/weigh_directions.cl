// The weights of measured directions for any direction: the walk over a triangulated hemisphere that
// lib/weft/btf/hemisphere.hpp describes (HemisphereTables).
//
//   directions: [count][4]: x, y, z, not read
//   measured:   [n][4]; triangles: [T][6]; triangle_rows: [T][3][4]; edges: [E][4]; edge_rows:
//               [E][2][4]; grid: [side][side]
//   out:        [count][8]: three indices, three weights, scale, and the direction's own cosine
//
// Work-item (block of DIRECTIONS directions).
//
// DIRECTIONS  directions of a work-item
#ifndef DIRECTIONS
#define DIRECTIONS 64
#endif

// Weights of this size are rounding.
#define TOLERANCE 1e-6f
// How much brighter than its nearest measured light a light may be taken to be.
#define LARGEST_SCALE 4.0f

inline float weight_of(float4 row, float4 d) {
  return fma(row.x, d.x, fma(row.y, d.y, fma(row.z, d.z, row.w)));
}

inline float length_of(float4 d) { return sqrt(fma(d.x, d.x, fma(d.y, d.y, d.z * d.z))); }

inline uint grid_cell(float x, float z, uint side) {
  const float position = (x / (1.0f + z) + 1.0f) * 0.5f * (float)side;
  return min((uint)(position > 0.0f ? position : 0.0f), side - 1);
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void weigh_directions(ulong count, __global const float4* restrict directions,
                               uint triangle_count, uint edge_count, uint side,
                               __global const float4* restrict measured,
                               __global const int* restrict triangles,
                               __global const float4* restrict triangle_rows,
                               __global const int4* restrict edges,
                               __global const float4* restrict edge_rows,
                               __global const int* restrict grid, __global uint* restrict out) {
  const ulong end = min((get_global_id(0) + 1) * DIRECTIONS, count);
  for (ulong i = get_global_id(0) * DIRECTIONS; i < end; ++i) {
    const float4 asked = directions[i];
    float4 d = (float4)(asked.x, asked.y, asked.z < 0.0f ? 0.0f : asked.z, 0.0f);
    const float size = length_of(d);
    d = size > 0.0f ? d / size : (float4)(1.0f, 0.0f, 0.0f, 0.0f);

    int place = grid[grid_cell(d.y, d.z, side) * side + grid_cell(d.x, d.z, side)];
    int left = place;
    uint index[3] = {0, 0, 0};
    float w[3] = {1.0f, 0.0f, 0.0f};
    for (uint step = 0; place >= 0; ++step) {
      uint smallest = 0;
      for (uint k = 0; k < 3; ++k) {
        w[k] = weight_of(triangle_rows[3 * place + k], d);
        if (w[k] < w[smallest]) smallest = k;
      }
      if (w[smallest] >= -TOLERANCE || step >= triangle_count) break;
      const int next = triangles[6 * place + 3 + smallest];
      if (next == left) break;
      left = place;
      place = next;
    }
    float scale = asked.z < 0.0f ? 0.0f : 1.0f;
    if (place >= 0) {
      for (uint k = 0; k < 3; ++k) {
        index[k] = triangles[6 * place + k];
        w[k] = w[k] > 0.0f ? w[k] : 0.0f;
      }
      const float sum = w[0] + w[1] + w[2];
      for (uint k = 0; k < 3; ++k) w[k] /= sum;
    } else {
      // along the hull's edge to the arc, or the vertex, that is nearest
      int at = ~place;
      int came = 0;
      for (uint step = 0; step <= edge_count; ++step) {
        const int4 edge = edges[at];
        const float wa = weight_of(edge_rows[2 * at], d), wb = weight_of(edge_rows[2 * at + 1], d);
        index[0] = edge.x, index[1] = edge.y, index[2] = edge.x;
        w[2] = 0.0f;
        if (wa >= 0.0f && wb >= 0.0f && wa + wb > 0.0f) {
          w[0] = wa / (wa + wb), w[1] = wb / (wa + wb);
          break;
        }
        const int onwards = wa < wb ? 1 : -1;
        const int next = onwards > 0 ? edge.w : edge.z;
        w[0] = onwards > 0 ? 0.0f : 1.0f, w[1] = onwards > 0 ? 1.0f : 0.0f;
        if (next < 0 || came == -onwards) break;
        came = onwards;
        at = next;
      }
      if (asked.z >= 0.0f) {
        const float4 p = w[0] * measured[index[0]] + w[1] * measured[index[1]];
        const float cosine = p.z / fmax(length_of(p), 1e-12f);
        scale = d.z < LARGEST_SCALE * cosine ? d.z / cosine : d.z > 0.0f ? LARGEST_SCALE : 1.0f;
      }
    }
    __global uint* result = out + 8 * i;
    for (uint k = 0; k < 3; ++k) result[k] = index[k], result[3 + k] = as_uint(w[k]);
    result[6] = as_uint(scale);
    result[7] = as_uint(asked.z);
  }
}
