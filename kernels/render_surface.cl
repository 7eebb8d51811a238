// Renders a surface of layers (weft/scene/surface.hpp), one view at a time:
//
//   T[l, row, column] = 1/S sum_s f(v, l) max(0, n.l) visible(hit_s, l)
//   f(v, l) = albedo / pi + F(v.h) D(h) V(v, l)
//
// and with one bounce, per sample, the diffuse light of one more point of the surface, which a ray
// meets that leaves the hit in a direction drawn by the cosine to its normal:
//
//   + albedo albedo' / pi max(0, n'.l) visible(hit'_s, l)
//
// surface_hits    finds what the S view rays of each texel meet: once per view.
// surface_bounce  finds what one more ray from each of these hits meets.
// surface_shade   marches the shadow rays of VW lights at a time, one light per lane, and shades.
// surface_mask    tells which view rays meet material.
//
//   heights, ceilings   see surface_march.cl
//   shape     float4  [layer][rows][columns]  normal x, normal y of the top, fibre x, fibre y
//   color     float4  [layer][rows][columns]  albedo r, g, b, index of the lobe
//   lobes     float   [lobe][8]        f0 r, g, b, f90, roughness along, across, 0, 0
//   lights    realv   [chunk][6]       x, y, z of VW unit vectors; x, y, z of their marching steps
//   hits      float   [texel][sample][13], for a band, a rectangle of texels, row by row:
//               x, y, z of where shadow rays begin, lobe (-1: the ray met nothing) | normal x, y, z |
//               fibre x, y, z | albedo r, g, b
//   bounces   float   [texel][sample][9]   x, y, z likewise | normal x, y, z | albedo albedo' / pi
//   out       VALUE   [light][texel][3], for the same band
//
// Every value depends on its own view, light, texel and sample alone, in a fixed order: the same bits
// whatever the band, the run of lights or the work-group.

// Type of the output: 0 unsigned char with sRGB encoding, 1 half, 2 float.
#ifndef OUTPUT
#define OUTPUT 2
#endif

// Whether light that comes by way of one more point of the surface is added.
#ifndef BOUNCES
#define BOUNCES 0
#endif

#include "vector_width.cl"
#include "surface_march.cl"

#if OUTPUT == 0
#define VALUE uchar
#elif OUTPUT == 1
#define VALUE ushort
#else
#define VALUE float
#endif

#if VW == 8
typedef uchar8 ucharv;
typedef ushort8 ushortv;
#define to_ucharv_sat(x) convert_uchar8_sat(x)
#define to_ushortv(x) convert_ushort8(x)
#define as_uintv(x) as_uint8(x)
#define store_lanes(x, p) vstore8(x, 0, p)
#else
typedef uchar16 ucharv;
typedef ushort16 ushortv;
#define to_ucharv_sat(x) convert_uchar16_sat(x)
#define to_ushortv(x) convert_ushort16(x)
#define as_uintv(x) as_uint16(x)
#define store_lanes(x, p) vstore16(x, 0, p)
#endif

// Values of a hit, and of what its second ray meets.
#define HIT_VALUES 13
#define BOUNCE_VALUES 9

// 1 / pi
#define INV_PI 0.318309886f

// What the samples of a layer say, interpolated.
float4 blend4(const Ground* ground, global const float4* table, Place p) {
  const uint columns = ground->columns, rows = ground->rows;
  const uint r0 = p.index & ~(columns - 1), c0 = p.index & (columns - 1);
  const uint r1 = (r0 + columns) & (rows * columns - 1), c1 = (c0 + 1) & (columns - 1);
  const float4 low = table[r0 + c0] + p.fx * (table[r0 + c1] - table[r0 + c0]);
  const float4 high = table[r1 + c0] + p.fx * (table[r1 + c1] - table[r1 + c0]);
  return low + p.fy * (high - low);
}

// The sample that is nearest to a point.
uint nearest_sample(const Ground* ground, Place p) {
  const uint columns = ground->columns, rows = ground->rows;
  uint r = p.index & ~(columns - 1), c = p.index & (columns - 1);
  if (p.fx >= 0.5f) c = (c + 1) & (columns - 1);
  if (p.fy >= 0.5f) r = (r + columns) & (rows * columns - 1);
  return r + c;
}

