// Wavefront OBJ files: lines of v, vt, vn and f; everything else is passed over.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string_view>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/mapped_file.hpp"
#include "weft/scene/triangle_mesh.hpp"
#include "weft/scene/vector.hpp"

namespace weft {
namespace {

// A file of this size makes some GiB of mesh.
constexpr std::size_t largest_file = std::size_t{1} << 30;
constexpr std::size_t most_corners = 256;
constexpr float largest_coordinate = 1e6f;

// One corner of a face: position, texture coordinates, normal (-1 where there is none).
struct Corner {
  std::int64_t position, uv, normal;
  auto operator<=>(const Corner&) const = default;
};

class ObjReader {
 public:
  ObjReader(std::string_view text, std::string name, UpAxis up)
      : text_(text), name_(std::move(name)), up_(up) {}

  TriangleMesh read() {
    while (!text_.empty()) {
      line_ = take_line();
      const std::string_view keyword = take_word();
      if (keyword == "v") {
        positions_.push_back(oriented(numbers<3>()));
      } else if (keyword == "vt") {
        uvs_.push_back(texture_coordinates());
      } else if (keyword == "vn") {
        normals_.push_back(oriented(numbers<3>()));
      } else if (keyword == "f") {
        add_face();
      }
    }
    if (mesh_.triangles.empty()) fail_input("{}: there are no faces (f)", name_);
    smooth_normals();
    validate(mesh_, name_);
    return std::move(mesh_);
  }

 private:
  template <typename... Args>
  [[noreturn]] void fail_line(fmt::format_string<Args...> format, Args&&... args) const {
    fail_input("{}: line {}: {}", name_, line_number_,
               fmt::format(format, std::forward<Args>(args)...));
  }

  // The next line of the file, without its comment.
  std::string_view take_file_line() {
    ++line_number_;
    const std::size_t end = text_.find('\n');
    std::string_view line = text_.substr(0, end);
    text_.remove_prefix(end == std::string_view::npos ? text_.size() : end + 1);
    line = line.substr(0, line.find('#'));
    if (line.ends_with('\r')) line.remove_suffix(1);
    return line;
  }

  // The next line with those that a backslash at its end continues it with.
  std::string_view take_line() {
    std::string_view line = take_file_line();
    if (!line.ends_with('\\')) return line;
    joined_.clear();
    while (line.ends_with('\\')) {
      line.remove_suffix(1);
      joined_.append(line).push_back(' ');
      line = text_.empty() ? std::string_view() : take_file_line();
    }
    return joined_.append(line);
  }

  std::string_view take_word() {
    constexpr std::string_view space = " \t\r\v\f";
    const std::size_t begin = std::min(line_.find_first_not_of(space), line_.size());
    line_.remove_prefix(begin);
    const std::size_t end = std::min(line_.find_first_of(space), line_.size());
    const std::string_view word = line_.substr(0, end);
    line_.remove_prefix(end);
    return word;
  }

  float number(std::string_view word) const {
    std::string_view digits = word;
    if (digits.starts_with('+')) digits.remove_prefix(1);
    float value = 0;
    const auto [stop, status] =
        std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (status == std::errc::result_out_of_range && stop == digits.data() + digits.size()) {
      // Too small for a float is as good as 0; too large is told with all other large values.
      double wide = 0;
      std::from_chars(digits.data(), stop, wide);
      value = std::abs(wide) < 1 ? 0 : std::numeric_limits<float>::infinity();
    } else if (status != std::errc{} || stop != digits.data() + digits.size()) {
      fail_line("'{}' is no number", shown(word));
    }
    if (!(std::abs(value) <= largest_coordinate)) {
      fail_line("{} is not within -1e6 and 1e6", shown(word));
    }
    return value;
  }

  // The next N numbers; what follows them (a weight, a colour) is passed over.
  template <std::size_t N>
  std::array<float, N> numbers() {
    std::array<float, N> values{};
    for (std::size_t i = 0; i < N; ++i) {
      const std::string_view word = take_word();
      if (word.empty()) fail_line("{} numbers where {} are needed", i, N);
      values[i] = number(word);
    }
    return values;
  }

  // One or two numbers: v is 0 where it isn't given.
  std::array<float, 2> texture_coordinates() {
    const std::array<float, 1> u = numbers<1>();
    const std::string_view word = take_word();
    return {u[0], word.empty() ? 0 : number(word)};
  }

  std::array<float, 3> oriented(const std::array<float, 3>& a) const {
    return up_ == UpAxis::y ? std::array<float, 3>{a[0], -a[2], a[1]} : a;
  }

  // "3" of 5 is 2, "-1" is 4.
  std::int64_t index(std::string_view word, std::size_t count, std::string_view what) const {
    std::int64_t value = 0;
    const auto [stop, status] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (status != std::errc{} || stop != word.data() + word.size()) {
      fail_line("'{}' is no index", shown(word));
    }
    const auto n = static_cast<std::int64_t>(count);
    const bool exists = value > 0 ? value <= n : value < 0 && value >= -n;
    if (!exists) fail_line("{} {} of {}", what, value, count);
    return value > 0 ? value - 1 : n + value;
  }

  // position/uv or position/uv/normal.
  Corner corner(std::string_view word) const {
    const std::string_view whole = word;
    std::array<std::string_view, 3> parts{};
    std::size_t count = 0;
    while (true) {
      const std::size_t slash = word.find('/');
      if (count == 3) fail_line("corner '{}' has more than 3 indices", shown(whole));
      parts[count++] = word.substr(0, slash);
      if (slash == std::string_view::npos) break;
      word.remove_prefix(slash + 1);
    }
    if (parts[1].empty()) {
      fail_line("corner '{}' has no texture coordinates (vt), which a material needs",
                shown(whole));
    }
    return {index(parts[0], positions_.size(), "position"), index(parts[1], uvs_.size(), "vt"),
            parts[2].empty() ? -1 : index(parts[2], normals_.size(), "vn")};
  }

