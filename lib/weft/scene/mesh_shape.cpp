// Triangle meshes, traced by Embree.
#include <embree3/rtcore.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>

#include "weft/error.hpp"
#include "weft/scene/shape.hpp"
#include "weft/scene/triangle_mesh.hpp"
#include "weft/scene/vector.hpp"

namespace weft {
namespace {

// How far rays towards lights start above the surface, relative to the size of the mesh: some
// hundred ulps of float, which Embree computes in.
constexpr double offset_ratio = 1e-5;

struct DeviceRelease {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};
struct SceneRelease {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
using DeviceHandle = std::unique_ptr<RTCDeviceTy, DeviceRelease>;
using SceneHandle = std::unique_ptr<RTCSceneTy, SceneRelease>;

Vector3 to_double(const std::array<float, 3>& a) {
  return {a[0], a[1], a[2]};
}

// Scales and adds three vectors.
Vector3 blend(const std::array<double, 3>& weights, const Vector3& a, const Vector3& b,
              const Vector3& c) {
  return sum(scaled(a, weights[0]), sum(scaled(b, weights[1]), scaled(c, weights[2])));
}

// dp/du and dp/dv.
struct Derivatives {
  Vector3 along_u{}, along_v{};
};

class MeshShape : public Shape {
 public:
  MeshShape(const TriangleMesh& mesh, const Repeat& repeat) : mesh_(mesh) {
    for (TriangleMesh::Vertex& vertex : mesh_.vertices) {
      for (std::size_t i = 0; i < 2; ++i) {
        vertex.uv[i] = static_cast<float>(double{vertex.uv[i]} * repeat[i]);
      }
      for (const float x : vertex.position) extent_ = std::max(extent_, std::abs(double{x}));
    }
    average_derivatives();
    build();
  }

  std::optional<SurfaceHit> intersect(const Ray& ray) const override {
    RTCRayHit query{};
    set_ray(query.ray, ray.origin, ray.direction);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene_.get(), &context, &query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
    const double u = std::clamp(double{query.hit.u}, 0.0, 1.0);
    const double v = std::clamp(double{query.hit.v}, 0.0, 1 - u);
    return hit_at(query.hit.primID, {1 - u - v, u, v}, ray);
  }

  bool occludes(const Vector3& point, const Vector3& normal,
                const Vector3& direction) const override {
    RTCRay ray{};
    set_ray(ray, sum(point, scaled(normal, offset_ratio * extent_)), direction);
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene_.get(), &context, &ray);
    return ray.tfar < 0;
  }

  std::size_t bytes() const override {
    return mesh_.vertices.size() * sizeof(TriangleMesh::Vertex) +
           mesh_.triangles.size() * sizeof(mesh_.triangles[0]) +
           vertex_derivatives_.size() * sizeof(Derivatives) +
           static_cast<std::size_t>(std::max<std::ptrdiff_t>(traced_bytes_, 0));
  }

 private:
  // What Embree allocates and frees.
  static bool count_bytes(void* counter, ssize_t bytes, bool /*post*/) {
    *static_cast<std::atomic<std::ptrdiff_t>*>(counter) += bytes;
    return true;
  }

  static void set_ray(RTCRay& ray, const Vector3& origin, const Vector3& direction) {
    const std::array<float, 3> o = to_float(origin), d = to_float(direction);
    ray.org_x = o[0];
    ray.org_y = o[1];
    ray.org_z = o[2];
    ray.dir_x = d[0];
    ray.dir_y = d[1];
    ray.dir_z = d[2];
    ray.tnear = 0;
    ray.tfar = std::numeric_limits<float>::infinity();
    ray.mask = ~0u;
  }

  // Of a triangle; zero where its texture coordinates span no area.
  Derivatives derivatives(const std::array<std::uint32_t, 3>& triangle) const {
    const TriangleMesh::Vertex &a = mesh_.vertices[triangle[0]], &b = mesh_.vertices[triangle[1]],
                               &c = mesh_.vertices[triangle[2]];
    const Vector3 e1 = difference(to_double(b.position), to_double(a.position));
    const Vector3 e2 = difference(to_double(c.position), to_double(a.position));
    const double u1 = double{b.uv[0]} - a.uv[0], v1 = double{b.uv[1]} - a.uv[1];
    const double u2 = double{c.uv[0]} - a.uv[0], v2 = double{c.uv[1]} - a.uv[1];
    const double determinant = u1 * v2 - u2 * v1;
    const double scale = std::max({std::abs(u1), std::abs(v1), std::abs(u2), std::abs(v2)});
    if (!(std::abs(determinant) > 1e-6 * scale * scale)) return {};
    return {scaled(difference(scaled(e1, v2), scaled(e2, v1)), 1 / determinant),
            scaled(difference(scaled(e2, u1), scaled(e1, u2)), 1 / determinant)};
  }

  // At vertices the mean of the triangles around, so that the material turns without a step.
  void average_derivatives() {
    vertex_derivatives_.resize(mesh_.vertices.size());
    std::vector<double> counts(mesh_.vertices.size());
    for (const auto& triangle : mesh_.triangles) {
      const Derivatives own = derivatives(triangle);
      if (own.along_u == Vector3{}) continue;
      for (const std::uint32_t i : triangle) {
        Derivatives& at = vertex_derivatives_[i];
        at = {sum(at.along_u, own.along_u), sum(at.along_v, own.along_v)};
        counts[i] += 1;
      }
    }
    for (std::size_t i = 0; i < counts.size(); ++i) {
      if (counts[i] == 0) continue;
      Derivatives& at = vertex_derivatives_[i];
      at = {scaled(at.along_u, 1 / counts[i]), scaled(at.along_v, 1 / counts[i])};
    }
  }