// Unit normal of an underside, which points down: from its central differences, interpolated.
float4 underside_normal(const Ground* ground, uint table, float x, float y, float cells_x,
                        float cells_y) {
  const float slope_x = 0.5f * cells_x * (height_at(ground, table, place_at(ground, x + 1, y)) -
                                          height_at(ground, table, place_at(ground, x - 1, y)));
  const float slope_y = 0.5f * cells_y * (height_at(ground, table, place_at(ground, x, y + 1)) -
                                          height_at(ground, table, place_at(ground, x, y - 1)));
  const float scale = 1 / sqrt(1 + slope_x * slope_x + slope_y * slope_y);
  return (float4)(slope_x * scale, slope_y * scale, -scale, 0);
}

// Unit normal of the face that was entered. `form`: interpolated normal x, y of the top.
float4 normal_at(const Ground* ground, Entry entry, float4 form, float x, float y, float cells_x,
                 float cells_y) {
#if UNDERSIDES
  if (entry.under) {
    return underside_normal(ground, UNDERSIDE_TABLE(entry.layer), x, y, cells_x, cells_y);
  }
#endif
  const float upright = sqrt(max(1 - form.x * form.x - form.y * form.y, 1e-4f));
  const float length = sqrt(form.x * form.x + form.y * form.y + upright * upright);
  return (float4)(form.x / length, form.y / length, upright / length, 0);
}

// Where rays that leave an entry begin.
float4 departure(const Ground* ground, Entry entry, float x, float y, float bias) {
  const Place p = place_at(ground, x, y);
#if UNDERSIDES
  if (entry.under) {
    return (float4)(x, y, height_at(ground, UNDERSIDE_TABLE(entry.layer), p) - bias, 0);
  }
#endif
  return (float4)(x, y, height_at(ground, entry.layer, p) + bias, 0);
}

uint mix_bits(uint h) {
  h = (h ^ (h >> 16)) * 0x7feb352du;
  h = (h ^ (h >> 15)) * 0x846ca68bu;
  return h ^ (h >> 16);
}

uint texel_key(uint view_key, ulong texel) {
  return mix_bits(view_key ^ mix_bits((uint)texel ^ mix_bits((uint)(texel >> 32))));
}

// A number in [0, 1): the `sample`-th of a Kronecker sequence that a key shifts.
float sequence(uint key, uint sample, uint step) {
  return (float)((mix_bits(key) + sample * step) >> 8) * 0x1p-24f;
}

// Where the view ray of a sample of a texel meets the surface. Point k of its ray is
// p + start + k step, from the highest elevation (k = 0) to the lowest (k = steps); p is the sample's
// point of the reference plane.
Entry meet_view_ray(const Ground* ground, ulong width, ulong height, float columns_per_texel,
                    float rows_per_texel, ulong texel_column, ulong texel_row, uint sample,
                    uint view_key, float start_x, float start_y, float start_z, float step_x,
                    float step_y, float step_z, uint steps, float* hit_x, float* hit_y) {
  // Where in the texel: a Kronecker sequence shifted by a hash of view and texel.
  const uint key = texel_key(view_key, texel_row * width + texel_column);
  const float u = sequence(key ^ 0x68bc21ebu, sample, 3242174889u);
  const float v = sequence(key ^ 0x02e5be93u, sample, 2447445414u);
  const float column = (float)texel_column, top = (float)(height - texel_row);
  const float x = (column + u) * columns_per_texel + start_x;
  const float y = (top - v) * rows_per_texel + start_y;
  const Entry entry = trace(ground, x, y, start_z, step_x, step_y, step_z, steps, 1);
  *hit_x = x + entry.k * step_x;
  *hit_y = y + entry.k * step_y;
  return entry;
}

