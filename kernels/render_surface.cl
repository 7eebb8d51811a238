// Renders a periodic height field, as woven cloth is one, one view at a time:
//
//   T[l, row, column] = 1/S sum_s f(v, l) max(0, n.l) visible(hit_s, l)
//   f(v, l) = albedo / pi + F(v.h) D(h) V(v, l)
//
// surface_hits   finds what the S view rays of each texel meet: once per view.
// surface_shade  marches the shadow rays of 8 lights at a time, one light per lane, and shades.
//
// The surface is `rows` x `columns` samples, powers of two; sample (r, c) at index r columns + c, y up.
// Between them it is bilinear. Positions are in cells of it, elevations in its own units.
//
//   elevation  float   [rows][columns]
//   shape      float4  [rows][columns]  normal x, normal y, fibre x, fibre y
//   color      float4  [rows][columns]  albedo r, g, b, index of the lobe
//   lobes      float   [lobe][8]        f0 r, g, b, f90, roughness along, across, 0, 0
//   lights     float8  [chunk][6]       x, y, z of 8 unit vectors; x, y, z of their marching steps
//   hits       float   [texel][sample][13], for a band, a rectangle of texels, row by row:
//                x, y, z, lobe | normal x, y, z | fibre x, y, z | albedo r, g, b
//   out        VALUE   [light][texel][3], for the same band
//
// Every value depends on its own view, light, texel and sample alone, in a fixed order: the same bits
// whatever the band, the run of lights or the work-group.

// Type of the output: 0 unsigned char with sRGB encoding, 1 half, 2 float.
#ifndef OUTPUT
#define OUTPUT 2
#endif

// Halvings of a step of the view ray, before the secant: 0 to 10.
#ifndef VIEW_BISECTIONS
#define VIEW_BISECTIONS 4
#endif

#if OUTPUT == 0
#define VALUE uchar
#elif OUTPUT == 1
#define VALUE ushort
#else
#define VALUE float
#endif

// Values of a hit.
#define HIT_VALUES 13

// 1 / pi
#define INV_PI 0.318309886f

// Eight loads: OpenCL C has no gather.
#define GATHER8(table, i)                                                                      \
  (float8)((table)[(i).s0], (table)[(i).s1], (table)[(i).s2], (table)[(i).s3], (table)[(i).s4], \
           (table)[(i).s5], (table)[(i).s6], (table)[(i).s7])

// A bilinear look-up: the indices of four samples and the fractions between them.
typedef struct {
  uint i00, i10, i01, i11;
  float fx, fy;
} Patch;

Patch patch_at(float x, float y, uint columns, uint rows) {
  const float column = floor(x), row = floor(y);
  const uint c0 = (uint)(int)column & (columns - 1), c1 = (c0 + 1) & (columns - 1);
  const uint r0 = (uint)(int)row & (rows - 1), r1 = (r0 + 1) & (rows - 1);
  Patch p;
  p.i00 = r0 * columns + c0;
  p.i10 = r0 * columns + c1;
  p.i01 = r1 * columns + c0;
  p.i11 = r1 * columns + c1;
  p.fx = x - column;
  p.fy = y - row;
  return p;
}

float elevation_at(global const float* elevation, float x, float y, uint columns, uint rows) {
  const Patch p = patch_at(x, y, columns, rows);
  const float low = elevation[p.i00] + p.fx * (elevation[p.i10] - elevation[p.i00]);
  const float high = elevation[p.i01] + p.fx * (elevation[p.i11] - elevation[p.i01]);
  return low + p.fy * (high - low);
}

