// What shading points reflect (lib/weft/scene/shader.hpp): look-ups are written for the light
// samples of points, and their values are summed.
//
// A point looks into two mip levels, slot 0 and slot 1 of it; light samples without irradiance are
// left out. Entry 2 i + s is slot s of light sample i, or of point i where masks are looked up.
//
//   taps:    [points][2][8]: four texels and their weights, of a slot's level
//   share:   [points][2]: the share of each level, 0 where it is not used
//   point_of: [samples]: the point of each light sample
//   views, lights: [points][8], [samples][8] of weigh_directions.cl
//   grid_views: [points]: views of a model's own grid
//   list:    [count]: entries of one level
//
// Work-item (block of ENTRIES entries or points).
//
// ENCODING  of the values, encoding.cl
// CHANNELS  1 or 3
// BRDF      1: times the light's cosine; 0: times its scale
// GRID      1: records look up the one view of a grid in the place of three
// DIRECTIONS  1: records have the view and the light themselves
// ENTRIES   entries of a work-item
#include "encoding.cl"

#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef BRDF
#define BRDF 0
#endif
#ifndef GRID
#define GRID 0
#endif
#ifndef DIRECTIONS
#define DIRECTIONS 0
#endif
#ifndef ENTRIES
#define ENTRIES 64
#endif

#define EACH(i, count)                                                    \
  const ulong end = min((get_global_id(0) + 1) * ENTRIES, (ulong)(count)); \
  for (ulong i = get_global_id(0) * ENTRIES; i < end; ++i)

#define VIEWS (GRID ? 1 : 3)
#define TAPS (4 + VIEWS + 3)
#define WORDS (TAPS + 4 + (GRID ? 0 : VIEWS) + 3)

// Records of 4 texels, 3 lights, and 3 views or one of a grid.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void write_lookups(ulong count, __global const uint* restrict list,
                            __global const uint* restrict point_of,
                            __global const uint* restrict taps, __global const uint* restrict views,
                            __global const uint* restrict grid_views,
                            __global const uint* restrict lights, __global uint* restrict lookups) {
  EACH(i, count) {
    const ulong sample = list[i] >> 1;
    const ulong point = point_of[sample];
    __global const uint* texels = taps + (2 * point + (list[i] & 1)) * 8;
#if !GRID
    __global const uint* view = views + 8 * point;
#endif
    __global const uint* light = lights + 8 * sample;
    __global uint* record = lookups + WORDS * i;
    for (uint k = 0; k < 4; ++k) record[k] = texels[k], record[TAPS + k] = texels[4 + k];
#if GRID
    record[4] = grid_views[point];
#else
    for (uint k = 0; k < VIEWS; ++k) record[4 + k] = view[k], record[TAPS + 4 + k] = view[3 + k];
#endif
    for (uint k = 0; k < 3; ++k) {
      record[4 + VIEWS + k] = light[k], record[WORDS - 3 + k] = light[3 + k];
    }
  }
}

// Records of 4 texels, a view and a light.
//
//   views, lights: [points], [samples]: directions
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void write_direction_lookups(ulong count, __global const uint* restrict list,
                                      __global const uint* restrict point_of,
                                      __global const uint* restrict taps,
                                      __global const float4* restrict views,
                                      __global const float4* restrict lights,
                                      __global uint* restrict lookups) {
  EACH(i, count) {
    const ulong sample = list[i] >> 1;
    const ulong point = point_of[sample];
    __global const uint* texels = taps + (2 * point + (list[i] & 1)) * 8;
    __global uint* record = lookups + 14 * i;
    for (uint k = 0; k < 4; ++k) record[k] = texels[k], record[10 + k] = texels[4 + k];
    vstore3(as_uint3(views[point].xyz), 0, record + 4);
    vstore3(as_uint3(lights[sample].xyz), 0, record + 7);
  }
}