// Work-item: one sample (dimension 2) of the texel at a column (0) and a row (1) of the band, which
// begins at first_column and first_row of the image. cells_x, cells_y: per length.
kernel void surface_hits(global const float4* restrict heights, global const float* restrict ceilings,
                         global const float4* restrict shape, global const float4* restrict color,
                         uint columns, uint rows, float lowest, float highest, float cells_x,
                         float cells_y, float bias, ulong width, ulong height,
                         float columns_per_texel, float rows_per_texel, ulong first_column,
                         ulong band_columns, ulong first_row, ulong band_rows, uint samples,
                         uint view_key, float start_x, float start_y, float start_z, float step_x,
                         float step_y, float step_z, uint steps, global float* restrict hits) {
  const ulong band_column = get_global_id(0), band_row = get_global_id(1);
  const uint sample = (uint)get_global_id(2);
  if (band_column >= band_columns || band_row >= band_rows || sample >= samples) return;
  const Ground ground = {heights, ceilings, columns, rows, lowest, highest};
  global float* hit = hits + HIT_VALUES * ((band_row * band_columns + band_column) * samples + sample);

  float x, y;
  const Entry entry =
      meet_view_ray(&ground, width, height, columns_per_texel, rows_per_texel,
                    first_column + band_column, first_row + band_row, sample, view_key, start_x,
                    start_y, start_z, step_x, step_y, step_z, steps, &x, &y);
  if (entry.layer < 0) {
    for (int i = 0; i < HIT_VALUES; ++i) hit[i] = i == 3 ? -1.0f : 0.0f;
    return;
  }

  // What is seen there. The lobe is that of the nearest sample.
  const Place p = place_at(&ground, x, y);
  shape += (size_t)entry.layer * rows * columns;
  color += (size_t)entry.layer * rows * columns;
  const float4 form = blend4(&ground, shape, p);
  const float4 albedo = blend4(&ground, color, p);
  const float4 n = normal_at(&ground, entry, form, x, y, cells_x, cells_y);
  // Fibres of crossing yarns may cancel each other between two samples.
  const float fibre = sqrt(max(form.z * form.z + form.w * form.w, 1e-8f));
  const float fx = form.z / fibre, fy = form.w / fibre;
  // Of the fibre's direction, the part perpendicular to the normal.
  const float lean = n.x * fx + n.y * fy;
  const float tx = fx - lean * n.x, ty = fy - lean * n.y, tz = -lean * n.z;
  const float aside = max(sqrt(tx * tx + ty * ty + tz * tz), 1e-4f);

  const float4 start = departure(&ground, entry, x, y, bias);
  hit[0] = start.x;
  hit[1] = start.y;
  hit[2] = start.z;
  hit[3] = color[nearest_sample(&ground, p)].w;
  hit[4] = n.x;
  hit[5] = n.y;
  hit[6] = n.z;
  hit[7] = tx / aside;
  hit[8] = ty / aside;
  hit[9] = tz / aside;
  hit[10] = albedo.x;
  hit[11] = albedo.y;
  hit[12] = albedo.z;
}

// Work-item: one texel of an image of `width` x `height`, with one sample each.
// mask: [height][width], 1 where the view ray meets material.
kernel void surface_mask(global const float4* restrict heights, global const float* restrict ceilings,
                         uint columns, uint rows, float lowest, float highest, ulong width,
                         ulong height, float columns_per_texel, float rows_per_texel, uint view_key,
                         float start_x, float start_y, float start_z, float step_x, float step_y,
                         float step_z, uint steps, global uchar* restrict mask) {
  const ulong column = get_global_id(0), row = get_global_id(1);
  if (column >= width || row >= height) return;
  const Ground ground = {heights, ceilings, columns, rows, lowest, highest};
  float x, y;
  const Entry entry = meet_view_ray(&ground, width, height, columns_per_texel, rows_per_texel,
                                    column, row, 0, view_key, start_x, start_y, start_z, step_x,
                                    step_y, step_z, steps, &x, &y);
  mask[row * width + column] = entry.layer >= 0 ? 1 : 0;
}

