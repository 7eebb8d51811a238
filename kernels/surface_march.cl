// How a ray meets a surface of layers (weft/scene/surface.hpp), one ray or VW rays at a time.
//
// Point k of a ray is p + k step, k = 0, 1, 2, ..., at most a cell apart in x and in y. There, for
// layer l,
//   above = z - elevation_l,   below = underside_l - z   (-1 where the layer is solid),
// and the ray is inside where both are negative. From point to point both are taken to be linear: a
// ray that has passed a sheet between two points met it if it was inside on the way.
//
// Positions are in cells, elevations in their own units. The surface is `rows` x `columns` samples,
// powers of two; sample (r, c) at index r columns + c, y up. Between them it is bilinear.
//
//   heights   float4  [table][rows][columns]  of the cell from (r, c) on, the values at its corners
//                     (r, c), (r, c+1), (r+1, c), (r+1, c+1): one load instead of four. Tables are the
//                     elevations of all layers, then the undersides of those that have one.
//   ceilings  float   [rows / BLOCK][columns / BLOCK]  the highest elevation of any layer within a
//                     block of cells and BLOCK + 1 cells round it. Who is above it stays clear of
//                     everything for BLOCK - 1 steps, which are left out; what is found is the same.

// Layers of the surface.
#ifndef LAYERS
#define LAYERS 1
#endif

// Which of them have an underside: bit l for layer l.
#ifndef UNDERSIDES
#define UNDERSIDES 0
#endif

// log2 of the side of a block of cells: 2 to 6.
#ifndef BLOCK_BITS
#define BLOCK_BITS 3
#endif
#define BLOCK (1 << BLOCK_BITS)

// Halvings of a step of a ray, before the chord: 0 to 10.
#ifndef BISECTIONS
#define BISECTIONS 4
#endif

#define HAS_UNDERSIDE(layer) ((UNDERSIDES >> (layer)) & 1)
#define UNDERSIDE_TABLE(layer) (LAYERS + popcount(UNDERSIDES & ((1 << (layer)) - 1)))

#if VW == 8
typedef int8 intv;
typedef uint8 uintv;
#define floor_to_uintv(x) as_uint8(convert_int8(x))
#else
typedef int16 intv;
typedef uint16 uintv;
#define floor_to_uintv(x) as_uint16(convert_int16(x))
#endif

// A surface and what is fixed for all of its rays.
typedef struct {
  global const float4* heights;
  global const float* ceilings;
  uint columns, rows;
  float lowest, highest;
} Ground;

// The cell of a point, and where in it the point lies.
typedef struct {
  uint index;
  float fx, fy;
} Place;

Place place_at(const Ground* ground, float x, float y) {
  const float column = floor(x), row = floor(y);
  const uint c = (uint)(int)column & (ground->columns - 1);
  const uint r = (uint)(int)row & (ground->rows - 1);
  Place place;
  place.index = r * ground->columns + c;
  place.fx = x - column;
  place.fy = y - row;
  return place;
}

float height_at(const Ground* ground, uint table, Place p) {
  const float4 z = ground->heights[table * ground->rows * ground->columns + p.index];
  const float low = z.x + p.fx * (z.y - z.x);
  const float high = z.z + p.fx * (z.w - z.z);
  return low + p.fy * (high - low);
}

float ceiling_at(const Ground* ground, float x, float y) {
  const uint c = (uint)(int)floor(x) & (ground->columns - 1);
  const uint r = (uint)(int)floor(y) & (ground->rows - 1);
  return ground->ceilings[(r >> BLOCK_BITS) * ((ground->columns + BLOCK - 1) >> BLOCK_BITS) +
                          (c >> BLOCK_BITS)];
}

// Where a ray enters material: at its point k, through the top or the underside of a layer.
typedef struct {
  float k;
  int layer;  // -1: nowhere
  int under;
} Entry;

// Height of a ray over the face of an entry; negative inside.
float outside(const Ground* ground, Entry entry, float x, float y, float z) {
  const Place p = place_at(ground, x, y);
#if UNDERSIDES
  if (entry.under) return height_at(ground, UNDERSIDE_TABLE(entry.layer), p) - z;
#endif
  return z - height_at(ground, entry.layer, p);
}

