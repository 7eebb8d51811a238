// A heap on a periodic tile, made by dropping bodies one by one: how high it is where.
//
// The grid is of its own, so that a heap is the same whatever the resolution it is drawn at.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace weft {

class Pile {
 public:
  // A level bed at 0, with about `cells` cells along the shorter side.
  Pile(const std::array<double, 2>& tile, std::size_t cells) : tile_(tile) {
    const double cell = std::min(tile[0], tile[1]) / static_cast<double>(cells);
    for (std::size_t i = 0; i < 2; ++i) {
      count_[i] = static_cast<std::size_t>(std::max(1.0, std::round(tile[i] / cell)));
    }
    height_.assign(count_[0] * count_[1], 0.0);
  }

  // Calls visit(height, dx, dy) for every cell within `radius` of (x, y), the first round the tile
  // only; dx and dy lead there from (x, y).
  template <typename Visit>
  void near(double x, double y, double radius, const Visit& visit) {
    const std::array<double, 2> place = {x, y};
    std::array<long, 2> first{}, last{};
    std::array<double, 2> cell{};
    for (std::size_t i = 0; i < 2; ++i) {
      cell[i] = tile_[i] / static_cast<double>(count_[i]);
      first[i] = static_cast<long>(std::ceil((place[i] - radius) / cell[i]));
      const auto most = first[i] + static_cast<long>(count_[i]) - 1;
      last[i] = std::min(most, static_cast<long>(std::floor((place[i] + radius) / cell[i])));
    }
    for (long r = first[1]; r <= last[1]; ++r) {
      const double dy = static_cast<double>(r) * cell[1] - y;
      for (long c = first[0]; c <= last[0]; ++c) {
        const double dx = static_cast<double>(c) * cell[0] - x;
        if (dx * dx + dy * dy > radius * radius) continue;
        visit(height_[wrapped(r, count_[1]) * count_[0] + wrapped(c, count_[0])], dx, dy);
      }
    }
  }

 private:
  static std::size_t wrapped(long i, std::size_t count) {
    const auto n = static_cast<long>(count);
    return static_cast<std::size_t>((i % n + n) % n);
  }

  std::array<double, 2> tile_;
  std::array<std::size_t, 2> count_{};
  std::vector<double> height_;
};

}  // namespace weft
