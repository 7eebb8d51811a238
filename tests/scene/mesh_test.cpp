#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <string>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/mutate.hpp"
#include "support/temporary_folder.hpp"
#include "weft/scene/ray_caster.hpp"
#include "weft/scene/tangent_frame.hpp"
#include "weft/scene/triangle_mesh.hpp"
#include "weft/scene/vector.hpp"

namespace weft::test {
namespace {

using std::numbers::pi;

Vector3 to_double(const std::array<float, 3>& a) {
  return {a[0], a[1], a[2]};
}

// The unit sphere in `rows` x 2 rows patches, with the texture of make_sphere({1, 1}).
TriangleMesh sphere_mesh(std::size_t rows) {
  TriangleMesh mesh;
  const std::size_t columns = 2 * rows;
  for (std::size_t i = 0; i <= rows; ++i) {
    for (std::size_t k = 0; k <= columns; ++k) {
      const double v = static_cast<double>(i) / static_cast<double>(rows);
      const double u = static_cast<double>(k) / static_cast<double>(columns);
      const double latitude = pi * (v - 0.5), longitude = 2 * pi * (u - 0.5);
      const std::array<float, 3> p =
          to_float({std::cos(latitude) * std::sin(longitude),
                    -std::cos(latitude) * std::cos(longitude), std::sin(latitude)});
      mesh.vertices.push_back({p, p, {static_cast<float>(2 * u), static_cast<float>(v)}});
    }
  }
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t k = 0; k < columns; ++k) {
      const auto a = static_cast<std::uint32_t>(i * (columns + 1) + k);
      const auto c = static_cast<std::uint32_t>(a + columns + 1);
      mesh.triangles.push_back({a, a + 1, c + 1});
      mesh.triangles.push_back({a, c + 1, c});
    }
  }
  return mesh;
}

