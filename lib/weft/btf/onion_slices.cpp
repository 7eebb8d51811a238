#include "weft/btf/onion_slices.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include "weft/error.hpp"

namespace weft {
namespace {

using Vector = OnionSlices::Vector;

constexpr double degree = std::numbers::pi / 180.0;
constexpr std::size_t most_directions = std::size_t{1} << 24;

// Of a range of `size` nodes from first to last; its middle where there is one.
double node(double steps, std::size_t size, double first, double last) {
  if (size == 1) return first + (last - first) / 2;
  return first + (last - first) * (steps / static_cast<double>(size - 1));
}

double steps_of(double value, std::size_t size, double first, double last) {
  const double most = static_cast<double>(size - 1);
  return std::clamp((value - first) / (last - first) * most, 0.0, most);
}

Vector brought_to_horizon(const Vector& direction) {
  const Vector d{direction[0], direction[1], std::max(direction[2], 0.0)};
  const double length = std::hypot(d[0], d[1], d[2]);
  if (!(length > 0)) return {1, 0, 0};  // straight down
  return {d[0] / length, d[1] / length, d[2] / length};
}

Direction rounded(const Vector& d) {
  return {static_cast<float>(d[0]), static_cast<float>(d[1]), static_cast<float>(d[2])};
}

std::size_t checked_product(std::size_t a, std::size_t b) {
  return a > most_directions || b > most_directions ? most_directions + 1 : a * b;
}

}  // namespace

void validate(const OnionSizes& sizes, std::string_view where) {
  const auto [phi, theta, alpha, beta] = sizes;
  if (phi < 1 || theta < 1 || alpha < 1 || beta < 1 ||
      checked_product(phi, theta) > most_directions ||
      checked_product(alpha, beta) > most_directions) {
    fail_input(
        "{}: n_alpha {}, n_beta {}, n_theta {}, n_phi {}: each is at least 1, and there are at "
        "most {} views and as many lights",
        where, alpha, beta, theta, phi, most_directions);
  }
}

OnionSizes parse_onion_sizes(std::string_view text, std::string_view option) {
  OnionSizes sizes;
  const std::array<std::size_t*, 4> fields{&sizes.alpha, &sizes.beta, &sizes.theta, &sizes.phi};
  const char* at = text.data();
  const char* const end = at + text.size();
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const auto [stop, status] = std::from_chars(at, end, *fields[i]);
    const bool last = i + 1 == fields.size();
    if (status != std::errc{} || (last ? stop != end : stop == end || *stop != ',')) {
      fail_input("{}: '{}' is not four sizes n_alpha,n_beta,n_theta,n_phi, as 11,11,7,16", option,
                 text);
    }
    at = last ? stop : stop + 1;
  }
  validate(sizes, option);
  return sizes;
}

OnionSlices::OnionSlices(const OnionSizes& sizes) : sizes_(sizes) {
  validate(sizes, "onion slices");
}

double OnionSlices::phi(std::size_t k) const {
  return 360.0 * static_cast<double>(k) / static_cast<double>(sizes_.phi);
}

double OnionSlices::theta(std::size_t j) const {
  return sizes_.theta == 1 ? 0 : node(static_cast<double>(j), sizes_.theta, 0, 90);
}

double OnionSlices::alpha(std::size_t a) const {
  return node(static_cast<double>(a), sizes_.alpha, -90, 90);
}

double OnionSlices::sine_beta(std::size_t b) const {
  return node(static_cast<double>(b), sizes_.beta, -1, 1);
}

Vector OnionSlices::view(double phi_steps, double theta_steps) const {
  const double phi = 360.0 * phi_steps / static_cast<double>(sizes_.phi) * degree;
  const double theta = (sizes_.theta == 1 ? 0 : node(theta_steps, sizes_.theta, 0, 90)) * degree;
  const double sine = std::sin(theta);
  // the horizon is at z = 0 exactly, not at the rounding of pi / 2
  const double z = theta_steps == static_cast<double>(sizes_.theta - 1) && sizes_.theta > 1
                       ? 0
                       : std::cos(theta);
  return {sine * std::cos(phi), sine * std::sin(phi), z};
}

