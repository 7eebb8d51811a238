// A square cloth thrown over a ball: a net of points held at their distances, simulated by position
// based dynamics (Mueller et al., Position Based Dynamics, 2007) until it hangs still, first
// coarse, then fine. The same arithmetic in the same order gives the same cloth on every run.
#include <algorithm>
#include <cmath>

#include "weft/error.hpp"
#include "weft/scene/noise.hpp"
#include "weft/scene/shape.hpp"
#include "weft/scene/triangle_mesh.hpp"
#include "weft/scene/vector.hpp"

namespace weft {
namespace {

constexpr double cloth_side = 2.0;
constexpr double ball_radius = 0.56;
// The cloth lies on the ball a little off its centre and turned, as nobody throws it straight.
constexpr double shift_x = 0.06, shift_y = -0.04, turn = 0.35;
constexpr double time_step = 1.0 / 60;
constexpr double gravity = 9.8;
// Share of the velocity that is left after a step.
constexpr double kept_velocity = 0.985;
constexpr std::size_t coarse_cells = 32, coarse_steps = 330, fine_steps = 50, iterations = 10;
// Cells along a side of the mesh for rendering.
constexpr std::size_t drape_cells = 240;

// Points [cells + 1][cells + 1] of a cloth.
class Net {
 public:
  explicit Net(std::size_t cells)
      : cells_(cells), positions_((cells + 1) * (cells + 1)), previous_(positions_) {}

  std::size_t cells() const { return cells_; }
  Vector3& at(std::size_t row, std::size_t column) {
    return positions_[row * (cells_ + 1) + column];
  }

  // The point at (row, column), which need not be whole numbers: cubic B-splines through their
  // control points' neighbourhood, which leave no creases.
  Vector3 smooth(double row, double column) const {
    const auto taps = [this](double x) {
      const double cell = std::min(std::floor(x), static_cast<double>(cells_ - 1));
      const double f = x - cell, g = 1 - f;
      struct {
        std::array<std::ptrdiff_t, 4> index;
        std::array<double, 4> weight;
      } result;
      result.weight = {g * g * g / 6, (4 - 6 * f * f + 3 * f * f * f) / 6,
                       (4 - 6 * g * g + 3 * g * g * g) / 6, f * f * f / 6};
      for (std::ptrdiff_t i = 0; i < 4; ++i) {
        result.index[static_cast<std::size_t>(i)] = static_cast<std::ptrdiff_t>(cell) - 1 + i;
      }
      return result;
    };
    const auto rows = taps(row), columns = taps(column);
    Vector3 point{};
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t k = 0; k < 4; ++k) {
        point = sum(point, scaled(extended(rows.index[i], columns.index[k]),
                                  rows.weight[i] * columns.weight[k]));
      }
    }
    return point;
  }

  void rest() { previous_ = positions_; }

  void step() {
    for (std::size_t i = 0; i < positions_.size(); ++i) {
      const Vector3 velocity = scaled(difference(positions_[i], previous_[i]), kept_velocity);
      previous_[i] = positions_[i];
      positions_[i] = sum(positions_[i], velocity);
      positions_[i][2] -= gravity * time_step * time_step;
    }
    const double cell = cloth_side / static_cast<double>(cells_);
    for (std::size_t i = 0; i < iterations; ++i) {
      // Along the yarns the cloth hardly stretches; across them it shears; it bends softly.
      hold(1, 0, cell, 1.0);
      hold(0, 1, cell, 1.0);
      hold(1, 1, cell * std::sqrt(2.0), 0.35);
      hold(1, -1, cell * std::sqrt(2.0), 0.35);
      hold(2, 0, 2 * cell, 0.12);
      hold(0, 2, 2 * cell, 0.12);
      keep_off_ball();
    }
  }

 private:
  // Beyond the edge the cloth goes on straight.
  Vector3 extended(std::ptrdiff_t row, std::ptrdiff_t column) const {
    const auto n = static_cast<std::ptrdiff_t>(cells_);
    if (row < 0) return mirrored(extended(0, column), extended(1, column));
    if (row > n) return mirrored(extended(n, column), extended(n - 1, column));
    if (column < 0) return mirrored(extended(row, 0), extended(row, 1));
    if (column > n) return mirrored(extended(row, n), extended(row, n - 1));
    return positions_[static_cast<std::size_t>(row * (n + 1) + column)];
  }
  static Vector3 mirrored(const Vector3& edge, const Vector3& inside) {
    return difference(scaled(edge, 2), inside);
  }