// A square of two triangles over [-1, 1]^2 at z = 0.
TriangleMesh square_mesh() {
  TriangleMesh mesh;
  mesh.vertices = {{{-1, -1, 0}, {0, 0, 1}, {0, 0}},
                   {{1, -1, 0}, {0, 0, 1}, {1, 0}},
                   {{1, 1, 0}, {0, 0, 1}, {1, 1}},
                   {{-1, 1, 0}, {0, 0, 1}, {0, 1}}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

Vector3 random_unit(Random& random) {
  const double z = random.uniform(-1, 1), phi = random.uniform(0, 2 * pi);
  const double r = std::sqrt(1 - z * z);
  return {r * std::cos(phi), r * std::sin(phi), z};
}

TEST(MeshShape, OfASphereIsTheSphere) {
  constexpr std::size_t rows = 128;
  const auto mesh = make_mesh_shape(sphere_mesh(rows), {3, 3});
  const auto sphere = make_sphere({3, 3});
  // A chord of pi / rows lies below its arc by (pi / rows)^2 / 8.
  const double sagitta = pi / rows * pi / rows / 4;
  Random random(1);
  int compared = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vector3 eye = scaled(random_unit(random), 3);
    const Ray ray{eye, normalized(difference(scaled(random_unit(random), 0.7), eye))};
    const auto a = mesh->intersect(ray), b = sphere->intersect(ray);
    ASSERT_EQ(a.has_value(), b.has_value());
    if (std::abs(b->position[2]) > 0.9) continue;  // where longitudes are close together
    ++compared;
    EXPECT_NEAR(a->distance, b->distance, 4 * sagitta);
    EXPECT_LT(length(difference(a->normal, b->normal)), 4 * sagitta + 1e-3);
    EXPECT_NEAR(a->uv[0], b->uv[0], 6 / pi * 10 * sagitta);
    EXPECT_NEAR(a->uv[1], b->uv[1], 3 / pi * 10 * sagitta);
    EXPECT_NEAR(length(a->along_u) / length(b->along_u), 1, 0.02);
    EXPECT_NEAR(length(a->along_v) / length(b->along_v), 1, 0.02);
    const Vector3 to_eye = scaled(ray.direction, -1);
    const TangentFrame f = tangent_frame(*a, to_eye), g = tangent_frame(*b, to_eye);
    EXPECT_GT(dot(f.tangent, g.tangent), 1 - 1e-3);
    EXPECT_GT(dot(f.bitangent, g.bitangent), 1 - 1e-3);
  }
  EXPECT_GT(compared, 1000);
}

// Light that is above the horizon of the smooth normal reaches even a coarse sphere, and what is
// turned away from it stays dark.
TEST(MeshShape, HasASmoothTerminator) {
  const auto mesh = make_mesh_shape(sphere_mesh(16), {1, 1});
  Random random(2);
  for (int i = 0; i < 3000; ++i) {
    const Vector3 out = random_unit(random), light = random_unit(random);
    const auto hit = mesh->intersect({scaled(out, 3), scaled(out, -1)});
    ASSERT_TRUE(hit.has_value());
    const double cosine = dot(hit->normal, light);
    const bool dark = mesh->occludes(hit->shadow_origin, hit->geometric_normal, light);
    // The normals of a facet are up to half its opening, 11 degrees, away from it.
    if (cosine > 0.03) {
      EXPECT_FALSE(dark) << cosine;
    }
    if (cosine < -0.3) {
      EXPECT_TRUE(dark) << cosine;
    }
  }
}

TEST(MeshShape, DoesNotShadowItself) {
  const auto square = make_mesh_shape(square_mesh(), {1, 1});
  Random random(3);
  for (int i = 0; i < 2000; ++i) {
    const Vector3 target{random.uniform(-0.9, 0.9), random.uniform(-0.9, 0.9), 0};
    Vector3 up = random_unit(random), light = random_unit(random);
    up[2] = std::abs(up[2]) + 0.01;
    light[2] = std::abs(light[2]) + 1e-3;
    const Vector3 eye = sum(target, scaled(normalized(up), 5));
    const auto hit = square->intersect({eye, normalized(difference(target, eye))});
    ASSERT_TRUE(hit.has_value());
    EXPECT_FALSE(square->occludes(hit->shadow_origin, hit->geometric_normal, normalized(light)));
    EXPECT_TRUE(
        square->occludes(hit->shadow_origin, hit->geometric_normal, normalized(scaled(light, -1))));
  }
}

TEST(MeshShape, IsSeenFromBehindToo) {
  const auto square = make_mesh_shape(square_mesh(), {1, 1});
  const auto hit = square->intersect({{0.5, 0.25, -3}, {0, 0, 1}});
  ASSERT_TRUE(hit.has_value());
  EXPECT_EQ(hit->normal[2], -1);
  const TangentFrame frame = tangent_frame(*hit, {0, 0, -1});
  EXPECT_NEAR(frame.tangent[0], 1, 1e-12);
  EXPECT_NEAR(frame.bitangent[1], 1, 1e-12);
  EXPECT_NEAR(hit->uv[0], 0.75, 1e-6);
}

TEST(MeshShape, CastsTheSameOnAnyNumberOfThreads) {
  Scene scene;
  scene.camera.width = scene.camera.height = 64;
  scene.shape = make_mesh_shape(sphere_mesh(12), {2, 2});
  scene.lights = {light_at_degrees(70, 30, {1, 1, 1})};
  PixelBatch one, four;
  RayCaster(scene, 1).cast(0, 64 * 64, one);
  scene.shape = make_mesh_shape(sphere_mesh(12), {2, 2});
  RayCaster(scene, 4).cast(0, 64 * 64, four);
  ASSERT_EQ(one.points.size(), four.points.size());
  for (std::size_t i = 0; i < one.points.size(); ++i) {
    EXPECT_EQ(one.points[i].uv, four.points[i].uv);
    EXPECT_EQ(one.points[i].view, four.points[i].view);
    EXPECT_EQ(one.lights[i].irradiance, four.lights[i].irradiance);
  }
}

TEST(TriangleMesh, IsValidated) {
  const auto refused = [](std::initializer_list<std::string_view> parts, const auto& change) {
    TriangleMesh mesh = square_mesh();
    change(mesh);
    expect_error(ErrorKind::input, parts, [&] { make_mesh_shape(mesh, {1, 1}); });
  };
  refused({"no triangles"}, [](TriangleMesh& m) { m.triangles.clear(); });
  refused({"triangle 1", "vertex 4 of 4"}, [](TriangleMesh& m) { m.triangles[1][2] = 4; });
  refused({"vertex 2", "nan"}, [](TriangleMesh& m) { m.vertices[2].position[0] = NAN; });
  refused({"vertex 3", "texture"}, [](TriangleMesh& m) { m.vertices[3].uv[1] = INFINITY; });
  refused({"vertex 0", "normal"}, [](TriangleMesh& m) { m.vertices[0].normal = {0, 0, 2}; });
  refused({"2 triangles", "area"}, [](TriangleMesh& m) {
    for (TriangleMesh::Vertex& vertex : m.vertices) vertex.position[1] = 0;
  });
}

TEST(TriangleMesh, FitsTheUnitSphere) {
  TriangleMesh mesh = square_mesh();
  for (auto& vertex : mesh.vertices) {
    for (float& x : vertex.position) x = 7 + 10 * x;
  }
  fit_unit_sphere(mesh);
  EXPECT_NEAR(length(to_double(mesh.vertices[0].position)), 1, 1e-6);
  EXPECT_NEAR(mesh.vertices[2].position[0], std::sqrt(0.5), 1e-6);
  EXPECT_NEAR(mesh.vertices[2].position[2], 0, 1e-6);
}

// The texture lies on the cloth as it does on the flat one: its sides are 2 long, and few threads
// are stretched.
TEST(DrapedCloth, KeepsItsLengths) {
  constexpr std::size_t cells = 60;
  const TriangleMesh mesh = make_draped_cloth(cells);
  ASSERT_EQ(mesh.vertices.size(), (cells + 1) * (cells + 1));
  validate(mesh, "cloth");
  std::vector<double> stretches;
  for (const auto& triangle : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto &a = mesh.vertices[triangle[k]], &b = mesh.vertices[triangle[(k + 1) % 3]];
      const double du = double{a.uv[0]} - b.uv[0], dv = double{a.uv[1]} - b.uv[1];
      if (du != 0 && dv != 0) continue;  // along the yarns only: across, cloth shears
      const double l = length(difference(to_double(a.position), to_double(b.position)));
      stretches.push_back(l / (2 * std::hypot(du, dv)));
    }
  }
  std::sort(stretches.begin(), stretches.end());
  const auto quantile = [&](double q) {
    return stretches[static_cast<std::size_t>(q * static_cast<double>(stretches.size() - 1))];
  };
  EXPECT_NEAR(quantile(0.5), 1, 0.04);
  EXPECT_GT(quantile(0.02), 0.8);
  EXPECT_LT(quantile(0.98), 1.15);
  // It hangs: over the top of the ball, and far down at the corners.
  double top = -10, bottom = 10;
  for (const auto& vertex : mesh.vertices) {
    top = std::max(top, double{vertex.position[2]});
    bottom = std::min(bottom, double{vertex.position[2]});
  }
  EXPECT_NEAR(top, 0.57, 0.03);
  EXPECT_LT(bottom, -0.3);
  // Normals follow the triangles.
  double agreement = 0;
  for (const auto& t : mesh.triangles) {
    const Vector3 a = to_double(mesh.vertices[t[0]].position);
    const Vector3 normal =
        normalized(cross(difference(to_double(mesh.vertices[t[1]].position), a),
                         difference(to_double(mesh.vertices[t[2]].position), a)));
    agreement += dot(normal, to_double(mesh.vertices[t[0]].normal));
  }
  EXPECT_GT(agreement / static_cast<double>(mesh.triangles.size()), 0.95);
  // And it is the same on every run.
  const TriangleMesh again = make_draped_cloth(cells);
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    ASSERT_EQ(mesh.vertices[i].position, again.vertices[i].position);
  }
  expect_error(ErrorKind::input, {"0 cells"}, [] { make_draped_cloth(0); });
}