#if BOUNCES
// Work-items as for surface_hits. least: the least of 1 / (cells that a step may go), reach: the most
// steps of a ray.
kernel void surface_bounce(global const float4* restrict heights,
                           global const float* restrict ceilings,
                           global const float4* restrict shape, global const float4* restrict color,
                           uint columns, uint rows, float lowest, float highest, float cells_x,
                           float cells_y, float bias, ulong width, ulong first_column,
                           ulong band_columns, ulong first_row, ulong band_rows, uint samples,
                           uint view_key, float least, uint reach, global const float* restrict hits,
                           global float* restrict bounces) {
  const ulong band_column = get_global_id(0), band_row = get_global_id(1);
  const uint sample = (uint)get_global_id(2);
  if (band_column >= band_columns || band_row >= band_rows || sample >= samples) return;
  const Ground ground = {heights, ceilings, columns, rows, lowest, highest};
  const ulong item = (band_row * band_columns + band_column) * samples + sample;
  global const float* hit = hits + HIT_VALUES * item;
  global float* bounce = bounces + BOUNCE_VALUES * item;
  for (int i = 0; i < BOUNCE_VALUES; ++i) bounce[i] = 0;
  if (hit[3] < 0) return;

  // A direction with the density cos / pi round the normal.
  const ulong texel = (first_row + band_row) * width + first_column + band_column;
  const uint key = texel_key(view_key, texel);
  const float u = sequence(key ^ 0x5851f42du, sample, 2700274807u);
  const float v = sequence(key ^ 0x14057b7eu, sample, 2313257605u);
  const float nx = hit[4], ny = hit[5], nz = hit[6];
  const float sign = nz >= 0 ? 1 : -1;
  const float a = -1 / (sign + nz), b = nx * ny * a;
  const float p = sqrt(u) * cos(6.28318531f * v), q = sqrt(u) * sin(6.28318531f * v);
  const float r = sqrt(1 - u);
  const float wx = p * (1 + sign * nx * nx * a) + q * b + r * nx;
  const float wy = p * sign * b + q * (sign + ny * ny * a) + r * ny;
  const float wz = -p * sign * nx - q * ny + r * nz;

  // March as far as there can be anything.
  const float step_cells = max(max(fabs(wx * cells_x), fabs(wy * cells_y)), least);
  const float step_x = wx * cells_x / step_cells, step_y = wy * cells_y / step_cells;
  const float step_z = wz / step_cells;
  const float way = (step_z > 0 ? highest : lowest) - hit[2];
  const float steps = step_z != 0 ? ceil(way / step_z) : (float)reach;
  const Entry entry = trace(&ground, hit[0], hit[1], hit[2], step_x, step_y, step_z,
                            (uint)clamp(steps, 0.0f, (float)reach), 0);
  if (entry.layer < 0) return;

  // What is there; its back reflects nothing.
  const float x = hit[0] + entry.k * step_x, y = hit[1] + entry.k * step_y;
  const Place place = place_at(&ground, x, y);
  const size_t layer = (size_t)entry.layer * rows * columns;
  const float4 form = blend4(&ground, shape + layer, place);
  const float4 albedo = blend4(&ground, color + layer, place);
  const float4 n = normal_at(&ground, entry, form, x, y, cells_x, cells_y);
  if (n.x * wx + n.y * wy + n.z * wz >= 0) return;
  const float4 start = departure(&ground, entry, x, y, bias);
  bounce[0] = start.x;
  bounce[1] = start.y;
  bounce[2] = start.z;
  bounce[3] = n.x;
  bounce[4] = n.y;
  bounce[5] = n.z;
  bounce[6] = hit[10] * albedo.x * INV_PI;
  bounce[7] = hit[11] * albedo.y * INV_PI;
  bounce[8] = hit[12] * albedo.z * INV_PI;
}
#endif

#if OUTPUT == 0
// sRGB encoding of a linear value, in 255ths.
ucharv encoded(realv linear_value) {
  const realv x = clamp(linear_value, 0.0f, 1.0f);
  const realv curve = 1.055f * powr(x, 1 / 2.4f) - 0.055f;
  return to_ucharv_sat(floor(255 * select(curve, 12.92f * x, x <= 0.0031308f) + 0.5f));
}
#elif OUTPUT == 1
// binary16 bits of values that are not negative, round to nearest even, by integer arithmetic: stores
// of half are slow or need an extension. Adding 1/2 aligns the last place of half's subnormals with
// that of the sum.
ushortv encoded(realv x) {
  x = min(x, 65504.0f);
  const uintv bits = as_uintv(x);
  const uintv normal_bits = (bits - (112u << 23) + 0xfffu + ((bits >> 13) & 1u)) >> 13;
  const uintv small_bits = as_uintv(x + 0.5f) - as_uintv((realv)(0.5f));
  return to_ushortv(select(normal_bits, small_bits, x < 0x1p-14f));
}
#else
realv encoded(realv x) {
  return x;
}
#endif

