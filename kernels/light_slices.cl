// Directions to light drawn from slices of a material (lib/weft/scene/light_nodes.hpp): from a view
// and a texel to look-ups of every measured light, from their values to the nodes of a density, and
// from that to directions, densities and albedos.
//
//   texels:     [slices]; views: [slices][8] of weigh_directions.cl
//   lookups:    [slices][lights][8]: records of 1 texel, 3 views and 1 light
//   values:     [slices][lights][CHANNELS]
//   luminances: [slices][lights]
//   nodes:      [slices][side][side], 2 pi p at the centres of cells; row_sums: [slices][side]
//   slice_of:   [count]: the slice of each query
//
// Work-item (block of ENTRIES entries).
//
// ENCODING  of the values, encoding.cl
// CHANNELS  of the material
// ENTRIES   entries of a work-item
#include "encoding.cl"

#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef ENTRIES
#define ENTRIES 64
#endif

#define EACH(i, count)                                                    \
  const ulong end = min((get_global_id(0) + 1) * ENTRIES, (ulong)(count)); \
  for (ulong i = get_global_id(0) * ENTRIES; i < end; ++i)

#define TWO_PI 6.283185307f
#define QUARTER_PI 0.785398163f

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void write_slice_lookups(ulong slices, uint lights, __global const uint* restrict texels,
                                  __global const uint* restrict views,
                                  __global uint* restrict lookups) {
  EACH(i, slices) {
    __global const uint* view = views + 8 * i;
    for (uint l = 0; l < lights; ++l) {
      __global uint* record = lookups + 8 * (i * lights + l);
      record[0] = texels[i];
      for (uint k = 0; k < 3; ++k) record[1 + k] = view[k], record[5 + k] = view[3 + k];
      record[4] = l;
    }
  }
}

inline float linear_light(float value) { return value > 0.0f ? to_linear(value) : 0.0f; }

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void slice_luminances(ulong count, __global const float* restrict values,
                               __global float* restrict luminances) {
  EACH(i, count) {
    __global const float* value = values + CHANNELS * i;
#if CHANNELS == 3
    // primaries of Rec. 709
    luminances[i] = 0.2126f * linear_light(value[0]) + 0.7152f * linear_light(value[1]) +
                    0.0722f * linear_light(value[2]);
#else
    float sum = 0.0f;
    for (uint c = 0; c < CHANNELS; ++c) sum += linear_light(value[c]);
    luminances[i] = sum / CHANNELS;
#endif
  }
}

//   first: [side side + 1]; terms: pairs (light, weight) of each node; defence: [side side]; e
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void slice_nodes(ulong slices, uint lights, uint side, float e,
                          __global const uint* restrict first,
                          __global const uint* restrict terms,
                          __global const float* restrict defence,
                          __global const float* restrict luminances, __global float* restrict nodes,
                          __global float* restrict row_sums) {
  const uint cells = side * side;
  EACH(i, slices) {
    __global const float* luminance = luminances + i * lights;
    __global float* node = nodes + i * cells;
    float largest = 0.0f;
    for (uint n = 0; n < cells; ++n) {
      float sum = 0.0f;
      for (uint k = first[n]; k < first[n + 1]; ++k) {
        sum += as_float(terms[2 * k + 1]) * luminance[terms[2 * k]];
      }
      node[n] = sum;
      largest = fmax(sum, largest);
    }
    // by the largest, so that no sum overflows
    const bool black = !(largest >= FLT_MIN && largest <= FLT_MAX);
    float sum = 0.0f;
    for (uint n = 0; n < cells; ++n) sum += black ? 0.0f : node[n] / largest;
    const float factor = (1.0f - e) * (float)cells / sum;
    for (uint row = 0; row < side; ++row) {
      float row_sum = 0.0f;
      for (uint n = row * side; n < (row + 1) * side; ++n) {
        const float value = black ? defence[n] / e : fma(factor, node[n] / largest, defence[n]);
        node[n] = value;
        row_sum += value;
      }
      row_sums[i * side + row] = row_sum;
    }
  }
}

//   weights: [lights]; albedos: [slices][CHANNELS]
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void slice_albedos(ulong slices, uint lights, __global const float* restrict weights,
                            __global const float* restrict values, __global float* restrict albedos) {
  EACH(i, slices) {
    for (uint c = 0; c < CHANNELS; ++c) {
      float sum = 0.0f;
      for (uint l = 0; l < lights; ++l) {
        sum = fma(weights[l], linear_light(values[(i * lights + l) * CHANNELS + c]), sum);
      }
      albedos[CHANNELS * i + c] = sum;
    }
  }
}

// Where a coordinate in cells lies between their centres: the cell below, and the part of the next.
inline uint cell_below(float position, uint side, float* fraction) {
  const float at = clamp(position - 0.5f, 0.0f, (float)(side - 1));
  const uint below = min((uint)at, side - 1);
  *fraction = at - (float)below;
  return below;
}

