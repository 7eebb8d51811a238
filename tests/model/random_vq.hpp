// Random nested code-books, and how exactly directions are placed between their nodes.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "weft/model/vq.hpp"

namespace weft::test {

inline PackedIndices random_indices(Random& random, std::size_t count, std::size_t limit) {
  std::vector<std::uint32_t> indices(count);
  for (std::uint32_t& index : indices) index = static_cast<std::uint32_t>(random.index(limit));
  return {indices, limit};
}

inline std::vector<float> random_list(Random& random, std::size_t count) {
  std::vector<float> values(count);
  for (float& value : values) value = static_cast<float>(random.uniform(0.25, 1));
  return values;
}

// Of a BTF of this shape, with code-books of these sizes.
inline VqModel random_vq(const BtfShape& shape, const VqGrid& grid, const VqModel::Sizes& sizes,
                         std::uint64_t seed) {
  Random random(seed);
  const OnionSizes& n = grid.sizes;
  VqModel model;
  model.info.codec = "vq";
  model.info.btf = make_info(shape, DType::f32);
  model.info.program_version = "test";
  model.grid = grid;
  model.sizes = sizes;
  model.chromaticities = shape.channels - 1;
  const auto book = [&](std::size_t entries, std::size_t below) {
    return VqCodeBook{random_indices(random, entries, below), random_list(random, entries)};
  };
  model.p1 = random_list(random, sizes.p1 * n.beta);
  model.p2 = book(sizes.p2 * n.alpha, sizes.p1);
  model.p3 = book(sizes.p3 * n.theta, sizes.m);
  model.p4 = book(sizes.p4 * n.phi, sizes.p3);
  model.p6 = book(shape.texels(), sizes.p4);
  std::vector<std::uint32_t> pairs;
  for (std::size_t i = 0; i < sizes.m; ++i) {
    pairs.push_back(static_cast<std::uint32_t>(random.index(sizes.p2)));
    if (model.chromaticities > 0) {
      pairs.push_back(static_cast<std::uint32_t>(random.index(sizes.i2)));
    }
  }
  if (model.chromaticities > 0) {
    model.c = random_list(random, sizes.c * model.chromaticities);
    model.i1 = random_indices(random, sizes.i1 * n.beta, sizes.c);
    model.i2 = random_indices(random, sizes.i2 * n.alpha, sizes.i1);
  } else {
    model.sizes.c = model.sizes.i1 = model.sizes.i2 = 0;
  }
  model.m = PackedIndices(pairs, std::max(model.sizes.p2, model.sizes.i2));
  for (std::size_t c = 0; c < shape.channels; ++c) {
    model.channels.push_back(static_cast<std::uint8_t>(c));
  }
  model.seal();
  return model;
}

inline constexpr VqModel::Sizes small_sizes{7, 5, 6, 4, 3, 9, 4, 3};

// Steps that a place in float may be from that in double, all levels together, u = 2^-24. Square
// roots and quotients are within 3 u, arc tangents within 12 u of what they are relative to, and
// their arguments within 20 u: an angle is within 30 u of half a turn. Turned lights are within 30
// u of their length: alpha moves by so much over the distance from the poles, cos beta.
inline double place_error(const OnionSizes& n, const Direction& view, const Direction& light) {
  const auto wide = [](const Direction& d) {
    const double z = std::max(double{d[2]}, 0.0);
    const double length = std::hypot(d[0], d[1], z);
    return length > 0 ? std::array{d[0] / length, d[1] / length, z / length}
                      : std::array{1.0, 0.0, 0.0};
  };
  const auto v = wide(view), l = wide(light);
  const double sine = std::hypot(v[0], v[1]);
  const double c = sine > 0 ? v[0] / sine : 1, s = sine > 0 ? v[1] / sine : 0;
  const double cos_beta = std::hypot(c * l[0] + s * l[1], l[2]);
  const auto steps = [](std::size_t size) { return static_cast<double>(size); };
  // a light in a pole is there in float, too, where nothing is turned
  const double of_alpha = cos_beta == 0 ? 0 : 1 / cos_beta + 1;
  return 60 * float_roundoff *
         (steps(n.phi) + steps(n.theta) + steps(n.beta) + of_alpha * steps(n.alpha));
}

}  // namespace weft::test
