// Triangles with normals and texture coordinates at their corners.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string_view>
#include <vector>

#include "weft/scene/reflectance.hpp"

namespace weft {

struct TriangleMesh {
  struct Vertex {
    std::array<float, 3> position{}, normal{};
    std::array<float, 2> uv{};
  };
  std::vector<Vertex> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;  // counter-clockwise as seen from outside
};

// Throws an input error that names `where`, the field and the value unless there are triangles, of
// vertices that exist, with finite values and normals of unit length.
void validate(const TriangleMesh& mesh, std::string_view where);

// Moves the centre of the bounding box to the origin and the farthest vertex to distance 1.
void fit_unit_sphere(TriangleMesh& mesh);

// A square cloth with `cells` cells along a side, thrown over a ball: hanging in folds round it.
// Texture coordinates are lengths on the flat cloth, so that the texture isn't stretched.
TriangleMesh make_draped_cloth(std::size_t cells);

enum class UpAxis : std::uint8_t { y, z };

// Wavefront OBJ: v, vt, vn and f with any number of corners, indices from 1 or, negative, from the
// end. Groups, materials and smoothing are passed over. Corners without vn get normals that are
// smooth over every position; corners without vt are an error. Errors name the file, the line and
// the value.
TriangleMesh read_obj(const std::filesystem::path& path, UpAxis up);

}  // namespace weft