  void build() {
    // One thread builds, so that the tree, and which of two triangles a ray through their common
    // edge meets, are the same on every run.
    device_.reset(rtcNewDevice("threads=1,set_affinity=0"));
    if (!device_)
      fail_runtime("Embree: no device: error {}", static_cast<int>(rtcGetDeviceError(nullptr)));
    rtcSetDeviceMemoryMonitorFunction(device_.get(), count_bytes, &traced_bytes_);
    scene_.reset(rtcNewScene(device_.get()));
    rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST);
    RTCGeometry geometry = rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* const positions = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                3 * sizeof(float), mesh_.vertices.size()));
    auto* const indices = static_cast<std::uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(std::uint32_t), mesh_.triangles.size()));
    if (positions != nullptr && indices != nullptr) {
      for (std::size_t i = 0; i < mesh_.vertices.size(); ++i) {
        std::copy_n(mesh_.vertices[i].position.begin(), 3, positions + 3 * i);
      }
      std::memcpy(indices, mesh_.triangles.data(),
                  mesh_.triangles.size() * 3 * sizeof(std::uint32_t));
      rtcCommitGeometry(geometry);
      rtcAttachGeometry(scene_.get(), geometry);
    }
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene_.get());
    const RTCError error = rtcGetDeviceError(device_.get());
    if (error != RTC_ERROR_NONE) {
      fail_runtime("Embree: a mesh of {} triangles can't be prepared: error {}",
                   mesh_.triangles.size(), static_cast<int>(error));
    }
  }

  // The mean of the vertices' derivatives; the triangle's own where theirs disagree with it, as
  // they do where a texture is mirrored.
  static Vector3 smooth(const Vector3& own, const Vector3& mean) {
    return dot(own, mean) > 0.25 * dot(own, own) ? mean : own;
  }

  SurfaceHit hit_at(std::uint32_t index, const std::array<double, 3>& weights,
                    const Ray& ray) const {
    const std::array<std::uint32_t, 3>& triangle = mesh_.triangles[index];
    const TriangleMesh::Vertex &a = mesh_.vertices[triangle[0]], &b = mesh_.vertices[triangle[1]],
                               &c = mesh_.vertices[triangle[2]];
    const Vector3 pa = to_double(a.position), pb = to_double(b.position),
                  pc = to_double(c.position);
    SurfaceHit hit;
    hit.position = blend(weights, pa, pb, pc);
    hit.distance = dot(difference(hit.position, ray.origin), ray.direction);
    for (std::size_t i = 0; i < 2; ++i) {
      hit.uv[i] = weights[0] * a.uv[i] + weights[1] * b.uv[i] + weights[2] * c.uv[i];
    }
    // Normals, on the side that is looked at.
    hit.geometric_normal = normalized(cross(difference(pb, pa), difference(pc, pa)));
    if (dot(hit.geometric_normal, ray.direction) > 0) {
      hit.geometric_normal = scaled(hit.geometric_normal, -1);
    }
    std::array<Vector3, 3> normals{to_double(a.normal), to_double(b.normal), to_double(c.normal)};
    for (Vector3& normal : normals) {
      if (dot(normal, hit.geometric_normal) < 0) normal = scaled(normal, -1);
    }
    const Vector3 blended = blend(weights, normals[0], normals[1], normals[2]);
    hit.normal = length(blended) > 1e-3 ? normalized(blended) : hit.geometric_normal;
    // Up to the planes of the vertices' normals.
    hit.shadow_origin = hit.position;
    const std::array<Vector3, 3> corners{pa, pb, pc};
    for (std::size_t i = 0; i < 3; ++i) {
      const double below = std::min(0.0, dot(difference(hit.position, corners[i]), normals[i]));
      hit.shadow_origin = difference(hit.shadow_origin, scaled(normals[i], weights[i] * below));
    }
    const Derivatives own = derivatives(triangle);
    const auto mean = [&](Vector3 Derivatives::*which) {
      return blend(weights, vertex_derivatives_[triangle[0]].*which,
                   vertex_derivatives_[triangle[1]].*which,
                   vertex_derivatives_[triangle[2]].*which);
    };
    hit.along_u = smooth(own.along_u, mean(&Derivatives::along_u));
    hit.along_v = smooth(own.along_v, mean(&Derivatives::along_v));
    return hit;
  }

  TriangleMesh mesh_;
  std::vector<Derivatives> vertex_derivatives_;
  double extent_ = 0;
  std::atomic<std::ptrdiff_t> traced_bytes_{0};  // outlives the device, which counts in it
  DeviceHandle device_;
  SceneHandle scene_;
};

}  // namespace

std::shared_ptr<const Shape> make_mesh_shape(const TriangleMesh& mesh, const Repeat& repeat) {
  validate(repeat);
  validate(mesh, "mesh");
  return std::make_shared<MeshShape>(mesh, repeat);
}

}  // namespace weft