// Records of 4 texels and 3 views of the mask.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void write_mask_lookups(ulong count, __global const uint* restrict list,
                                 __global const uint* restrict taps,
                                 __global const uint* restrict views,
                                 __global uint* restrict lookups) {
  EACH(i, count) {
    __global const uint* texels = taps + (ulong)list[i] * 8;
    __global const uint* view = views + 8 * (ulong)(list[i] >> 1);
    __global uint* record = lookups + 15 * i;
    for (uint k = 0; k < 4; ++k) record[k] = texels[k], record[8 + k] = texels[4 + k];
    for (uint k = 0; k < 3; ++k) record[4 + k] = view[k], record[12 + k] = view[3 + k];
    record[7] = 0;
  }
}

// masks[entry] = (m, opacity): the values looked up, within [0, 1], which are both.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void set_masks(ulong count, __global const uint* restrict list,
                        __global const float* restrict values, __global float2* restrict masks) {
  EACH(i, count) masks[list[i]] = (float2)(clamp(values[i], 0.0f, 1.0f));
}

// The same of pairs of values: m and the opacity, or, where `mapped`, m and the O of eq. (26).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void set_opacities(ulong count, __global const uint* restrict list,
                            __global const float2* restrict values, uint mapped, float threshold,
                            float weight, __global float2* restrict masks) {
  EACH(i, count) {
    const float2 value = values[i];
    const float below = value.y > 0.0f ? fmin(weight * value.y, 1.0f) : 0.0f;
    const float opacity = value.y >= threshold ? 1.0f : below;
    masks[list[i]] =
        (float2)(clamp(value.x, 0.0f, 1.0f), mapped ? opacity : clamp(value.y, 0.0f, 1.0f));
  }
}

// light[entry] = share linear(value) factor irradiance, value: [count][CHANNELS]. What was looked up
// in directions has the light's scale in it; there is none from below the horizon.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void light_entries(ulong count, __global const uint* restrict list,
                            __global const uint* restrict point_of,
                            __global const float* restrict values,
                            __global const float* restrict share,
                            __global const float2* restrict masks,
#if DIRECTIONS
                            __global const float4* restrict lights,
#else
                            __global const uint* restrict lights,
#endif
                            __global const float4* restrict irradiance,
                            __global float4* restrict light) {
  EACH(i, count) {
    const uint entry = list[i];
    const ulong sample = entry >> 1;
    const ulong slot = 2 * (ulong)point_of[sample] + (entry & 1);
    const float mask = masks[slot].x, opacity = masks[slot].y;
    float linear_value[CHANNELS];
    for (uint c = 0; c < CHANNELS; ++c) {
      const float value = values[i * CHANNELS + c];
      // Premultiplied values are decoded as if the material were everywhere. What a lossy model
      // leaves in a hole is not made brighter than white.
      const float whole = ENCODING ? fmin(value / mask, fmax(value, 1.0f)) : value / mask;
      linear_value[c] = value > 0.0f && mask > 0.0f ? opacity * to_linear(whole) : 0.0f;
    }
#if DIRECTIONS
    const float cosine = lights[sample].z, scale = cosine > 0.0f ? 1.0f : 0.0f;
#else
    const float scale = as_float(lights[8 * sample + 6]), cosine = as_float(lights[8 * sample + 7]);
#endif
    const float factor = share[slot] * (BRDF ? fmax(cosine, 0.0f) : scale);
    const float4 rgb = (float4)(linear_value[0], linear_value[CHANNELS == 3 ? 1 : 0],
                                linear_value[CHANNELS == 3 ? 2 : 0], 0.0f);
    light[entry] = factor * rgb * irradiance[sample];
  }
}

// radiance[point] = sum of its samples' entries, and its opacity.
//
//   first: [points + 1]: the first light sample of each point
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void sum_points(ulong points, __global const uint* restrict first,
                         __global const float* restrict share,
                         __global const float2* restrict masks,
                         __global const float4* restrict light, __global float4* restrict radiance) {
  EACH(i, points) {
    float4 sum = 0.0f;
    const bool both = share[2 * i + 1] > 0.0f;
    for (uint s = first[i]; s < first[i + 1]; ++s) {
      sum += light[2 * (ulong)s];
      if (both) sum += light[2 * (ulong)s + 1];
    }
    sum.w = share[2 * i] * masks[2 * i].y;
    if (both) sum.w += share[2 * i + 1] * masks[2 * i + 1].y;
    radiance[i] = sum;
  }
}