// (1 - fraction) a[k] + fraction b[k]
inline float mixed(__global const float* a, __global const float* b, float fraction, uint k) {
  return mix(a[k], b[k], fraction);
}

// The coordinate, in cells, below which a share `number` of the density lies that is linear between
// mixed(k) at k + 1/2.
inline float invert(__global const float* a, __global const float* b, float fraction, uint side,
                    float number) {
  float total = 0.0f;
  for (uint k = 0; k < side; ++k) total += mixed(a, b, fraction, k);
  float left = number * total;
  float low = mixed(a, b, fraction, 0);
  if (left < 0.5f * low) return left / low;
  left -= 0.5f * low;
  for (uint k = 0; k + 1 < side; ++k) {
    const float high = mixed(a, b, fraction, k + 1);
    const float area = 0.5f * (low + high);
    if (left < area) {
      // low x + (high - low) x^2 / 2 = left
      const float root = sqrt(fmax(fma(2.0f * (high - low), left, low * low), 0.0f));
      return (float)k + 0.5f + (left > 0.0f ? fmin(2.0f * left / (low + root), 1.0f) : 0.0f);
    }
    left -= area;
    low = high;
  }
  return (float)side - 0.5f + (low > 0.0f ? fmin(left / low, 0.5f) : 0.0f);
}

// p at a place in cells: down the rows, and along them.
inline float density_at(__global const float* node, uint side, float2 place) {
  float down, across;
  const uint row = cell_below(place.x, side, &down), column = cell_below(place.y, side, &across);
  const uint next = min(column + 1, side - 1);
  __global const float* above = node + row * side;
  __global const float* below = node + min(row + 1, side - 1) * side;
  return mix(mix(above[column], above[next], across), mix(below[column], below[next], across),
             down) / TWO_PI;
}

// Of a place in [0, 1]^2: hemisphere_chart.hpp.
inline float4 hemisphere_of_square(float2 place) {
  const float a = 2.0f * place.x - 1.0f, b = 2.0f * place.y - 1.0f;
  const bool along_a = fabs(a) > fabs(b);
  const float radius = along_a ? a : b;
  if (radius == 0.0f) return (float4)(0.0f, 0.0f, 1.0f, 0.0f);
  const float angle = along_a ? QUARTER_PI * (b / a) : 2.0f * QUARTER_PI - QUARTER_PI * (a / b);
  const float z = fmax(1.0f - radius * radius, 0.0f);
  const float sine = radius * sqrt(1.0f + z);
  return (float4)(sine * cos(angle), sine * sin(angle), z, 0.0f);
}

inline float2 square_of_hemisphere(float4 d) {
  const float x = fabs(d.x), y = fabs(d.y);
  const float radius = fmin(sqrt((x * x + y * y) / (1.0f + fmax(d.z, 0.0f))), 1.0f);
  const bool along_x = x > y;
  const float larger = along_x ? x : y, smaller = along_x ? y : x;
  const float turned = larger > 0.0f ? radius * atan(smaller / larger) / QUARTER_PI : 0.0f;
  const float2 place = along_x ? (float2)(radius, turned) : (float2)(turned, radius);
  return clamp(0.5f * (copysign(place, d.xy) + 1.0f), 0.0f, 1.0f);
}

//   numbers: [count]; drawn: [count]: direction and p
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void draw_lights(ulong count, uint side, __global const uint* restrict slice_of,
                          __global const float2* restrict numbers,
                          __global const float* restrict nodes,
                          __global const float* restrict row_sums, __global float4* restrict drawn) {
  EACH(i, count) {
    const ulong slice = slice_of[i];
    __global const float* node = nodes + slice * side * side;
    __global const float* sums = row_sums + slice * side;
    float2 place;
    place.x = invert(sums, sums, 0.0f, side, numbers[i].x);
    float down;
    const uint row = cell_below(place.x, side, &down);
    place.y = invert(node + row * side, node + min(row + 1, side - 1) * side, down, side,
                     numbers[i].y);
    const float4 direction = hemisphere_of_square(place / (float)side);
    drawn[i] = (float4)(direction.xyz, density_at(node, side, place));
  }
}

//   lights: [count]: direction, not read; densities: [count]
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void light_densities(ulong count, uint side, __global const uint* restrict slice_of,
                              __global const float4* restrict lights,
                              __global const float* restrict nodes,
                              __global float* restrict densities) {
  EACH(i, count) {
    const float2 place = square_of_hemisphere(lights[i]) * (float)side;
    const float p = density_at(nodes + (ulong)slice_of[i] * side * side, side, place);
    densities[i] = lights[i].z < 0.0f ? 0.0f : p;
  }
}
