#include "weft/io/merl.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <string>

#include "io/file_bytes.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/temporary_folder.hpp"

namespace weft::test {
namespace {

using Vector = std::array<double, 3>;

constexpr double pi = std::numbers::pi;
constexpr std::size_t file_bytes = 34992012;

double dot(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

Vector direction(double theta, double phi) {
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

// Blinn's lobe and a diffuse part, another for each channel.
Vector lobe(const Vector& view, const Vector& light) {
  const Vector h{view[0] + light[0], view[1] + light[1], view[2] + light[2]};
  const double s = std::pow(h[2] / std::sqrt(dot(h, h)), 20);
  return {0.2 + s, 0.1 + 2 * s, 0.3 + 0.5 * s};
}

// A file of zeros with the dimensions of the format.
std::string zero_file() {
  std::string bytes(file_bytes, '\0');
  const std::int32_t dimensions[3] = {90, 90, 180};
  std::memcpy(bytes.data(), dimensions, sizeof dimensions);
  return bytes;
}

void put(std::string& bytes, std::size_t channel, std::size_t cell, double value) {
  std::memcpy(bytes.data() + 12 + (channel * merl_cells + cell) * sizeof value, &value,
              sizeof value);
}

// The format's own index of a pair, as its readers compute it.
std::size_t index_of(const Vector& view, const Vector& light) {
  Vector h{view[0] + light[0], view[1] + light[1], view[2] + light[2]};
  const double length = std::sqrt(dot(h, h));
  for (double& x : h) x /= length;
  const double theta_h = std::acos(h[2]), phi_h = std::atan2(h[1], h[0]);
  // turn by -phi_h about the normal, then by -theta_h about y
  const double x = std::cos(phi_h) * light[0] + std::sin(phi_h) * light[1];
  const double y = std::cos(phi_h) * light[1] - std::sin(phi_h) * light[0];
  const Vector d{std::cos(theta_h) * x - std::sin(theta_h) * light[2], y,
                 std::sin(theta_h) * x + std::cos(theta_h) * light[2]};
  double phi_d = std::atan2(d[1], d[0]);
  if (phi_d < 0) phi_d += pi;
  const auto h_index = static_cast<std::size_t>(std::sqrt(theta_h / (pi / 2) * 90 * 90));
  const auto d_index = static_cast<std::size_t>(std::acos(d[2]) / (pi / 2) * 90);
  const auto p_index = static_cast<std::size_t>(phi_d / pi * 180);
  return p_index + 180 * (d_index + 90 * h_index);
}

TEST(Merl, CellsAreThoseOfTheFormat) {
  std::size_t above = 0;
  for (const std::size_t h : {0u, 1u, 30u, 60u, 89u}) {
    for (const std::size_t d : {0u, 1u, 45u, 89u}) {
      for (const std::size_t p : {0u, 1u, 90u, 179u}) {
        const auto pair = merl_directions(h, d, p);
        if (!pair) continue;
        ++above;
        EXPECT_NEAR(std::sqrt(dot(pair->view, pair->view)), 1, 1e-12);
        EXPECT_NEAR(std::sqrt(dot(pair->light, pair->light)), 1, 1e-12);
        EXPECT_EQ(index_of(pair->view, pair->light), p + 180 * (d + 90 * h));
        // the centre; near the zenith an angle is the square of a small number
        const MerlPosition at = merl_position(pair->view, pair->light);
        EXPECT_NEAR(at.theta_h, static_cast<double>(h), 1e-6);
        EXPECT_NEAR(at.theta_d, static_cast<double>(d), 1e-6);
        EXPECT_NEAR(at.phi_d, static_cast<double>(p), 1e-6);
      }
    }
  }
  EXPECT_GT(above, 30u);
  EXPECT_FALSE(merl_directions(89, 89, 0));
}

TEST(Merl, PositionsAreIsotropicAndReciprocal) {
  Random random(3);
  for (int i = 0; i < 500; ++i) {
    const double tv = random.uniform(0.02, 1.5), tl = random.uniform(0.02, 1.5);
    const double pv = random.uniform(0, 6), pl = random.uniform(0, 6), turn = random.uniform(0, 6);
    const MerlPosition one = merl_position(direction(tv, pv), direction(tl, pl));
    const MerlPosition turned = merl_position(direction(tv, pv + turn), direction(tl, pl + turn));
    const MerlPosition swapped = merl_position(direction(tl, pl), direction(tv, pv));
    for (const MerlPosition& other : {turned, swapped}) {
      EXPECT_NEAR(one.theta_h, other.theta_h, 1e-6);
      EXPECT_NEAR(one.theta_d, other.theta_d, 1e-6);
      EXPECT_NEAR(std::remainder(one.phi_d - other.phi_d, 180.0), 0, 1e-5);
    }
  }
  const MerlPosition opposite = merl_position({1, 0, 0}, {-1, 0, 0});
  EXPECT_TRUE(std::isfinite(opposite.theta_h + opposite.theta_d + opposite.phi_d));
}

TEST(Merl, WhatIsWrittenIsRead) {
  const TemporaryFolder folder;
  write_merl(folder / "lobe.binary",
             [](const DirectionPair& pair) { return lobe(pair.view, pair.light); });
  EXPECT_EQ(std::filesystem::file_size(folder / "lobe.binary"), file_bytes);
  EXPECT_EQ(count_files(folder.path()), 1u);
  const MerlFile file(folder / "lobe.binary");
  // Centres to rounding, what lies between within the second differences of the lobe: cells are 1
  // degree and more wide in theta_h, |f''| <= 2 * 20 / rad^2, h^2 / 8 of it per direction.
  const auto pair = merl_directions(20, 30, 77);
  const Vector exact = lobe(pair->view, pair->light);
  const auto at_centre = file.at(merl_position(pair->view, pair->light));
  ASSERT_TRUE(at_centre);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR((*at_centre)[c], exact[c], 1e-6);
  Random random(4);
  for (int i = 0; i < 300; ++i) {
    const Vector view = direction(random.uniform(0, 1.2), random.uniform(0, 6));
    const Vector light = direction(random.uniform(0, 1.2), random.uniform(0, 6));
    const auto found = file.at(merl_position(view, light));
    ASSERT_TRUE(found);
    const Vector expected = lobe(view, light);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR((*found)[c], expected[c], 0.02);
  }
}

TEST(Merl, ChannelsHaveTheirScales) {
  const TemporaryFolder folder;
  std::string bytes = zero_file();
  const auto pair = merl_directions(10, 10, 10);
  const std::size_t cell = index_of(pair->view, pair->light);
  for (std::size_t c = 0; c < 3; ++c) put(bytes, c, cell, 1500);
  write_bytes(folder / "a.binary", bytes);
  const auto found = MerlFile(folder / "a.binary").at({10, 10, 10});
  ASSERT_TRUE(found);
  EXPECT_NEAR((*found)[0], 1, 1e-12);
  EXPECT_NEAR((*found)[1], 1.15, 1e-12);
  EXPECT_NEAR((*found)[2], 1.66, 1e-12);
}

TEST(Merl, InvalidCellsHaveNoPart) {
  const TemporaryFolder folder;
  std::string bytes = zero_file();
  const auto cell = [](std::size_t h, std::size_t d, std::size_t p) {
    return p + 180 * (d + 90 * h);
  };
  for (std::size_t c = 0; c < 3; ++c) {
    put(bytes, c, cell(5, 5, 5), 1500);
    put(bytes, c, cell(5, 5, 6), -1);
    put(bytes, c, cell(20, 20, 20), -1);
    put(bytes, c, cell(30, 30, 30), std::numeric_limits<double>::quiet_NaN());
    put(bytes, c, cell(31, 30, 30), 3000);
  }
  put(bytes, 2, cell(7, 7, 7), -1e-9);  // one channel is enough
  write_bytes(folder / "a.binary", bytes);
  const MerlFile file(folder / "a.binary");
  EXPECT_NEAR((*file.at({5, 5, 5.5}))[0], 1, 1e-12);
  EXPECT_NEAR((*file.at({30.25, 30, 30}))[0], 2, 1e-12);
  EXPECT_FALSE(file.at({20, 20, 20}));
  EXPECT_FALSE(file.at({7, 7, 7}));
  // As a BTF there is 0, and everything is finite.
  const auto source =
      open_merl({folder / "a.binary", folder / "a.binary"}, even_directions(7), even_directions(9));
  EXPECT_EQ(source->info().shape, (BtfShape{7, 9, 1, 2, 3}));
  EXPECT_EQ(source->info().quantity, Quantity::brdf);
  std::vector<float> values(source->info().shape.values());
  source->read(0, 63, std::as_writable_bytes(std::span(values)));
  for (const float value : values) EXPECT_TRUE(std::isfinite(value) && value >= 0);
}

TEST(Merl, OtherFilesAreRefused) {
  const TemporaryFolder folder;
  const auto refused = [&](const std::string& bytes, std::string_view part) {
    write_bytes(folder / "bad.binary", bytes);
    expect_error(ErrorKind::input, {"bad.binary", part},
                 [&] { const MerlFile file(folder / "bad.binary"); });
  };
  const std::string whole = zero_file();
  refused("", "0 bytes");
  refused(whole.substr(0, 11), "11 bytes");
  refused(whole.substr(0, 12), "12 bytes");
  refused(whole.substr(0, file_bytes - 1), "34992011 bytes");
  refused(whole + "x", "34992013 bytes");
  std::string negative = whole.substr(0, 100);
  negative[3] = '\xff';
  refused(negative, "dimensions");
  std::string other = whole.substr(0, 100);
  other[8] = '\x5a';  // 90
  refused(other, "90, 90, 90");
  expect_error(ErrorKind::input, {"absent.binary"},
               [&] { const MerlFile file(folder / "absent.binary"); });
  // A writer that fails leaves nothing.
  std::filesystem::remove(folder / "bad.binary");
  EXPECT_THROW(write_merl(folder / "new.binary",
                          [](const DirectionPair&) -> Vector { fail_runtime("no value"); }),
               Error);
  EXPECT_EQ(count_files(folder.path()), 0u);
}

}  // namespace
}  // namespace weft::test
