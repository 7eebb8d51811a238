// Plain knitted fabric (stockinette) seen from its face: courses of loops of plied yarn, each drawn
// through the loops of the course below. Lengths in widths of a loop, the wales.
//
//   x(t) = (t / 2 pi) + lean sin 2t       z(t) = -depth cos 2t
//   y(t) = height/2 cos t                 one loop is t = 0 .. 2 pi
//
//      \ //\ //\ //\ /      the legs of the loops lie in front and make the V's; heads and feet
//       V/  V/  V/  V       lie behind the legs of the courses above and below
//
// Courses alternate between two layers, since neighbours pass over each other; stray fibres are a
// third one.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "weft/scene/fields.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

struct Knit {
  std::size_t wales = 10;    // loops side by side of one tile
  std::size_t courses = 12;  // rows of loops, an even number
  std::uint64_t seed = 1;
  std::array<float, 3> color{0.52f, 0.40f, 0.26f};
  GlossyLobe gloss{{0.02f, 0.02f, 0.02f}, 0.5f, 0.6f, 0.8f};
  double color_spread = 0.12;  // relative
  double course_height = 0.8;  // distance of courses
  double loop_height = 1.75;   // of a loop, over the distance of courses; above 1 it interlocks
  double lean = 0.23;          // of the legs: how far heads are wider than necks
  double depth = 0.2;          // of the loops, in front and behind
  double width = 0.46;         // of the yarn
  double thickness = 0.42;     // of the yarn
  std::size_t plies = 3;
  double twists = 1.5;
  double ply_relief = 0.05;
  double fibre_relief = 0.025;
  double irregularity = 0.05;  // of size and place from loop to loop
  double hairs = 4;            // stray fibres per loop
  double hair_length = 0.9;
  double hair_width = 0.02;
};

// Of its surface: courses alternate between two, stray fibres lie on a third.
std::size_t knit_layers(const Knit& knit);

void describe(Fields& fields, Knit& knit);
void stretch(Knit& knit, double along_x, double along_y);
Surface make_surface(const Knit& knit, std::size_t columns, std::size_t rows);

}  // namespace weft