class ObjFile {
 public:
  TriangleMesh read(const std::string& text, UpAxis up = UpAxis::z) const {
    std::ofstream(path(), std::ios::binary) << text;
    return read_obj(path(), up);
  }
  void expect_refused(const std::string& text,
                      std::initializer_list<std::string_view> parts) const {
    expect_error(ErrorKind::input, {"mesh.obj"}, [&] { read(text); });
    expect_error(ErrorKind::input, parts, [&] { read(text); });
  }

 private:
  std::filesystem::path path() const { return folder_ / "mesh.obj"; }
  TemporaryFolder folder_;
};

const std::string square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

TEST(Obj, ReadsFacesOfAnyKind) {
  const ObjFile file;
  const TriangleMesh quad = file.read(square + "f 1/1 2/2 3/3 4/4\n");
  EXPECT_EQ(quad.vertices.size(), 4u);
  EXPECT_EQ(quad.triangles.size(), 2u);
  EXPECT_EQ(quad.vertices[0].normal, (std::array<float, 3>{0, 0, 1}));
  // Negative indices, normals, comments, carriage returns, groups, a face without a line's end.
  const TriangleMesh same =
      file.read("# cube\r\nmtllib x.mtl\r\ng a b\r\n" + square +
                "vn 0 0 5 # long\r\nusemtl m\r\ns 1\r\n  f\t-4/-4/-1 -3/-3/-1  -2/-2/1 -1/-1/1");
  EXPECT_EQ(same.triangles, quad.triangles);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(same.vertices[i].position, quad.vertices[i].position);
    EXPECT_EQ(same.vertices[i].uv, quad.vertices[i].uv);
    EXPECT_EQ(same.vertices[i].normal, quad.vertices[i].normal);
  }
  // Corners that differ in their texture are vertices of their own.
  EXPECT_EQ(file.read(square + "f 1/1 2/2 3/3\nf 1/2 3/3 4/4\n").vertices.size(), 5u);
  const TriangleMesh turned = file.read(square + "v 5 6 7\nf 1/1 2/2 5/3\n", UpAxis::y);
  EXPECT_EQ(turned.vertices[2].position, (std::array<float, 3>{5, -7, 6}));
}

