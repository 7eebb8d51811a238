#include "weft/scene/environment_map.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <span>

#include "weft/error.hpp"
#include "weft/io/image.hpp"
#include "weft/scene/vector.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

using std::numbers::pi;

// Of radiance: far from where a float no longer holds what a point reflects of it.
constexpr float brightest = 1e20f;

// Relative luminance of linear light with the primaries of Rec. 709.
double luminance(const std::array<float, 3>& color) {
  return 0.2126 * color[0] + 0.7152 * color[1] + 0.0722 * color[2];
}

// z of the upper edge of a row.
double edge_height(std::size_t row, std::size_t rows) {
  return std::cos(pi * static_cast<double>(row) / static_cast<double>(rows));
}

// Where sums[0..n] passes `target`: the step whose lower sum is the last one at most `target` and
// below its upper one; and how far through it.
std::pair<std::size_t, double> invert(std::span<const double> sums, double target) {
  const auto above = std::upper_bound(sums.begin(), sums.end(), target);
  std::size_t step = above == sums.begin() ? 0 : static_cast<std::size_t>(above - sums.begin()) - 1;
  // Rounding may have carried the target to the end: the last step that is not empty has it.
  step = std::min(step, sums.size() - 2);
  while (step > 0 && sums[step + 1] <= sums[step]) --step;
  const double fraction = (target - sums[step]) / (sums[step + 1] - sums[step]);
  return {step, std::clamp(fraction, 0.0, 1.0)};
}

}  // namespace

EnvironmentMap::EnvironmentMap(std::size_t rows, std::size_t columns, std::vector<float> radiance,
                               std::string_view where)
    : rows_(rows), columns_(columns), radiance_(std::move(radiance)) {
  if (rows < 1 || columns < 1 || radiance_.size() / 3 / rows / columns != 1 ||
      radiance_.size() != 3 * rows * columns) {
    fail_input("{}: an environment map of {} x {} texels has {} values", where, columns, rows,
               radiance_.size());
  }
  for (std::size_t i = 0; i < radiance_.size(); ++i) {
    if (!std::isfinite(radiance_[i])) {
      fail_input("{}: texel (row {}, column {}) is {}", where, i / 3 / columns, i / 3 % columns,
                 radiance_[i]);
    }
    if (radiance_[i] > brightest) {
      fail_input("{}: texel (row {}, column {}) is {}, above {}", where, i / 3 / columns,
                 i / 3 % columns, radiance_[i], brightest);
    }
    radiance_[i] = std::max(radiance_[i], 0.0f);
  }
  // Sum up the power of texels, luminance times solid angle: within a row the solid angle is the
  // same.
  row_sums_.assign(rows + 1, 0);
  column_sums_.assign(rows * (columns + 1), 0);
  for (std::size_t row = 0; row < rows; ++row) {
    double* const sums = &column_sums_[row * (columns + 1)];
    for (std::size_t column = 0; column < columns; ++column) {
      sums[column + 1] = sums[column] + luminance(at(row, column));
    }
    const double solid_angle = (edge_height(row, rows) - edge_height(row + 1, rows)) * 2 * pi /
                               static_cast<double>(columns);
    row_sums_[row + 1] = row_sums_[row] + sums[columns] * solid_angle;
  }
}

std::array<float, 3> EnvironmentMap::at(std::size_t row, std::size_t column) const {
  const float* const texel = &radiance_[3 * (row * columns_ + column)];
  return {texel[0], texel[1], texel[2]};
}

EnvironmentMap::Texel EnvironmentMap::texel_of(const Vector3& d) const {
  const double theta = std::atan2(std::hypot(d[0], d[1]), d[2]);
  const double phi = std::atan2(d[1], d[0]);
  const auto cell = [](double position, std::size_t count) {
    return std::min(static_cast<std::size_t>(std::max(position, 0.0) * static_cast<double>(count)),
                    count - 1);
  };
  return {cell(theta / pi, rows_), cell((pi - phi) / (2 * pi), columns_)};
}

std::array<float, 3> EnvironmentMap::radiance(const Vector3& direction) const {
  const Texel texel = texel_of(direction);
  return at(texel.row, texel.column);
}

std::array<float, 3> EnvironmentMap::smooth_radiance(const Vector3& d) const {
  const double theta = std::atan2(std::hypot(d[0], d[1]), d[2]);
  const double phi = std::atan2(d[1], d[0]);
  // Texel centres lie at whole numbers.
  const double y = theta / pi * static_cast<double>(rows_) - 0.5;
  const double x = (pi - phi) / (2 * pi) * static_cast<double>(columns_) - 0.5;
  const double row = std::floor(y), column = std::floor(x);
  const double fy = y - row, fx = x - column;
  std::array<double, 3> result{};
  for (int i = 0; i < 2; ++i) {
    for (int k = 0; k < 2; ++k) {
      const auto r =
          static_cast<std::size_t>(std::clamp(row + i, 0.0, static_cast<double>(rows_ - 1)));
      const auto c =
          static_cast<std::size_t>(column + k + static_cast<double>(columns_)) % columns_;
      const double weight = (i == 0 ? 1 - fy : fy) * (k == 0 ? 1 - fx : fx);
      const std::array<float, 3> texel = at(r, c);
      for (std::size_t channel = 0; channel < 3; ++channel)
        result[channel] += weight * double{texel[channel]};
    }
  }
  return to_float(result);
}

double EnvironmentMap::density(const Vector3& direction) const {
  const double power = row_sums_.back();
  return power > 0 ? luminance(radiance(direction)) / power : 0;
}

EnvironmentSample EnvironmentMap::sample(const std::array<double, 2>& point) const {
  EnvironmentSample result;
  const double power = row_sums_.back();
  if (power <= 0) return result;
  const auto [row, down] = invert(row_sums_, point[0] * power);
  const std::span<const double> sums =
      std::span(column_sums_).subspan(row * (columns_ + 1), columns_ + 1);
  const auto [column, across] = invert(sums, point[1] * sums.back());
  const double top = edge_height(row, rows_), bottom = edge_height(row + 1, rows_);
  const double z = top + (bottom - top) * down;
  const double radius = std::sqrt(std::max(0.0, 1 - z * z));
  const double phi =
      pi - 2 * pi * (static_cast<double>(column) + across) / static_cast<double>(columns_);
  result.direction = {radius * std::cos(phi), radius * std::sin(phi), z};
  result.radiance = at(row, column);
  result.density = luminance(result.radiance) / power;
  return result;
}

EnvironmentMap read_environment_map(const std::filesystem::path& path) {
  const std::string where = path.string();
  const ImageInfo info = image_info(path);
  if (info.channels != 3 || info.dtype == DType::u8) {
    fail_input(
        "{}: an environment map is an EXR or Radiance .hdr image with 3 channels, not {} of {}",
        where, info.channels, name_of(info.dtype));
  }
  std::vector<std::byte> bytes(info.bytes());
  read_image(path, info, bytes);
  std::vector<float> radiance(3 * info.height * info.width);
  if (info.dtype == DType::f32) {
    std::memcpy(radiance.data(), bytes.data(), bytes.size());
  } else {
    for (std::size_t i = 0; i < radiance.size(); ++i) {
      std::uint16_t half = 0;
      std::memcpy(&half, &bytes[2 * i], sizeof half);
      radiance[i] = half_to_float(half);
    }
  }
  return {info.height, info.width, std::move(radiance), where};
}

}  // namespace weft