// Work-item: one texel of the band (dimension 0) under VW lights (dimension 1).
WIDE_VECTORS kernel void surface_shade(global const float4* restrict heights,
                                       global const float* restrict ceilings, uint columns,
                                       uint rows, float lowest, float highest,
                                       global const float* restrict hits,
#if BOUNCES
                                       global const float* restrict bounces,
#endif
                                       global const float* restrict lobes,
                                       global const realv* restrict lights, ulong light_count,
                                       float view_x, float view_y, float view_z, ulong texels,
                                       uint samples, global VALUE* restrict out) {
  const ulong texel = get_global_id(0);
  const ulong chunk = get_global_id(1);
  if (texel >= texels || VW * chunk >= light_count) return;
  const Ground ground = {heights, ceilings, columns, rows, lowest, highest};
  const realv lx = lights[6 * chunk], ly = lights[6 * chunk + 1], lz = lights[6 * chunk + 2];
  const realv step_x = lights[6 * chunk + 3], step_y = lights[6 * chunk + 4],
              step_z = lights[6 * chunk + 5];

  realv red = 0, green = 0, blue = 0;
  for (uint s = 0; s < samples; ++s) {
    global const float* hit = hits + HIT_VALUES * (texel * samples + s);
    if (hit[3] < 0) continue;
#if BOUNCES
    global const float* bounce = bounces + BOUNCE_VALUES * (texel * samples + s);
    if (max(max(bounce[6], bounce[7]), bounce[8]) > 0) {
      const realv cosine = bounce[3] * lx + bounce[4] * ly + bounce[5] * lz;
      const intv lit = lit_lanes(&ground, bounce[0], bounce[1], bounce[2], step_x, step_y, step_z,
                                 cosine > 0);
      const realv weight = select((realv)(0), cosine, lit);
      red += weight * bounce[6];
      green += weight * bounce[7];
      blue += weight * bounce[8];
    }
#endif
    const float nx = hit[4], ny = hit[5], nz = hit[6];
    const float tx = hit[7], ty = hit[8], tz = hit[9];
    const float bx = ny * tz - nz * ty, by = nz * tx - nx * tz, bz = nx * ty - ny * tx;
    const realv nl = nx * lx + ny * ly + nz * lz;
    const intv lit = lit_lanes(&ground, hit[0], hit[1], hit[2], step_x, step_y, step_z, nl > 0);
    if (!any(lit)) continue;

    // The glossy lobe, with h = (v + l) / |v + l|, so that v.h = |v + l| / 2.
    const float nv = nx * view_x + ny * view_y + nz * view_z;
    realv gloss = 0, grazing = 0;
    global const float* lobe = lobes + 8 * (uint)hit[3];
    const float along = lobe[4], across = lobe[5];
    if (nv > 0) {
      const float vt = tx * view_x + ty * view_y + tz * view_z;
      const float vb = bx * view_x + by * view_y + bz * view_z;
      const realv lt = tx * lx + ty * ly + tz * lz;
      const realv lb = bx * lx + by * ly + bz * lz;
      const realv hx = view_x + lx, hy = view_y + ly, hz = view_z + lz;
      const realv hh = hx * hx + hy * hy + hz * hz;
      const realv ht = (vt + lt) / along;
      const realv hb = (vb + lb) / across;
      const realv hn = nv + nl;
      const realv spread = (ht * ht + hb * hb + hn * hn) / hh;
      const realv distribution = INV_PI / (along * across * spread * spread);
      const float view_length = sqrt(along * along * vt * vt + across * across * vb * vb + nv * nv);
      const realv light_length =
          sqrt(along * along * lt * lt + across * across * lb * lb + nl * nl);
      gloss = distribution * 0.5f / (nl * view_length + nv * light_length);
      const realv c = max(1 - 0.5f * sqrt(hh), 0.0f);
      grazing = c * c * c * c * c;
    }
    const realv f90 = lobe[3] * grazing;
    const realv rest = 1 - grazing;
    const realv weight = select((realv)(0), nl, lit);
    gloss = select((realv)(0), gloss, lit);
    red += weight * (hit[10] * INV_PI + gloss * (lobe[0] * rest + f90));
    green += weight * (hit[11] * INV_PI + gloss * (lobe[1] * rest + f90));
    blue += weight * (hit[12] * INV_PI + gloss * (lobe[2] * rest + f90));
  }

  const float scale = 1.0f / (float)samples;
  VALUE r[VW], g[VW], bl[VW];
  store_lanes(encoded(red * scale), r);
  store_lanes(encoded(green * scale), g);
  store_lanes(encoded(blue * scale), bl);
  const ulong first = VW * chunk;
  const ulong count = min(light_count - first, (ulong)VW);
  for (ulong lane = 0; lane < count; ++lane) {
    global VALUE* value = out + 3 * ((first + lane) * texels + texel);
    value[0] = r[lane];
    value[1] = g[lane];
    value[2] = bl[lane];
  }
}