// The area of a polygon with a notch is covered once.
TEST(Obj, JoinsLinesThatAreContinued) {
  const ObjFile file;
  const TriangleMesh split = file.read(square + "f 1/1 \\\n2/2\\\r\n 3/3 # last\nf 1/1 3/3 4/4\n");
  EXPECT_EQ(split.triangles.size(), 2u);
  EXPECT_EQ(file.read(square + "f 1/1 2/2 3/3 \\").triangles.size(), 1u);
  file.expect_refused(square + "f 1/1 \\\n2/2 \\\n9/3\n", {"line 11", "position 9 of 4"});
}

TEST(Obj, CutsConcavePolygons) {
  const ObjFile file;
  for (const std::string& face : std::vector<std::string>{"1/1 2/1 3/1 4/1", "2/1 3/1 4/1 1/1",
                                                          "3/1 4/1 1/1 2/1", "4/1 1/1 2/1 3/1"}) {
    const TriangleMesh arrow =
        file.read("v 0 0 0\nv 2 -2 0\nv 0 4 0\nv -2 -2 0\nvt 0 0\nf " + face + "\n");
    ASSERT_EQ(arrow.triangles.size(), 2u);
    double area = 0;
    for (const auto& t : arrow.triangles) {
      const Vector3 a = to_double(arrow.vertices[t[0]].position);
      const Vector3 normal = cross(difference(to_double(arrow.vertices[t[1]].position), a),
                                   difference(to_double(arrow.vertices[t[2]].position), a));
      EXPECT_GT(normal[2], 0);
      area += normal[2] / 2;
    }
    EXPECT_NEAR(area, 8, 1e-6);
  }
  // A polygon that crosses itself, and one without area, end all the same.
  EXPECT_EQ(file.read(square + "f 1/1 3/3 2/2 4/4\n").triangles.size(), 2u);
  EXPECT_EQ(file.read(square + "f 1/1 2/2 3/3\nf 1/1 1/1 1/1 1/1 1/1\n").triangles.size(), 4u);
}