float8 elevation_at8(global const float* elevation, float8 x, float8 y, uint columns, uint rows) {
  const float8 column = floor(x), row = floor(y);
  const float8 fx = x - column, fy = y - row;
  const uint8 c0 = as_uint8(convert_int8(column)) & (columns - 1), c1 = (c0 + 1) & (columns - 1);
  const uint8 r0 = (as_uint8(convert_int8(row)) & (rows - 1)) * columns;
  const uint8 r1 = (r0 + columns) & (rows * columns - 1);
  const uint8 i00 = r0 + c0, i10 = r0 + c1, i01 = r1 + c0, i11 = r1 + c1;
  const float8 z00 = GATHER8(elevation, i00), z10 = GATHER8(elevation, i10);
  const float8 z01 = GATHER8(elevation, i01), z11 = GATHER8(elevation, i11);
  const float8 low = z00 + fx * (z10 - z00);
  const float8 high = z01 + fx * (z11 - z01);
  return low + fy * (high - low);
}

float4 blend4(global const float4* table, Patch p) {
  const float4 low = table[p.i00] + p.fx * (table[p.i10] - table[p.i00]);
  const float4 high = table[p.i01] + p.fx * (table[p.i11] - table[p.i01]);
  return low + p.fy * (high - low);
}

uint mix_bits(uint h) {
  h = (h ^ (h >> 16)) * 0x7feb352du;
  h = (h ^ (h >> 15)) * 0x846ca68bu;
  return h ^ (h >> 16);
}

// Work-item: one sample (dimension 2) of the texel at a column (0) and a row (1) of the band, which
// begins at first_column and first_row of the image.
// Point k of its ray is p + start + k step, from the highest elevation (k = 0) to the lowest
// (k = steps); p is the sample's point of the reference plane.
kernel void surface_hits(global const float* restrict elevation, global const float4* restrict shape,
                       global const float4* restrict color, uint columns, uint rows, ulong width,
                       ulong height, float columns_per_texel, float rows_per_texel,
                       ulong first_column, ulong band_columns, ulong first_row, ulong band_rows,
                       uint samples, uint view_key, float start_x, float start_y, float start_z,
                       float step_x, float step_y, float step_z, uint steps,
                       global float* restrict hits) {
  const ulong band_column = get_global_id(0), band_row = get_global_id(1);
  const uint sample = (uint)get_global_id(2);
  if (band_column >= band_columns || band_row >= band_rows || sample >= samples) return;
  const ulong item = (band_row * band_columns + band_column) * samples + sample;
  const ulong texel_column = first_column + band_column, texel_row = first_row + band_row;
  const ulong texel = texel_row * width + texel_column;

  // Where in the texel: a Kronecker sequence shifted by a hash of view and texel.
  const uint key = mix_bits(view_key ^ mix_bits((uint)texel ^ mix_bits((uint)(texel >> 32))));
  const uint u = mix_bits(key ^ 0x68bc21ebu) + sample * 3242174889u;
  const uint v = mix_bits(key ^ 0x02e5be93u) + sample * 2447445414u;
  const float unit = 0x1p-24f;
  const float column = (float)texel_column, top = (float)(height - texel_row);
  const float x = (column + (float)(u >> 8) * unit) * columns_per_texel + start_x;
  const float y = (top - (float)(v >> 8) * unit) * rows_per_texel + start_y;

#define ABOVE(k)              \
  (start_z + (k)*step_z -     \
   elevation_at(elevation, x + (k)*step_x, y + (k)*step_y, columns, rows))

  // March until below the surface. The last point lies at the lowest elevation, so it is.
  float high = 0, low = 0;
  float above_high = ABOVE(0.0f), above_low = 0;
  for (uint step = 1; step <= steps; ++step) {
    low = (float)step;
    above_low = ABOVE(low);
    if (step == steps) above_low = min(above_low, 0.0f);
    if (above_low <= 0) break;
    high = low;
    above_high = above_low;
  }
  // Halve the step, then take the chord.
  for (int i = 0; i < VIEW_BISECTIONS; ++i) {
    const float middle = 0.5f * (high + low);
    const float above_middle = ABOVE(middle);
    if (above_middle > 0) {
      high = middle;
      above_high = above_middle;
    } else {
      low = middle;
      above_low = above_middle;
    }
  }
  const float drop = above_high - above_low;
  const float k = drop > 0 ? high + (low - high) * (above_high / drop) : high;
#undef ABOVE
  const float hit_x = x + k * step_x, hit_y = y + k * step_y;
  const float hit_z = elevation_at(elevation, hit_x, hit_y, columns, rows);

  // What is seen there. The lobe is that of the nearest sample.
  const Patch p = patch_at(hit_x, hit_y, columns, rows);
  const float4 form = blend4(shape, p);
  const float4 albedo = blend4(color, p);
  const uint nearest =
      p.fy >= 0.5f ? (p.fx >= 0.5f ? p.i11 : p.i01) : (p.fx >= 0.5f ? p.i10 : p.i00);
  const float lobe = color[nearest].w;
  const float upright = sqrt(max(1 - form.x * form.x - form.y * form.y, 1e-4f));
  const float length = sqrt(form.x * form.x + form.y * form.y + upright * upright);
  const float nx = form.x / length, ny = form.y / length, nz = upright / length;
  // Fibres of crossing yarns may cancel each other between two samples.
  const float fibre = sqrt(max(form.z * form.z + form.w * form.w, 1e-8f));
  const float fx = form.z / fibre, fy = form.w / fibre;
  // Of the fibre's direction, the part perpendicular to the normal.
  const float lean = nx * fx + ny * fy;
  const float tx = fx - lean * nx, ty = fy - lean * ny, tz = -lean * nz;
  const float aside = max(sqrt(tx * tx + ty * ty + tz * tz), 1e-4f);

  global float* hit = hits + HIT_VALUES * item;
  hit[0] = hit_x;
  hit[1] = hit_y;
  hit[2] = hit_z;
  hit[3] = lobe;
  hit[4] = nx;
  hit[5] = ny;
  hit[6] = nz;
  hit[7] = tx / aside;
  hit[8] = ty / aside;
  hit[9] = tz / aside;
  hit[10] = albedo.x;
  hit[11] = albedo.y;
  hit[12] = albedo.z;
}