  // Moves points `rows` and `columns` apart towards the distance `rest`.
  void hold(std::size_t rows, std::ptrdiff_t columns, double rest, double stiffness) {
    const std::size_t first = columns < 0 ? 1 : 0;
    const std::size_t last = cells_ + 1 - (columns > 0 ? static_cast<std::size_t>(columns) : 0);
    for (std::size_t row = 0; row + rows <= cells_; ++row) {
      for (std::size_t column = first; column < last; ++column) {
        Vector3& a = at(row, column);
        Vector3& b =
            at(row + rows, static_cast<std::size_t>(static_cast<std::ptrdiff_t>(column) + columns));
        const Vector3 apart = difference(b, a);
        const double l = std::sqrt(dot(apart, apart));
        if (l < 1e-9) continue;
        const Vector3 move = scaled(apart, stiffness * 0.5 * (1 - rest / l));
        a = sum(a, move);
        b = difference(b, move);
      }
    }
  }

  // Pushes points out of the ball, where friction holds them.
  void keep_off_ball() {
    for (std::size_t i = 0; i < positions_.size(); ++i) {
      const double l = std::sqrt(dot(positions_[i], positions_[i]));
      if (l >= ball_radius) continue;
      const Vector3 out = scaled(positions_[i], ball_radius / std::max(l, 1e-9));
      positions_[i] = sum(scaled(out, 0.7), scaled(previous_[i], 0.3));
      const double after = std::sqrt(dot(positions_[i], positions_[i]));
      if (after < ball_radius) positions_[i] = scaled(positions_[i], ball_radius / after);
    }
  }

  std::size_t cells_;
  std::vector<Vector3> positions_, previous_;
};

Net simulate() {
  Net coarse(coarse_cells);
  for (std::size_t row = 0; row <= coarse_cells; ++row) {
    for (std::size_t column = 0; column <= coarse_cells; ++column) {
      const double x = (static_cast<double>(column) / coarse_cells - 0.5) * cloth_side + shift_x;
      const double y = (static_cast<double>(row) / coarse_cells - 0.5) * cloth_side + shift_y;
      const double wave = 0.01 * value_noise(5 * x + 20, 5 * y + 20, 64, 64, 7);
      coarse.at(row, column) = {std::cos(turn) * x - std::sin(turn) * y,
                                std::sin(turn) * x + std::cos(turn) * y, ball_radius + 0.02 + wave};
    }
  }
  coarse.rest();
  for (std::size_t i = 0; i < coarse_steps; ++i) coarse.step();
  Net fine(2 * coarse_cells);
  for (std::size_t row = 0; row <= fine.cells(); ++row) {
    for (std::size_t column = 0; column <= fine.cells(); ++column) {
      fine.at(row, column) =
          coarse.smooth(static_cast<double>(row) / 2, static_cast<double>(column) / 2);
    }
  }
  fine.rest();
  for (std::size_t i = 0; i < fine_steps; ++i) fine.step();
  return fine;
}

}  // namespace

TriangleMesh make_draped_cloth(std::size_t cells) {
  if (cells < 1 || cells > 4096) {
    fail_input("draped cloth: {} cells along a side: must be within 1 and 4096", cells);
  }
  const Net net = simulate();
  const double ratio = static_cast<double>(net.cells()) / static_cast<double>(cells);
  TriangleMesh mesh;
  for (std::size_t row = 0; row <= cells; ++row) {
    for (std::size_t column = 0; column <= cells; ++column) {
      const double y = static_cast<double>(row) * ratio, x = static_cast<double>(column) * ratio;
      const auto limit = static_cast<double>(net.cells());
      // Half a cell of the net to either side, or to one side at the edge.
      const auto slope = [&](double dy, double dx) {
        const auto clamped = [limit](double at) { return std::clamp(at, 0.0, limit); };
        return difference(net.smooth(clamped(y + dy), clamped(x + dx)),
                          net.smooth(clamped(y - dy), clamped(x - dx)));
      };
      TriangleMesh::Vertex vertex;
      vertex.position = to_float(net.smooth(y, x));
      vertex.normal = to_float(normalized(cross(slope(0, 0.25), slope(0.25, 0))));
      vertex.uv = {static_cast<float>(static_cast<double>(column) / static_cast<double>(cells)),
                   static_cast<float>(static_cast<double>(row) / static_cast<double>(cells))};
      mesh.vertices.push_back(vertex);
    }
  }
  for (std::size_t row = 0; row < cells; ++row) {
    for (std::size_t column = 0; column < cells; ++column) {
      const auto a = static_cast<std::uint32_t>(row * (cells + 1) + column), b = a + 1;
      const auto c = static_cast<std::uint32_t>(a + cells + 1), d = c + 1;
      mesh.triangles.push_back({a, b, d});
      mesh.triangles.push_back({a, d, c});
    }
  }
  return mesh;
}

std::shared_ptr<const Shape> make_drape(const Repeat& repeat) {
  TriangleMesh mesh = make_draped_cloth(drape_cells);
  fit_unit_sphere(mesh);
  return make_mesh_shape(mesh, repeat);
}

}  // namespace weft