TEST(Obj, SmoothsNormalsThatAreNotGiven) {
  const ObjFile file;
  // A roof: the ridge's normal is the mean of its sides'.
  const TriangleMesh roof = file.read(
      "v 0 0 1\nv 1 0 1\nv 0 -1 0\nv 1 -1 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 0 1\n"
      "f 3/1 4/1 2/1 1/1\nf 1/2 2/2 6/2 5/2\n");
  for (const auto& vertex : roof.vertices) {
    if (vertex.position[2] == 1) {
      EXPECT_NEAR(vertex.normal[1], 0, 1e-6);
      EXPECT_NEAR(vertex.normal[2], 1, 1e-6);
    } else {
      EXPECT_NEAR(vertex.normal[1], vertex.position[1] * std::sqrt(0.5), 1e-6);
    }
  }
}

TEST(Obj, NamesLineAndValue) {
  const ObjFile file;
  file.expect_refused("", {"no faces"});
  file.expect_refused(square, {"no faces"});
  file.expect_refused(square + "f 1 2 3\n", {"line 9", "'1'", "no texture coordinates (vt)"});
  file.expect_refused(square + "f 1//1 2//1 3//1\n", {"line 9", "no texture coordinates"});
  file.expect_refused(square + "f 1/1 2/2 5/3\n", {"line 9", "position 5 of 4"});
  file.expect_refused(square + "f 1/1 2/2 3/-5\n", {"line 9", "vt -5 of 4"});
  file.expect_refused(square + "f 1/1 2/2 0/1\n", {"line 9", "position 0"});
  file.expect_refused(square + "f 1/1/1 2/2/1 3/3/1\n", {"line 9", "vn 1 of 0"});
  file.expect_refused(square + "f 1/1 2/2\n", {"line 9", "2 corners"});
  file.expect_refused(square + "f 1/1/1/1 2/2 3/3\n", {"line 9", "1/1/1/1"});
  file.expect_refused(square + "f 1/1 2/2 99999999999999999999/1\n", {"line 9", "9999"});
  file.expect_refused(square + "f 1/1 2/x 3/3\n", {"line 9", "'x'"});
  file.expect_refused("v 1 2\n", {"line 1", "2 numbers where 3"});
  file.expect_refused("v 1 2 abc\n", {"line 1", "'abc'"});
  file.expect_refused("v 1 2 nan\n", {"line 1", "nan"});
  file.expect_refused("\nv 1 2 1e39\n", {"line 2", "1e39"});
  file.expect_refused("v 1 2 1e7\n", {"line 1", "1e7"});
  std::string many = square + "f";
  for (int i = 0; i < 300; ++i) many += " 1/1";
  file.expect_refused(many, {"line 9", "more than 256"});
  EXPECT_EQ(file.read("v 1e-50 0 0\n" + square + "f 1/1 3/2 4/3\n").vertices[0].position[0], 0);
}

TEST(Obj, SurvivesDamage) {
  const ObjFile file;
  const std::string text = square + "vn 0 0 1\nf 1/1/1 2/2/1 3/3/1 4/4/1\nf -4/1 -3/2 -2/3\n";
  Random random(4);
  for (int i = 0; i < 200; ++i) {
    try {
      const TriangleMesh mesh = file.read(mutate(text, text.size(), random));
      validate(mesh, "damaged");
    } catch (const Error& error) {
      ASSERT_EQ(error.kind(), ErrorKind::input) << error.what();
    }
  }
}

}  // namespace
}  // namespace weft::test
