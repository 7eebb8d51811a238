#include "weft/btf/hemisphere.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>

#include "weft/btf/hemisphere_facets.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

using Vector = std::array<double, 3>;

// Directions closer than this are one: far above what float rounding does, far below any capture.
constexpr double same_direction = 1e-5;
// Directions are on one great circle where none is farther from its plane.
constexpr double same_circle = 1e-6;
// Weights of this size are rounding.
constexpr double weight_tolerance = 1e-12;
// How much brighter than its nearest measured light a light may be taken to be.
constexpr double largest_scale = 4;
constexpr std::size_t largest_side = 256;

double dot(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

double length(const Vector& a) {
  return std::hypot(a[0], a[1], a[2]);
}

Vector scaled(const Vector& a, double factor) {
  return {a[0] * factor, a[1] * factor, a[2] * factor};
}

double weight_of(const std::array<double, 4>& row, const Vector& d) {
  return row[0] * d[0] + row[1] * d[1] + row[2] * d[2] + row[3];
}

std::array<double, 4> linear_row(const Vector& a, double factor) {
  return {a[0] * factor, a[1] * factor, a[2] * factor, 0};
}

// Indices of the directions that are left when those next to one of lower index are dropped.
std::vector<std::uint32_t> distinct_directions(const std::vector<Vector>& directions) {
  const std::size_t n = directions.size();
  // Sorted along an axis that no usual set is perpendicular to, equals are close together.
  const Vector axis{0.61, 0.54, 0.58};
  std::vector<double> height(n);
  for (std::size_t i = 0; i < n; ++i) height[i] = dot(axis, directions[i]);
  std::vector<std::uint32_t> order(n), root(n);
  std::iota(order.begin(), order.end(), 0u);
  std::iota(root.begin(), root.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t i, std::uint32_t j) {
    return height[i] != height[j] ? height[i] < height[j] : i < j;
  });
  const auto find = [&root](std::uint32_t i) {
    while (root[i] != i) i = root[i] = root[root[i]];
    return i;
  };
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 1; j < n && height[order[j]] - height[order[i]] <= same_direction;
         ++j) {
      const Vector &a = directions[order[i]], &b = directions[order[j]];
      if (length({a[0] - b[0], a[1] - b[1], a[2] - b[2]}) > same_direction) continue;
      const std::uint32_t u = find(order[i]), v = find(order[j]);
      root[std::max(u, v)] = std::min(u, v);
    }
  }
  std::vector<std::uint32_t> distinct;
  for (std::uint32_t i = 0; i < n; ++i) {
    if (find(i) == i) distinct.push_back(i);
  }
  return distinct;
}

// A unit normal of the plane through the origin that holds the first of the directions and the one
// that spans the widest angle with it up to a quarter turn.
Vector circle_normal(const std::vector<Vector>& directions,
                     std::span<const std::uint32_t> distinct) {
  Vector normal{};
  for (const std::uint32_t i : distinct) {
    const Vector candidate = cross(directions[distinct[0]], directions[i]);
    if (length(candidate) > length(normal)) normal = candidate;
  }
  if (length(normal) > same_circle) return scaled(normal, 1 / length(normal));
  // Opposite directions: the half circle between them leads over the zenith.
  const Vector& d = directions[distinct[0]];
  const Vector over_zenith = cross(d, {0, 0, 1});
  if (length(over_zenith) <= same_circle) return {0, 1, 0};
  return scaled(over_zenith, 1 / length(over_zenith));
}

}  // namespace

Hemisphere::Hemisphere(std::span<const Direction> directions) {
  if (directions.empty()) fail_input("a set of directions needs at least 1 direction, not 0");
  if (directions.size() > std::numeric_limits<std::int32_t>::max() / 4) {
    fail_input("{} directions are too many to triangulate", directions.size());
  }
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const Direction& d = directions[i];
    const Vector v{d[0], d[1], d[2]};
    const double l = length(v);
    if (!std::isfinite(l) || l <= 0) {
      fail_input("direction {} is ({}, {}, {}): no unit vector", i, d[0], d[1], d[2]);
    }
    directions_.push_back(scaled(v, 1 / l));
  }
  const std::vector<std::uint32_t> distinct = distinct_directions(directions_);
  if (distinct.size() == 1) {
    add_edge(distinct[0], distinct[0]);
  } else {
    const Vector normal = circle_normal(directions_, distinct);
    const bool one_circle = std::all_of(distinct.begin(), distinct.end(), [&](std::uint32_t i) {
      return std::abs(dot(normal, directions_[i])) <= same_circle;
    });
    if (one_circle) {
      make_chain(distinct, normal);
    } else {
      make_triangles(distinct);
    }
  }
  make_grid();
}

