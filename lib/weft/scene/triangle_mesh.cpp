#include "weft/scene/triangle_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "weft/error.hpp"
#include "weft/scene/vector.hpp"

namespace weft {
namespace {

// Coordinates beyond this leave no digits for a ray to start above the surface.
constexpr float largest_coordinate = 1e6f;
constexpr double unit_tolerance = 1e-3;

bool within(const auto& values, float limit) {
  return std::all_of(values.begin(), values.end(),
                     [limit](float x) { return std::abs(x) <= limit; });
}

}  // namespace

void validate(const TriangleMesh& mesh, std::string_view where) {
  constexpr std::size_t most = std::numeric_limits<std::uint32_t>::max();
  if (mesh.triangles.empty()) fail_input("{}: there are no triangles", where);
  if (mesh.triangles.size() >= most || mesh.vertices.size() >= most) {
    fail_input("{}: {} triangles of {} vertices are too many", where, mesh.triangles.size(),
               mesh.vertices.size());
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (const std::uint32_t vertex : mesh.triangles[t]) {
      if (vertex >= mesh.vertices.size()) {
        fail_input("{}: triangle {}: vertex {} of {}", where, t, vertex, mesh.vertices.size());
      }
    }
  }
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    const TriangleMesh::Vertex& v = mesh.vertices[i];
    if (!within(v.position, largest_coordinate)) {
      fail_input("{}: vertex {}: position ({}, {}, {}): each must be within -1e6 and 1e6", where, i,
                 v.position[0], v.position[1], v.position[2]);
    }
    if (!within(v.uv, largest_coordinate)) {
      fail_input("{}: vertex {}: texture coordinates ({}, {}): each must be within -1e6 and 1e6",
                 where, i, v.uv[0], v.uv[1]);
    }
    const double l = std::hypot(v.normal[0], v.normal[1], v.normal[2]);
    if (!(std::abs(l - 1) <= unit_tolerance)) {
      fail_input("{}: vertex {}: normal ({}, {}, {}) is no unit vector", where, i, v.normal[0],
                 v.normal[1], v.normal[2]);
    }
  }
  const auto has_area = [&](const std::array<std::uint32_t, 3>& triangle) {
    const auto corner = [&](std::size_t i) {
      const std::array<float, 3>& p = mesh.vertices[triangle[i]].position;
      return Vector3{p[0], p[1], p[2]};
    };
    const Vector3 n = cross(difference(corner(1), corner(0)), difference(corner(2), corner(0)));
    return length(n) > 0;
  };
  if (std::none_of(mesh.triangles.begin(), mesh.triangles.end(), has_area)) {
    fail_input("{}: all {} triangles are without area", where, mesh.triangles.size());
  }
}

void fit_unit_sphere(TriangleMesh& mesh) {
  if (mesh.vertices.empty()) return;
  std::array<float, 3> low = mesh.vertices[0].position, high = low;
  for (const TriangleMesh::Vertex& vertex : mesh.vertices) {
    for (std::size_t i = 0; i < 3; ++i) {
      low[i] = std::min(low[i], vertex.position[i]);
      high[i] = std::max(high[i], vertex.position[i]);
    }
  }
  const Vector3 centre{(double{low[0]} + high[0]) / 2, (double{low[1]} + high[1]) / 2,
                       (double{low[2]} + high[2]) / 2};
  const auto moved = [&](const std::array<float, 3>& p) {
    return difference({p[0], p[1], p[2]}, centre);
  };
  double radius = 0;
  for (const TriangleMesh::Vertex& vertex : mesh.vertices) {
    radius = std::max(radius, length(moved(vertex.position)));
  }
  if (radius == 0) return;
  for (TriangleMesh::Vertex& vertex : mesh.vertices) {
    vertex.position = to_float(scaled(moved(vertex.position), 1 / radius));
  }
}

}  // namespace weft