// The first entry of the ray p + k step, k = 0..steps. `to_floor`: point `steps` lies at the lowest
// elevation of all, which a solid layer can't be missed at.
Entry trace(const Ground* ground, float px, float py, float pz, float step_x, float step_y,
            float step_z, uint steps, int to_floor) {
  Entry entry;
  entry.k = 0;
  entry.layer = -1;
  entry.under = 0;
  float above[LAYERS], below[LAYERS];  // at the last point
  {
    const Place p = place_at(ground, px, py);
    for (int l = 0; l < LAYERS; ++l) {
      above[l] = pz - height_at(ground, l, p);
      below[l] = HAS_UNDERSIDE(l) ? height_at(ground, UNDERSIDE_TABLE(l), p) - pz : -1.0f;
    }
  }
  // March until something is entered.
  float high = 0, low = 0;
  float outside_high = 0, outside_low = 0;
  for (uint step = 1; step <= steps; ++step) {
    low = (float)step;
    const float x = px + low * step_x, y = py + low * step_y, z = pz + low * step_z;
    const Place p = place_at(ground, x, y);
    float first = 2;  // where in the step
    for (int l = 0; l < LAYERS; ++l) {
      const float a0 = above[l];
      float a1 = z - height_at(ground, l, p);
      if (HAS_UNDERSIDE(l)) {
        const float b0 = below[l];
        const float b1 = height_at(ground, UNDERSIDE_TABLE(l), p) - z;
        if ((a0 <= 0 || a1 <= 0) && (b0 <= 0 || b1 <= 0)) {
          // Inside of the top and inside of the underside, each for a part of the step.
          const float a_in = a0 <= 0 ? 0 : a0 / (a0 - a1), b_in = b0 <= 0 ? 0 : b0 / (b0 - b1);
          const float a_out = a1 <= 0 ? 1 : a0 / (a0 - a1), b_out = b1 <= 0 ? 1 : b0 / (b0 - b1);
          const float in = max(a_in, b_in);
          if (in <= min(a_out, b_out) && in < first) {
            first = in;
            entry.layer = l;
            entry.under = b_in > a_in;
            outside_high = entry.under ? b0 : a0;
            outside_low = entry.under ? b1 : a1;
          }
        }
        below[l] = b1;
      } else {
        if (to_floor && step == steps) a1 = min(a1, 0.0f);
        if (a1 <= 0) {
          const float in = a0 > 0 ? a0 / (a0 - a1) : 0;
          if (in < first) {
            first = in;
            entry.layer = l;
            entry.under = 0;
            outside_high = a0;
            outside_low = a1;
          }
        }
      }
      above[l] = a1;
    }
    if (entry.layer >= 0) break;
    high = low;
    // High above what is near: leave out points.
    const float z_then = z + (BLOCK - 1) * step_z;
    if (step + BLOCK - 1 <= steps && min(z, z_then) > ceiling_at(ground, x, y)) step += BLOCK - 2;
  }
  if (entry.layer < 0) return entry;
  // Halve the step, then take the chord.
  for (int i = 0; i < BISECTIONS; ++i) {
    const float middle = 0.5f * (high + low);
    const float outside_middle = outside(ground, entry, px + middle * step_x, py + middle * step_y,
                                         pz + middle * step_z);
    if (outside_middle > 0) {
      high = middle;
      outside_high = outside_middle;
    } else {
      low = middle;
      outside_low = outside_middle;
    }
  }
  const float drop = outside_high - outside_low;
  entry.k = drop > 0 ? high + (low - high) * (max(outside_high, 0.0f) / drop) : high;
  return entry;
}

// Of VW rays.
typedef struct {
  uintv index;
  realv fx, fy;
} Places;

Places places_at(const Ground* ground, realv x, realv y) {
  const realv column = floor(x), row = floor(y);
  const uintv c = floor_to_uintv(column) & (ground->columns - 1);
  const uintv r = floor_to_uintv(row) & (ground->rows - 1);
  Places places;
  places.index = r * ground->columns + c;
  places.fx = x - column;
  places.fy = y - row;
  return places;
}

// One load per lane and a transposition.
WIDE_VECTORS realv heights_at(const Ground* ground, uint table, const Places* p) {
  global const float4* z = ground->heights + (size_t)table * ground->rows * ground->columns;
  const uintv i = p->index;
#if VW == 8
  const float4 q0 = z[i.s0], q1 = z[i.s1];
  const float4 q2 = z[i.s2], q3 = z[i.s3];
  const float4 q4 = z[i.s4], q5 = z[i.s5];
  const float4 q6 = z[i.s6], q7 = z[i.s7];
  const realv z00 = (realv)(q0.x, q1.x, q2.x, q3.x, q4.x, q5.x, q6.x, q7.x);
  const realv z10 = (realv)(q0.y, q1.y, q2.y, q3.y, q4.y, q5.y, q6.y, q7.y);
  const realv z01 = (realv)(q0.z, q1.z, q2.z, q3.z, q4.z, q5.z, q6.z, q7.z);
  const realv z11 = (realv)(q0.w, q1.w, q2.w, q3.w, q4.w, q5.w, q6.w, q7.w);
#else
  const float4 q0 = z[i.s0], q1 = z[i.s1];
  const float4 q2 = z[i.s2], q3 = z[i.s3];
  const float4 q4 = z[i.s4], q5 = z[i.s5];
  const float4 q6 = z[i.s6], q7 = z[i.s7];
  const float4 q8 = z[i.s8], q9 = z[i.s9];
  const float4 qa = z[i.sa], qb = z[i.sb];
  const float4 qc = z[i.sc], qd = z[i.sd];
  const float4 qe = z[i.se], qf = z[i.sf];
  const realv z00 = (realv)(q0.x, q1.x, q2.x, q3.x, q4.x, q5.x, q6.x, q7.x,
                           q8.x, q9.x, qa.x, qb.x, qc.x, qd.x, qe.x, qf.x);
  const realv z10 = (realv)(q0.y, q1.y, q2.y, q3.y, q4.y, q5.y, q6.y, q7.y,
                           q8.y, q9.y, qa.y, qb.y, qc.y, qd.y, qe.y, qf.y);
  const realv z01 = (realv)(q0.z, q1.z, q2.z, q3.z, q4.z, q5.z, q6.z, q7.z,
                           q8.z, q9.z, qa.z, qb.z, qc.z, qd.z, qe.z, qf.z);
  const realv z11 = (realv)(q0.w, q1.w, q2.w, q3.w, q4.w, q5.w, q6.w, q7.w,
                           q8.w, q9.w, qa.w, qb.w, qc.w, qd.w, qe.w, qf.w);
#endif
  const realv low = z00 + p->fx * (z10 - z00);
  const realv high = z01 + p->fx * (z11 - z01);
  return low + p->fy * (high - low);
}

