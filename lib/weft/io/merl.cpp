#include "weft/io/merl.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <numbers>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/atomic_file.hpp"

namespace weft {
namespace {

static_assert(std::endian::native == std::endian::little, "files are little-endian");

using Vector = std::array<double, 3>;

constexpr std::array<double, 3> scales{1.0 / 1500, 1.15 / 1500, 1.66 / 1500};
constexpr std::array<std::int32_t, 3> dimensions{merl_theta_h, merl_theta_d, merl_phi_d};
constexpr std::size_t header_bytes = sizeof dimensions;
constexpr std::size_t file_bytes = header_bytes + 3 * merl_cells * sizeof(double);
constexpr double pi = std::numbers::pi;
constexpr double invalid = -1;

double dot(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Two neighbouring cells and the share of the second.
struct Step {
  std::array<std::size_t, 2> cells{};
  double fraction = 0;
};

Step step_within(double position, std::size_t cells) {
  const double inside = std::clamp(position, 0.0, static_cast<double>(cells - 1));
  const double low = std::min(std::floor(inside), static_cast<double>(cells - 2));
  const auto first = static_cast<std::size_t>(low);
  return {{first, first + 1}, inside - low};
}

Step step_round(double position, std::size_t cells) {
  const auto around = static_cast<double>(cells);
  const double inside = position - std::floor(position / around) * around;
  const double low = std::min(std::floor(inside), around - 1);
  const auto first = static_cast<std::size_t>(low);
  return {{first, (first + 1) % cells}, std::clamp(inside - low, 0.0, 1.0)};
}

class MerlSource final : public TileSource {
 public:
  MerlSource(const std::vector<std::filesystem::path>& paths, BtfInfo info)
      : info_(std::move(info)) {
    for (const std::filesystem::path& path : paths) files_.emplace_back(path);
    for (const Direction& d : info_.view_directions) views_.push_back(unit(d));
    for (const Direction& d : info_.light_directions) lights_.push_back(unit(d));
  }

  const BtfInfo& info() const override { return info_; }

  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    std::vector<float> image(info_.shape.image_values());
    for (std::size_t i = 0; i < count; ++i) {
      const MerlPosition position = merl_position(views_[(first + i) / lights_.size()],
                                                  lights_[(first + i) % lights_.size()]);
      for (std::size_t p = 0; p < files_.size(); ++p) {
        const Vector value = files_[p].at(position).value_or(Vector{});
        for (std::size_t c = 0; c < 3; ++c) image[p * 3 + c] = static_cast<float>(value[c]);
      }
      std::memcpy(out.data() + i * info_.image_bytes(), image.data(), info_.image_bytes());
    }
  }

 private:
  static Vector unit(const Direction& d) {
    const Vector v{d[0], d[1], std::max(d[2], 0.0f)};
    const double length = std::sqrt(dot(v, v));
    return {v[0] / length, v[1] / length, v[2] / length};
  }

  BtfInfo info_;
  std::vector<MerlFile> files_;
  std::vector<Vector> views_, lights_;
};

}  // namespace

MerlPosition merl_position(const Vector& view, const Vector& light) {
  Vector h{view[0] + light[0], view[1] + light[1], view[2] + light[2]};
  double length = std::sqrt(dot(h, h));
  if (length == 0) {  // opposite each other on the horizon: their middle is the zenith
    h = {0, 0, 1};
    length = 1;
  }
  for (double& x : h) x /= length;
  const double sine_h = std::hypot(h[0], h[1]);
  const double theta_h = std::atan2(sine_h, h[2]);
  // The frame of the half vector: x' in the plane of the normal, y' along the surface.
  const double c = sine_h > 0 ? h[0] / sine_h : 1, s = sine_h > 0 ? h[1] / sine_h : 0;
  const double x = dot({h[2] * c, h[2] * s, -sine_h}, light);
  const double y = dot({-s, c, 0}, light);
  const double theta_d = std::atan2(std::hypot(x, y), dot(h, light));
  double phi_d = std::atan2(y, x);
  if (phi_d < 0) phi_d += pi;
  return {std::sqrt(theta_h / (pi / 2)) * merl_theta_h - 0.5,
          theta_d / (pi / 2) * merl_theta_d - 0.5, phi_d / pi * merl_phi_d - 0.5};
}

std::optional<DirectionPair> merl_directions(std::size_t theta_h, std::size_t theta_d,
                                             std::size_t phi_d) {
  const double root = (static_cast<double>(theta_h) + 0.5) / merl_theta_h;
  const double th = pi / 2 * root * root;
  const double td = pi / 2 * (static_cast<double>(theta_d) + 0.5) / merl_theta_d;
  const double pd = pi * (static_cast<double>(phi_d) + 0.5) / merl_phi_d;
  const Vector h{std::sin(th), 0, std::cos(th)}, across{std::cos(th), 0, -std::sin(th)};
  const Vector d{std::sin(td) * std::cos(pd), std::sin(td) * std::sin(pd), std::cos(td)};
  DirectionPair pair;
  for (std::size_t k = 0; k < 3; ++k) {
    const double y = k == 1 ? d[1] : 0;
    pair.light[k] = d[2] * h[k] + (d[0] * across[k] + y);
    pair.view[k] = d[2] * h[k] - (d[0] * across[k] + y);
  }
  if (pair.light[2] < 0 || pair.view[2] < 0) return std::nullopt;
  return pair;
}

MerlFile::MerlFile(const std::filesystem::path& path) : file_(path) {
  const std::span<const std::byte> bytes = file_.bytes();
  std::array<std::int32_t, 3> found{};
  if (bytes.size() < header_bytes) {
    fail_input("{}: {} bytes are no MERL BRDF of {} bytes", path.string(), bytes.size(),
               file_bytes);
  }
  std::memcpy(found.data(), bytes.data(), header_bytes);
  if (found != dimensions) {
    fail_input("{}: dimensions {}, {}, {}: a MERL BRDF has 90, 90, 180", path.string(), found[0],
               found[1], found[2]);
  }
  if (bytes.size() != file_bytes) {
    fail_input("{}: {} bytes instead of the {} of a MERL BRDF", path.string(), bytes.size(),
               file_bytes);
  }
}

double MerlFile::cell(std::size_t channel, std::size_t index) const {
  double value = 0;
  std::memcpy(&value,
              file_.bytes().data() + header_bytes + (channel * merl_cells + index) * sizeof value,
              sizeof value);
  return value;
}

std::optional<Vector> MerlFile::at(const MerlPosition& position) const {
  const Step h = step_within(position.theta_h, merl_theta_h);
  const Step d = step_within(position.theta_d, merl_theta_d);
  const Step p = step_round(position.phi_d, merl_phi_d);
  Vector sum{};
  double weights = 0;
  for (std::size_t corner = 0; corner < 8; ++corner) {
    const std::size_t i = corner & 1, j = corner >> 1 & 1, k = corner >> 2;
    const double weight = (i ? h.fraction : 1 - h.fraction) * (j ? d.fraction : 1 - d.fraction) *
                          (k ? p.fraction : 1 - p.fraction);
    if (weight <= 0) continue;
    const std::size_t index = p.cells[k] + merl_phi_d * (d.cells[j] + merl_theta_d * h.cells[i]);
    Vector value{};
    bool valid = true;
    for (std::size_t c = 0; c < 3; ++c) {
      value[c] = cell(c, index) * scales[c];
      valid = valid && std::isfinite(value[c]) && value[c] >= 0;
    }
    if (!valid) continue;
    for (std::size_t c = 0; c < 3; ++c) sum[c] += weight * value[c];
    weights += weight;
  }
  if (weights == 0) return std::nullopt;
  for (double& x : sum) x /= weights;
  return sum;
}

std::shared_ptr<TileSource> open_merl(const std::vector<std::filesystem::path>& paths,
                                      std::vector<Direction> views, std::vector<Direction> lights) {
  BtfInfo info;
  info.shape = {views.size(), lights.size(), 1, paths.size(), 3};
  info.quantity = Quantity::brdf;
  info.view_directions = std::move(views);
  info.light_directions = std::move(lights);
  info.channel_names = {"R", "G", "B"};
  for (const std::filesystem::path& path : paths) {
    info.source += (info.source.empty() ? "" : ", ") + path.filename().string();
  }
  validate(info, paths.front().string());
  return std::make_shared<MerlSource>(paths, std::move(info));
}

void write_merl(const std::filesystem::path& path, const BrdfValue& value) {
  AtomicFile file(path);
  file.write(std::as_bytes(std::span(dimensions)));
  std::array<std::vector<double>, 3> channels;
  for (auto& channel : channels) channel.assign(merl_cells, invalid);
  for (std::size_t h = 0; h < merl_theta_h; ++h) {
    check_interrupt();
    for (std::size_t d = 0; d < merl_theta_d; ++d) {
      for (std::size_t p = 0; p < merl_phi_d; ++p) {
        const std::optional<DirectionPair> pair = merl_directions(h, d, p);
        if (!pair) continue;
        const Vector colour = value(*pair);
        const bool valid = std::all_of(colour.begin(), colour.end(),
                                       [](double x) { return std::isfinite(x) && x >= 0; });
        for (std::size_t c = 0; valid && c < 3; ++c) {
          channels[c][p + merl_phi_d * (d + merl_theta_d * h)] = colour[c] / scales[c];
        }
      }
    }
  }
  for (const auto& channel : channels) file.write(std::as_bytes(std::span(channel)));
  file.commit();
}

}  // namespace weft