// Arcs between directions that are neighbours on their great circle: from one end to the other,
// with the widest gap between neighbours left open, or all round where no gap is half the circle.
void Hemisphere::make_chain(std::span<const std::uint32_t> distinct, const Vector& normal) {
  const Vector x = directions_[distinct[0]], y = cross(normal, x);
  std::vector<std::pair<double, std::uint32_t>> by_angle;
  for (const std::uint32_t i : distinct) {
    by_angle.emplace_back(std::atan2(dot(y, directions_[i]), dot(x, directions_[i])), i);
  }
  std::sort(by_angle.begin(), by_angle.end());
  const std::size_t n = by_angle.size();
  if (n == 0) return;
  std::size_t first = 0;
  double widest = by_angle[0].first - by_angle[n - 1].first + 2 * std::numbers::pi;
  for (std::size_t i = 1; i < n; ++i) {
    const double gap = by_angle[i].first - by_angle[i - 1].first;
    if (gap > widest) {
      widest = gap;
      first = i;
    }
  }
  const bool closed = widest < std::numbers::pi - same_circle;
  const std::size_t arcs = closed ? n : n - 1;
  for (std::size_t i = 0; i < arcs; ++i) {
    add_edge(by_angle[(first + i) % n].second, by_angle[(first + i + 1) % n].second);
    const auto last = static_cast<std::int32_t>(arcs) - 1;
    const auto here = static_cast<std::int32_t>(i);
    edges_.back().previous = here > 0 ? here - 1 : closed ? last : -1;
    edges_.back().next = here < last ? here + 1 : closed ? 0 : -1;
  }
}

void Hemisphere::make_triangles(std::span<const std::uint32_t> distinct) {
  for (const HullFacet& facet : hemisphere_facets(directions_, distinct)) {
    Triangle triangle;
    triangle.vertices = facet;
    const Vector &a = directions_[facet[0]], &b = directions_[facet[1]], &c = directions_[facet[2]];
    const double inverse = 1 / dot(a, cross(b, c));
    triangle.rows = {linear_row(cross(b, c), inverse), linear_row(cross(c, a), inverse),
                     linear_row(cross(a, b), inverse)};
    triangles_.push_back(triangle);
  }
  connect_triangles();
}

// Finds each triangle's neighbours; edges without one are the edge of the hull.
void Hemisphere::connect_triangles() {
  std::map<std::array<std::uint32_t, 2>, std::int32_t> triangle_with;
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto& v = triangles_[t].vertices;
      triangle_with[{v[(k + 1) % 3], v[(k + 2) % 3]}] = static_cast<std::int32_t>(t);
    }
  }
  std::map<std::uint32_t, std::int32_t> starting_at, ending_at;
  for (Triangle& triangle : triangles_) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = triangle.vertices[(k + 1) % 3], b = triangle.vertices[(k + 2) % 3];
      const auto found = triangle_with.find({b, a});
      if (found != triangle_with.end()) {
        triangle.neighbours[k] = found->second;
        continue;
      }
      const auto edge = static_cast<std::int32_t>(edges_.size());
      triangle.neighbours[k] = ~edge;
      add_edge(a, b);
      starting_at.emplace(a, edge);
      ending_at.emplace(b, edge);
    }
  }
  for (Edge& edge : edges_) {
    edge.previous = ending_at.at(edge.vertices[0]);
    edge.next = starting_at.at(edge.vertices[1]);
  }
}

// The weights on the arc from a to b of a direction's projection to their plane.
void Hemisphere::add_edge(std::uint32_t a, std::uint32_t b) {
  Edge edge;
  edge.vertices = {a, b};
  const Vector &da = directions_[a], &db = directions_[b];
  const Vector n = cross(da, db);
  if (a == b) {
    edge.rows[0][3] = 1;
  } else if (length(n) > same_circle) {
    const double inverse = 1 / dot(n, n);
    edge.rows = {linear_row(cross(db, n), inverse), linear_row(cross(n, da), inverse)};
  } else {
    edge.rows = {linear_row(da, 0.5), linear_row(db, 0.5)};
    edge.rows[0][3] = edge.rows[1][3] = 0.5;
  }
  edges_.push_back(edge);
}

void Hemisphere::make_grid() {
  const double cells = std::sqrt(2.0 * static_cast<double>(triangles_.size()));
  side_ = std::clamp<std::size_t>(static_cast<std::size_t>(cells), 1, largest_side);
  grid_.resize(side_ * side_);
  std::int32_t place = triangles_.empty() ? ~std::int32_t{0} : 0;
  for (std::size_t row = 0; row < side_; ++row) {
    for (std::size_t column = 0; column < side_; ++column) {
      const auto centre = [this](std::size_t cell) {
        return (2 * static_cast<double>(cell) + 1) / static_cast<double>(side_) - 1;
      };
      const double x = centre(column), y = centre(row);
      const Vector d = upper({2 * x, 2 * y, 1 - x * x - y * y});
      // A cell outside the hull starts at the last triangle inside: of a cell's directions some may
      // be inside all the same.
      const std::int32_t found = walk(place, d);
      if (found >= 0) place = found;
      grid_[row * side_ + column] = place;
    }
  }
}