WIDE_VECTORS realv ceilings_at(const Ground* ground, realv x, realv y) {
  const uintv c = (floor_to_uintv(floor(x)) & (ground->columns - 1)) >> BLOCK_BITS;
  const uintv r = (floor_to_uintv(floor(y)) & (ground->rows - 1)) >> BLOCK_BITS;
  const uintv i = r * ((ground->columns + BLOCK - 1) >> BLOCK_BITS) + c;
  global const float* z = ground->ceilings;
#if VW == 8
  return (realv)(z[i.s0], z[i.s1], z[i.s2], z[i.s3], z[i.s4], z[i.s5], z[i.s6], z[i.s7]);
#else
  return (realv)(z[i.s0], z[i.s1], z[i.s2], z[i.s3], z[i.s4], z[i.s5], z[i.s6], z[i.s7], z[i.s8],
                 z[i.s9], z[i.sa], z[i.sb], z[i.sc], z[i.sd], z[i.se], z[i.sf]);
#endif
}

// Shadow rays from a point towards VW lights, up to the highest elevation: -1 in the lanes of
// `wanted` whose ray meets nothing.
WIDE_VECTORS intv lit_lanes(const Ground* ground, float px, float py, float pz, realv step_x,
                            realv step_y, realv step_z, intv wanted) {
  intv lit = wanted, marching = wanted;
#if UNDERSIDES
  float above_lanes[LAYERS * VW], below_lanes[LAYERS * VW];  // at the last point
  const Place start = place_at(ground, px, py);
  for (int l = 0; l < LAYERS; ++l) {
    const float above_start = pz - height_at(ground, l, start);
    float below_start = -1;
    if (HAS_UNDERSIDE(l)) below_start = height_at(ground, UNDERSIDE_TABLE(l), start) - pz;
    storev((realv)(above_start), above_lanes + l * VW);
    storev((realv)(below_start), below_lanes + l * VW);
  }
#endif
  realv k = 1;
  while (any(marching)) {
    const realv x = px + k * step_x, y = py + k * step_y, z = pz + k * step_z;
#if !UNDERSIDES
    marching &= z < ground->highest;
    if (!any(marching)) break;
#endif
    const Places p = places_at(ground, x, y);
    intv blocked = 0;
    for (int l = 0; l < LAYERS; ++l) {
      const realv a1 = z - heights_at(ground, l, &p);
#if UNDERSIDES
      const realv a0 = loadv(above_lanes + l * VW);
      if (HAS_UNDERSIDE(l)) {
        const realv b0 = loadv(below_lanes + l * VW), b1 = heights_at(ground, UNDERSIDE_TABLE(l), &p) - z;
        // A sheet passed downwards was met if its top came before its underside; and so upwards.
        const realv order = a0 * b1 - b0 * a1;
        blocked |= (a1 < 0) & (b1 < 0);
        blocked |= (a0 >= 0) & (b0 < 0) & (a1 < 0) & (b1 >= 0) & (order < 0);
        blocked |= (a0 < 0) & (b0 >= 0) & (a1 >= 0) & (b1 < 0) & (order > 0);
        storev(b1, below_lanes + l * VW);
      } else {
        blocked |= a1 < 0;
      }
      storev(a1, above_lanes + l * VW);
#else
      blocked |= a1 < 0;
#endif
    }
    blocked &= marching;
    lit &= ~blocked;
    marching &= ~blocked;
#if UNDERSIDES
    marching &= z < ground->highest;
#endif
    const intv clear = z > ceilings_at(ground, x, y);
    k += select(select((realv)(1), (realv)(BLOCK - 1), clear), (realv)(0), ~marching);
  }
  return lit;
}
