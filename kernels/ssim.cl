// Structural similarity of decoded images y to the raw ones x (lib/weft/metrics/ssim.hpp), summed over
// the windows inside each image:
//
//   partial[image, block of rows, block of 8 columns] = sum over the block's windows of (1 - SSIM)
//
//   raw:     [images][Y][X C] of the stored type
//   decoded: [images][Y][X C] of float
//
// With d = x - y, 2 cov = var_x + var_y - var_d and 2 mu_x mu_y = mu_x^2 + mu_y^2 - mu_d^2, hence
//
//   SSIM = (1 - p) (1 - q),  p = mu_d^2 / (mu_x^2 + mu_y^2 + C1),  q = var_d / (var_x + var_y + C2)
//
// and 1 - SSIM = p + q - p q: exactly 0 for equal images, and accurate for nearly equal ones, where the
// covariance would cancel. Variances are taken about a value of x near the window, which they don't
// depend on: E[x^2] - mu^2 of values far from 0 would cancel.
//
// Work-item (8 columns, ROWS rows of windows, image): sums along a row of the image in registers, along
// columns through a ring of the last 11 rows.
//
// ROWS  rows of windows of a work-item
#include "tile_values.cl"

#ifndef ROWS
#define ROWS 32
#endif

#define WINDOW 11

// `lanes` values, zeros behind them.
inline float8 raw_lanes(__global const raw_t* p, uint lanes) {
  if (lanes == 8) return tile_load8(p);
  float values[8] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
  for (uint lane = 0; lane < lanes; ++lane) values[lane] = tile_load(p + lane);
  return vload8(0, values);
}
inline float8 float_lanes(__global const float* p, uint lanes) {
  if (lanes == 8) return vload8(0, p);
  float values[8] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
  for (uint lane = 0; lane < lanes; ++lane) values[lane] = p[lane];
  return vload8(0, values);
}

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void ssim(__global const raw_t* restrict raw, __global const float* restrict decoded,
                   __global const float* restrict weights, ulong height, ulong row_values,
                   ulong channels, float scale, float c1, float c2, __global float* restrict partial) {
  const ulong columns = row_values - (WINDOW - 1) * channels;
  const ulong rows = height - (WINDOW - 1);
  const ulong column = get_global_id(0) * 8;
  const ulong first_row = get_global_id(1) * ROWS;
  const ulong image = get_global_id(2) * height * row_values;
  const uint lanes = (uint)min(columns - column, (ulong)8);
  const uint count = (uint)min(rows - first_row, (ulong)ROWS);
  __global const raw_t* x_rows = raw + image + first_row * row_values + column;
  __global const float* y_rows = decoded + image + first_row * row_values + column;

  float w[WINDOW];
  for (uint t = 0; t < WINDOW; ++t) w[t] = weights[t];
  // the centre of the first row's windows
  const float8 shift =
      scale * raw_lanes(x_rows + (WINDOW / 2) * (row_values + channels), lanes);

  float8 ring[WINDOW][5];
  float8 sum = 0.0f;
  uint slot = 0;
  for (uint row = 0; row < count + WINDOW - 1; ++row) {
    // along the row: x and d, and the squares of x, y and d
    float8 sx = 0.0f, sd = 0.0f, sxx = 0.0f, syy = 0.0f, sdd = 0.0f;
    for (uint t = 0; t < WINDOW; ++t) {
      const float8 raw_x = scale * raw_lanes(x_rows + t * channels, lanes);
      const float8 d = raw_x - scale * float_lanes(y_rows + t * channels, lanes);
      const float8 x = raw_x - shift;
      const float8 y = x - d;
      const float8 wx = w[t] * x, wy = w[t] * y, wd = w[t] * d;
      sx += wx;
      sd += wd;
      sxx = fma(wx, x, sxx);
      syy = fma(wy, y, syy);
      sdd = fma(wd, d, sdd);
    }
    ring[slot][0] = sx;
    ring[slot][1] = sd;
    ring[slot][2] = sxx;
    ring[slot][3] = syy;
    ring[slot][4] = sdd;
    slot = slot + 1 == WINDOW ? 0 : slot + 1;
    x_rows += row_values;
    y_rows += row_values;
    if (row + 1 < WINDOW) continue;

    // along the columns; the oldest row is next in the ring
    float8 mx = 0.0f, md = 0.0f, mxx = 0.0f, myy = 0.0f, mdd = 0.0f;
    uint at = slot;
    for (uint t = 0; t < WINDOW; ++t) {
      mx = fma((float8)w[t], ring[at][0], mx);
      md = fma((float8)w[t], ring[at][1], md);
      mxx = fma((float8)w[t], ring[at][2], mxx);
      myy = fma((float8)w[t], ring[at][3], myy);
      mdd = fma((float8)w[t], ring[at][4], mdd);
      at = at + 1 == WINDOW ? 0 : at + 1;
    }
    const float8 my = mx - md;
    const float8 variances = (mxx - mx * mx) + (myy - my * my);
    const float8 mu_x = mx + shift, mu_y = my + shift;
    const float8 p = md * md / (mu_x * mu_x + mu_y * mu_y + c1);
    const float8 q = (mdd - md * md) / (variances + c2);
    sum += p + q - p * q;
  }

  float values[8];
  vstore8(sum, 0, values);
  float total = 0.0f;
  for (uint lane = 0; lane < lanes; ++lane) total += values[lane];
  partial[(get_global_id(2) * get_global_size(1) + get_global_id(1)) * get_global_size(0) +
          get_global_id(0)] = total;
}