#if OUTPUT == 0
// sRGB encoding of a linear value, in 255ths.
uchar8 encoded(float8 linear_value) {
  const float8 x = clamp(linear_value, 0.0f, 1.0f);
  const float8 curve = 1.055f * powr(x, 1 / 2.4f) - 0.055f;
  return convert_uchar8_sat(floor(255 * select(curve, 12.92f * x, x <= 0.0031308f) + 0.5f));
}
#elif OUTPUT == 1
// binary16 bits of values that are not negative, round to nearest even, by integer arithmetic: stores
// of half are slow or need an extension. Adding 1/2 aligns the last place of half's subnormals with
// that of the sum.
ushort8 encoded(float8 x) {
  x = min(x, 65504.0f);
  const uint8 bits = as_uint8(x);
  const uint8 normal_bits = (bits - (112u << 23) + 0xfffu + ((bits >> 13) & 1u)) >> 13;
  const uint8 small_bits = as_uint8(x + 0.5f) - as_uint8((float8)(0.5f));
  return convert_ushort8(select(normal_bits, small_bits, x < 0x1p-14f));
}
#else
float8 encoded(float8 x) {
  return x;
}
#endif

// Work-item: one texel of the band (dimension 0) under 8 lights (dimension 1).
kernel void surface_shade(global const float* restrict elevation, uint columns, uint rows,
                        float highest, float bias, global const float* restrict hits,
                        global const float* restrict lobes, global const float8* restrict lights,
                        ulong light_count, float view_x, float view_y, float view_z, ulong texels,
                        uint samples, global VALUE* restrict out) {
  const ulong texel = get_global_id(0);
  const ulong chunk = get_global_id(1);
  if (texel >= texels || 8 * chunk >= light_count) return;
  const float8 lx = lights[6 * chunk], ly = lights[6 * chunk + 1], lz = lights[6 * chunk + 2];
  const float8 step_x = lights[6 * chunk + 3], step_y = lights[6 * chunk + 4],
               step_z = lights[6 * chunk + 5];

  float8 red = 0, green = 0, blue = 0;
  for (uint s = 0; s < samples; ++s) {
    global const float* hit = hits + HIT_VALUES * (texel * samples + s);
    const float x = hit[0], y = hit[1], z0 = hit[2] + bias;
    const float nx = hit[4], ny = hit[5], nz = hit[6];
    const float tx = hit[7], ty = hit[8], tz = hit[9];
    const float bx = ny * tz - nz * ty, by = nz * tx - nx * tz, bz = nx * ty - ny * tx;
    const float8 nl = nx * lx + ny * ly + nz * lz;

    // Shadow rays: a lane marches until it is above everything or below the surface.
    const int8 faces = nl > 0;
    int8 lit = faces;
    int8 marching = faces;
    for (float k = 1; any(marching); ++k) {
      const float8 z = z0 + k * step_z;
      marching &= z < highest;
      const float8 ground = elevation_at8(elevation, x + k * step_x, y + k * step_y,
                                          columns, rows);
      const int8 blocked = marching & (z < ground);
      lit &= ~blocked;
      marching &= ~blocked;
    }
    if (!any(lit)) continue;

    // The glossy lobe, with h = (v + l) / |v + l|, so that v.h = |v + l| / 2.
    const float nv = nx * view_x + ny * view_y + nz * view_z;
    float8 gloss = 0, grazing = 0;
    global const float* lobe = lobes + 8 * (uint)hit[3];
    const float along = lobe[4], across = lobe[5];
    if (nv > 0) {
      const float vt = tx * view_x + ty * view_y + tz * view_z;
      const float vb = bx * view_x + by * view_y + bz * view_z;
      const float8 lt = tx * lx + ty * ly + tz * lz;
      const float8 lb = bx * lx + by * ly + bz * lz;
      const float8 hx = view_x + lx, hy = view_y + ly, hz = view_z + lz;
      const float8 hh = hx * hx + hy * hy + hz * hz;
      const float8 ht = (vt + lt) / along;
      const float8 hb = (vb + lb) / across;
      const float8 hn = nv + nl;
      const float8 spread = (ht * ht + hb * hb + hn * hn) / hh;
      const float8 distribution = INV_PI / (along * across * spread * spread);
      const float view_length = sqrt(along * along * vt * vt + across * across * vb * vb + nv * nv);
      const float8 light_length =
          sqrt(along * along * lt * lt + across * across * lb * lb + nl * nl);
      gloss = distribution * 0.5f / (nl * view_length + nv * light_length);
      const float8 c = max(1 - 0.5f * sqrt(hh), 0.0f);
      grazing = c * c * c * c * c;
    }
    const float8 f90 = lobe[3] * grazing;
    const float8 rest = 1 - grazing;
    const float8 weight = select((float8)(0), nl, lit);
    gloss = select((float8)(0), gloss, lit);
    red += weight * (hit[10] * INV_PI + gloss * (lobe[0] * rest + f90));
    green += weight * (hit[11] * INV_PI + gloss * (lobe[1] * rest + f90));
    blue += weight * (hit[12] * INV_PI + gloss * (lobe[2] * rest + f90));
  }

  const float scale = 1.0f / (float)samples;
  VALUE r[8], g[8], bl[8];
  vstore8(encoded(red * scale), 0, r);
  vstore8(encoded(green * scale), 0, g);
  vstore8(encoded(blue * scale), 0, bl);
  const ulong first = 8 * chunk;
  const ulong count = min(light_count - first, (ulong)8);
  for (ulong lane = 0; lane < count; ++lane) {
    global VALUE* value = out + 3 * ((first + lane) * texels + texel);
    value[0] = r[lane];
    value[1] = g[lane];
    value[2] = bl[lane];
  }
}