// The direction, brought to the horizon from below, of unit length.
Hemisphere::Vector Hemisphere::upper(const Vector& direction) const {
  Vector d = direction;
  if (d[2] < 0) d[2] = 0;
  const double l = length(d);
  if (l == 0) return {1, 0, 0};
  return scaled(d, 1 / l);
}

std::int32_t Hemisphere::start(const Vector& d) const {
  const auto cell = [&](double x) {
    const double position = (x / (1 + d[2]) + 1) / 2 * static_cast<double>(side_);
    return std::min(static_cast<std::size_t>(std::max(position, 0.0)), side_ - 1);
  };
  return grid_[cell(d[1]) * side_ + cell(d[0])];
}

std::int32_t Hemisphere::walk(std::int32_t place, const Vector& d) const {
  std::int32_t left = place;
  // A walk visits no triangle twice.
  for (std::size_t step = 0; place >= 0 && step < triangles_.size(); ++step) {
    const Triangle& triangle = triangles_[static_cast<std::size_t>(place)];
    std::size_t smallest = 0;
    std::array<double, 3> w{};
    for (std::size_t k = 0; k < 3; ++k) {
      w[k] = weight_of(triangle.rows[k], d);
      if (w[k] < w[smallest]) smallest = k;
    }
    if (w[smallest] >= -weight_tolerance) break;
    const std::int32_t next = triangle.neighbours[smallest];
    if (next == left) break;
    left = place;
    place = next;
  }
  return place;
}

DirectionWeights Hemisphere::on_edge(std::size_t edge, const Vector& d) const {
  DirectionWeights result;
  const auto vertex = [&](std::size_t k) {
    result.index.fill(edges_[edge].vertices[k]);
    return result;
  };
  enum class Came { nowhere, forward, backward } came = Came::nowhere;
  for (std::size_t step = 0; step < edges_.size(); ++step) {
    const Edge& at = edges_[edge];
    const double wa = weight_of(at.rows[0], d), wb = weight_of(at.rows[1], d);
    if (wa >= 0 && wb >= 0 && wa + wb > 0) {
      result.index = {at.vertices[0], at.vertices[1], at.vertices[0]};
      result.weight = {wa / (wa + wb), wb / (wa + wb), 0};
      return result;
    }
    if (wa < wb) {
      if (at.next < 0 || came == Came::backward) return vertex(1);
      came = Came::forward;
      edge = static_cast<std::size_t>(at.next);
    } else {
      if (at.previous < 0 || came == Came::forward) return vertex(0);
      came = Came::backward;
      edge = static_cast<std::size_t>(at.previous);
    }
  }
  return vertex(0);
}

DirectionWeights Hemisphere::at(const std::array<double, 3>& direction) const {
  const Vector d = upper(direction);
  const std::int32_t place = walk(start(d), d);
  if (place >= 0) {
    const Triangle& triangle = triangles_[static_cast<std::size_t>(place)];
    DirectionWeights result;
    result.index = triangle.vertices;
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double w = weight_of(triangle.rows[k], d);
      result.weight[k] = w > weight_tolerance ? w : 0;
      sum += result.weight[k];
    }
    for (double& w : result.weight) w /= sum;
    if (direction[2] < 0) result.scale = 0;
    return result;
  }
  const std::int32_t edge = ~place;
  DirectionWeights result = on_edge(static_cast<std::size_t>(edge), d);
  if (direction[2] < 0) {
    result.scale = 0;
    return result;
  }
  Vector clamped{};
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < 3; ++i) {
      clamped[i] += result.weight[k] * directions_[result.index[k]][i];
    }
  }
  const double cosine = clamped[2] / std::max(length(clamped), weight_tolerance);
  if (d[2] < largest_scale * cosine) {
    result.scale = d[2] / cosine;
  } else {
    result.scale = d[2] > 0 ? largest_scale : 1;
  }
  return result;
}

HemisphereTables Hemisphere::tables() const {
  HemisphereTables tables;
  for (const Vector& d : directions_) {
    for (const double x : d) tables.directions.push_back(static_cast<float>(x));
    tables.directions.push_back(0);
  }
  const auto add_rows = [](std::vector<float>& to, const auto& rows) {
    for (const Row& row : rows) {
      for (const double x : row) to.push_back(static_cast<float>(x));
    }
  };
  for (const Triangle& triangle : triangles_) {
    for (const std::uint32_t v : triangle.vertices) {
      tables.triangles.push_back(static_cast<std::int32_t>(v));
    }
    tables.triangles.insert(tables.triangles.end(), triangle.neighbours.begin(),
                            triangle.neighbours.end());
    add_rows(tables.triangle_rows, triangle.rows);
  }
  for (const Edge& edge : edges_) {
    for (const std::uint32_t v : edge.vertices) {
      tables.edges.push_back(static_cast<std::int32_t>(v));
    }
    tables.edges.push_back(edge.previous);
    tables.edges.push_back(edge.next);
    add_rows(tables.edge_rows, edge.rows);
  }
  tables.grid = grid_;
  tables.side = side_;
  return tables;
}

}  // namespace weft