  void add_face() {
    corners_.clear();
    for (std::string_view word = take_word(); !word.empty(); word = take_word()) {
      if (corners_.size() == most_corners)
        fail_line("a face of more than {} corners", most_corners);
      corners_.push_back(vertex_of(corner(word)));
    }
    if (corners_.size() < 3) fail_line("a face of {} corners", corners_.size());
    cut_face();
  }

  // The mesh's vertex for a corner.
  std::uint32_t vertex_of(const Corner& corner) {
    const auto [found, made] =
        vertex_with_.try_emplace(corner, static_cast<std::uint32_t>(mesh_.vertices.size()));
    if (made) {
      TriangleMesh::Vertex vertex;
      vertex.position = positions_[static_cast<std::size_t>(corner.position)];
      vertex.uv = uvs_[static_cast<std::size_t>(corner.uv)];
      if (corner.normal >= 0) {
        const auto& n = normals_[static_cast<std::size_t>(corner.normal)];
        const double l = std::hypot(n[0], n[1], n[2]);
        if (l > 0) vertex.normal = to_float(scaled({n[0], n[1], n[2]}, 1 / l));
      }
      mesh_.vertices.push_back(vertex);
      position_of_.push_back(static_cast<std::uint32_t>(corner.position));
    }
    return found->second;
  }

  Vector3 position(std::uint32_t vertex) const {
    const auto& p = mesh_.vertices[vertex].position;
    return {p[0], p[1], p[2]};
  }

  // Cuts ears off until a triangle is left; a polygon without an ear, as one that crosses itself
  // may be, is cut from its first corner.
  void cut_face() {
    Vector3 normal{};
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      normal =
          sum(normal, cross(position(corners_[i]), position(corners_[(i + 1) % corners_.size()])));
    }
    for (std::size_t n = corners_.size(); n > 3; --n) {
      std::size_t ear = 0;
      while (ear < n && !is_ear(ear, normal)) ++ear;
      const std::size_t at = ear < n ? ear : 1;
      mesh_.triangles.push_back({corners_[(at + n - 1) % n], corners_[at], corners_[(at + 1) % n]});
      corners_.erase(corners_.begin() + static_cast<std::ptrdiff_t>(at));
    }
    mesh_.triangles.push_back({corners_[0], corners_[1], corners_[2]});
  }

  // A convex corner whose triangle holds no other corner.
  bool is_ear(std::size_t i, const Vector3& normal) const {
    const std::size_t n = corners_.size(), before = (i + n - 1) % n, after = (i + 1) % n;
    const Vector3 a = position(corners_[before]), b = position(corners_[i]),
                  c = position(corners_[after]);
    const auto turn = [&normal](const Vector3& p, const Vector3& q, const Vector3& r) {
      return dot(normal, cross(difference(q, p), difference(r, p)));
    };
    if (turn(a, b, c) <= 0) return false;
    for (std::size_t k = 0; k < n; ++k) {
      if (k == before || k == i || k == after) continue;
      const Vector3 p = position(corners_[k]);
      if (turn(a, b, p) >= 0 && turn(b, c, p) >= 0 && turn(c, a, p) >= 0) return false;
    }
    return true;
  }

  // Fills in normals that are not given: the mean of the triangles round the position, weighted by
  // their angle there. Without area, up.
  void smooth_normals() {
    std::vector<Vector3> mean(positions_.size());
    for (const auto& triangle : mesh_.triangles) {
      for (std::size_t k = 0; k < 3; ++k) {
        const Vector3 at = position(triangle[k]);
        const Vector3 u = difference(position(triangle[(k + 1) % 3]), at);
        const Vector3 v = difference(position(triangle[(k + 2) % 3]), at);
        const Vector3 normal = cross(u, v);
        const double l = length(normal);
        if (l == 0) continue;
        Vector3& sum_at = mean[position_of_[triangle[k]]];
        sum_at = sum(sum_at, scaled(normal, std::atan2(l, dot(u, v)) / l));
      }
    }
    for (std::size_t i = 0; i < mesh_.vertices.size(); ++i) {
      auto& normal = mesh_.vertices[i].normal;
      if (normal != std::array<float, 3>{}) continue;
      const Vector3& smooth = mean[position_of_[i]];
      normal =
          length(smooth) > 1e-12 ? to_float(normalized(smooth)) : std::array<float, 3>{0, 0, 1};
    }
  }

  std::string_view text_;
  std::string name_;
  UpAxis up_;
  std::string joined_;  // a line that was continued
  std::string_view line_;
  std::size_t line_number_ = 0;
  std::vector<std::array<float, 3>> positions_, normals_;
  std::vector<std::array<float, 2>> uvs_;
  std::vector<std::uint32_t> corners_;      // of the face at hand
  std::vector<std::uint32_t> position_of_;  // [vertices of the mesh]
  std::map<Corner, std::uint32_t> vertex_with_;
  TriangleMesh mesh_;
};

}  // namespace

TriangleMesh read_obj(const std::filesystem::path& path, UpAxis up) {
  const MappedFile file(path);
  const auto bytes = file.bytes();
  if (bytes.size() > largest_file) {
    fail_input("{}: an OBJ of {} bytes; at most {} are read", path.string(), bytes.size(),
               largest_file);
  }
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  return ObjReader(text, path.string(), up).read();
}

}  // namespace weft