Vector OnionSlices::turned_light(double alpha_steps, double beta_steps) const {
  const double alpha = node(alpha_steps, sizes_.alpha, -90, 90) * degree;
  const double sine = node(beta_steps, sizes_.beta, -1, 1);
  const double cosine = std::sqrt(std::max(1 - sine * sine, 0.0));
  const bool on_horizon =
      sizes_.alpha > 1 &&
      (alpha_steps == 0 || alpha_steps == static_cast<double>(sizes_.alpha - 1));
  return {std::sin(alpha) * cosine, sine, on_horizon ? 0 : std::cos(alpha) * cosine};
}

Vector OnionSlices::light(double phi_steps, double alpha_steps, double beta_steps) const {
  return turned_by(turned_light(alpha_steps, beta_steps),
                   -360.0 * phi_steps / static_cast<double>(sizes_.phi));
}

std::vector<Direction> OnionSlices::views() const {
  std::vector<Direction> directions;
  directions.reserve(sizes_.views());
  for (std::size_t k = 0; k < sizes_.phi; ++k) {
    for (std::size_t j = 0; j < sizes_.theta; ++j) {
      directions.push_back(rounded(view(static_cast<double>(k), static_cast<double>(j))));
    }
  }
  return directions;
}

std::vector<Direction> OnionSlices::turned_lights() const {
  std::vector<Direction> directions;
  directions.reserve(sizes_.lights());
  for (std::size_t a = 0; a < sizes_.alpha; ++a) {
    for (std::size_t b = 0; b < sizes_.beta; ++b) {
      directions.push_back(rounded(turned_light(static_cast<double>(a), static_cast<double>(b))));
    }
  }
  return directions;
}

std::vector<Direction> OnionSlices::lights(std::size_t k) const {
  std::vector<Direction> directions;
  directions.reserve(sizes_.lights());
  for (std::size_t a = 0; a < sizes_.alpha; ++a) {
    for (std::size_t b = 0; b < sizes_.beta; ++b) {
      directions.push_back(
          rounded(light(static_cast<double>(k), static_cast<double>(a), static_cast<double>(b))));
    }
  }
  return directions;
}

OnionPosition OnionSlices::at(const Vector& view, const Vector& light) const {
  const Vector v = brought_to_horizon(view);
  const double azimuth = v[0] == 0 && v[1] == 0 ? 0 : std::atan2(v[1], v[0]) / degree;
  const double theta = std::atan2(std::hypot(v[0], v[1]), v[2]) / degree;
  const Vector l = turned_by(brought_to_horizon(light), azimuth);
  OnionPosition position;
  if (sizes_.phi > 1) {
    const auto around = static_cast<double>(sizes_.phi);
    const double turns = azimuth / 360.0;
    position.phi = (turns - std::floor(turns)) * around;
    if (position.phi >= around) position.phi = 0;  // a tiny negative angle rounds up
  }
  position.theta = steps_of(theta, sizes_.theta, 0, 90);
  // at a pole of the slices any alpha is right
  const double alpha = l[0] == 0 && l[2] == 0 ? 0 : std::atan2(l[0], l[2]) / degree;
  position.alpha = steps_of(alpha, sizes_.alpha, -90, 90);
  position.beta = steps_of(l[1], sizes_.beta, -1, 1);
  return position;
}

OnionStep OnionSlices::phi_step(double phi_steps) const {
  const auto around = static_cast<double>(sizes_.phi);
  const double within = phi_steps - std::floor(phi_steps / around) * around;
  const double low = std::min(std::floor(within), around - 1);
  const auto first = static_cast<std::size_t>(low);
  return {first, (first + 1) % sizes_.phi, std::clamp(within - low, 0.0, 1.0)};
}

OnionStep OnionSlices::step(double steps, std::size_t size) {
  if (size == 1) return {};
  const double most = static_cast<double>(size - 1);
  const double within = std::clamp(steps, 0.0, most);
  const double low = std::min(std::floor(within), most - 1);
  const auto first = static_cast<std::size_t>(low);
  return {first, first + 1, within - low};
}

Vector turned_by(const Vector& light, double phi) {
  const double c = std::cos(phi * degree), s = std::sin(phi * degree);
  return {c * light[0] + s * light[1], c * light[1] - s * light[0], light[2]};
}

}  // namespace weft
