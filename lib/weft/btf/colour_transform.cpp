#include "weft/btf/colour_transform.hpp"

#include <algorithm>
#include <cmath>

#include "weft/error.hpp"

namespace weft {
namespace {

using Kind = ColourTransform::Kind;
using Matrix3 = std::array<std::array<double, 3>, 3>;

// The largest ratio largest / scale: what the exponential gives in float stays finite by far.
constexpr double largest_range = 0x1p100;
// Half a unit in the last place of a float, relative to the value.
constexpr double unit = 0x1p-24;

// Linear RGB to CIE XYZ, primaries and white point (D65) of ITU-R BT.709, as IEC 61966-2-1 gives
// it.
constexpr Matrix3 xyz_of_rgb{
    {{0.4124, 0.3576, 0.1805}, {0.2126, 0.7152, 0.0722}, {0.0193, 0.1192, 0.9505}}};

constexpr double luma_red = 0.299, luma_green = 0.587, luma_blue = 0.114;
constexpr double red_range = 2 * (1 - luma_red), blue_range = 2 * (1 - luma_blue);

Matrix3 inverse(const Matrix3& m) {
  const auto minor = [&](std::size_t r, std::size_t c) {
    const std::size_t r0 = (r + 1) % 3, r1 = (r + 2) % 3, c0 = (c + 1) % 3, c1 = (c + 2) % 3;
    return m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0];
  };
  const double determinant = m[0][0] * minor(0, 0) + m[0][1] * minor(0, 1) + m[0][2] * minor(0, 2);
  Matrix3 result{};
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) result[r][c] = minor(c, r) / determinant;
  }
  return result;
}

struct Chromaticity {
  double u = 0, v = 0;
};

std::array<double, 3> xyz_of(std::span<const double> rgb) {
  std::array<double, 3> xyz{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t c = 0; c < 3; ++c) xyz[i] += xyz_of_rgb[i][c] * rgb[c];
  }
  return xyz;
}

// X + 15 Y + 3 Z is not zero
Chromaticity chromaticity_of(const std::array<double, 3>& xyz) {
  const double sum = xyz[0] + 15 * xyz[1] + 3 * xyz[2];
  return {4 * xyz[0] / sum, 9 * xyz[1] / sum};
}

double signed_log(double x, double scale) {
  return std::copysign(std::log1p(std::abs(x) / scale), x);
}

double signed_exp(double t, double scale, double limit) {
  return std::copysign(scale * std::expm1(std::min(std::abs(t), limit)), t);
}

// X = 9 u' Y / (4 v') and Z = (12 - 3 u' - 20 v') Y / (4 v').
LuvDecoding make_luv_decoding() {
  const Matrix3 rgb_of_xyz = inverse(xyz_of_rgb);
  LuvDecoding decoding{};
  for (std::size_t c = 0; c < 3; ++c) {
    const auto& m = rgb_of_xyz[c];
    decoding.rows[c] = {m[1] - 5 * m[2], (9 * m[0] - 3 * m[2]) / 4, 3 * m[2]};
  }
  const Chromaticity white = chromaticity_of(xyz_of(std::array<double, 3>{1, 1, 1}));
  decoding.white_u = white.u, decoding.white_v = white.v;
  decoding.low_u = decoding.low_v = 1;
  for (std::size_t c = 0; c < 3; ++c) {
    std::array<double, 3> primary{};
    primary[c] = 1;
    const Chromaticity corner = chromaticity_of(xyz_of(primary));
    decoding.low_u = std::min(decoding.low_u, corner.u);
    decoding.high_u = std::max(decoding.high_u, corner.u);
    decoding.low_v = std::min(decoding.low_v, corner.v);
    decoding.high_v = std::max(decoding.high_v, corner.v);
  }
  return decoding;
}

void apply_luv(std::span<double> texel, double scale) {
  const std::array<double, 3> xyz = xyz_of(texel);
  if (xyz[0] + 15 * xyz[1] + 3 * xyz[2] == 0) {
    std::fill(texel.begin(), texel.end(), 0.0);
    return;
  }
  const LuvDecoding decoding = luv_decoding();
  const Chromaticity colour = chromaticity_of(xyz);
  texel[0] = signed_log(xyz[1], scale);
  texel[1] = colour.u - decoding.white_u;
  texel[2] = colour.v - decoding.white_v;
}

void invert_luv(std::span<double> texel, double scale, double limit, const LuvDecoding& decoding) {
  const double luminance = signed_exp(std::max(texel[0], 0.0), scale, limit);
  const double u = std::clamp(texel[1] + decoding.white_u, decoding.low_u, decoding.high_u);
  const double v = std::clamp(texel[2] + decoding.white_v, decoding.low_v, decoding.high_v);
  for (std::size_t c = 0; c < 3; ++c) {
    const auto& row = decoding.rows[c];
    texel[c] = std::max(luminance * (row[0] + (row[1] * u + row[2]) / v), 0.0);
  }
}

void apply_matrix(std::span<const double> matrix, std::span<double> texel) {
  const std::size_t channels = texel.size();
  std::array<double, 8> few;
  std::vector<double> many(channels > few.size() ? channels : 0);
  const std::span<double> values = many.empty() ? std::span(few).first(channels) : std::span(many);
  std::copy(texel.begin(), texel.end(), values.begin());
  for (std::size_t r = 0; r < channels; ++r) {
    double sum = 0;
    for (std::size_t c = 0; c < channels; ++c) sum += matrix[r * channels + c] * values[c];
    texel[r] = sum;
  }
}

// With all weights 1.
std::vector<double> inverse_of(const ColourTransform& transform, std::size_t channels) {
  std::vector<double> matrix(channels * channels, 0.0);
  if (transform.kind == Kind::ycrcb) {
    // G is what Y leaves to R and B
    return {1,
            red_range,
            0,  //
            1,
            -luma_red * red_range / luma_green,
            -luma_blue * blue_range / luma_green,
            1,
            0,
            blue_range};
  }
  for (std::size_t c = 0; c < channels; ++c) {
    for (std::size_t k = 0; k < channels; ++k) {
      const double identity = c == k ? 1 : 0;
      matrix[c * channels + k] =
          transform.kind == Kind::decorrelated ? transform.axes[k * channels + c] : identity;
    }
  }
  return matrix;
}

void check_scale(const ColourTransform& transform, std::string_view where) {
  const bool fits = transform.scale >= 0x1p-126 && transform.scale <= 0x1p100 &&
                    transform.largest >= 0 && transform.largest <= 0x1p100 &&
                    transform.largest <= largest_range * transform.scale;
  if (!fits) {
    fail_input(
        "{}: scale {} and largest {}: both are at most 2^100, the scale is at least 2^-126 and "
        "2^-100 of the largest",
        where, transform.scale, transform.largest);
  }
}

void check_axes(const ColourTransform& transform, std::size_t channels, std::string_view where) {
  const std::vector<double>& Q = transform.axes;
  if (Q.size() != channels * channels) {
    fail_input("{}: {} numbers of axes instead of {} x {}", where, Q.size(), channels, channels);
  }
  for (std::size_t i = 0; i < channels; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      double product = 0;
      for (std::size_t c = 0; c < channels; ++c)
        product += Q[i * channels + c] * Q[j * channels + c];
      // written so that NaN fails
      if (!(std::abs(product - (i == j ? 1 : 0)) <= 1e-9)) {
        fail_input("{}: axes {} and {} are not orthonormal: their product is {}", where, j, i,
                   product);
      }
    }
  }
}

}  // namespace

void ColourTransform::apply(std::span<double> texel) const {
  switch (kind) {
    case Kind::none:
      break;
    case Kind::log:
      for (double& value : texel) value = signed_log(value, scale);
      break;
    case Kind::ycrcb: {
      const double luma = luma_red * texel[0] + luma_green * texel[1] + luma_blue * texel[2];
      const double red = (texel[0] - luma) / red_range, blue = (texel[2] - luma) / blue_range;
      texel[0] = luma, texel[1] = red, texel[2] = blue;
      break;
    }
    case Kind::logluv:
      apply_luv(texel, scale);
      break;
    case Kind::decorrelated:
      apply_matrix(axes, texel);
      break;
  }
  for (std::size_t c = 0; c < weights.size(); ++c) texel[c] *= weights[c];
}

void ColourTransform::invert(std::span<double> texel) const {
  invert_all(texel.size(), texel);
}

void ColourTransform::invert_all(std::size_t channels, std::span<double> texels) const {
  if (is_identity()) return;
  const std::vector<double> matrix =
      is_linear() ? inverse_of(*this, channels) : std::vector<double>{};
  const LuvDecoding decoding = luv_decoding();
  const double limit = largest_log(*this);
  for (std::size_t first = 0; first < texels.size(); first += channels) {
    const std::span<double> texel = texels.subspan(first, channels);
    for (std::size_t c = 0; c < weights.size(); ++c) texel[c] /= weights[c];
    if (kind == Kind::log) {
      for (double& value : texel) value = signed_exp(value, scale, limit);
    } else if (kind == Kind::logluv) {
      invert_luv(texel, scale, limit, decoding);
    } else if (kind != Kind::none) {
      apply_matrix(matrix, texel);
    }
  }
}

ColourTransform ColourTransform::select(std::span<const std::size_t> channels) const {
  ColourTransform part = *this;
  if (weights.empty()) return part;
  part.weights.clear();
  for (const std::size_t channel : channels) part.weights.push_back(weights[channel]);
  return part;
}

void validate(const ColourTransform& transform, std::size_t channels, std::string_view where) {
  if ((transform.kind == Kind::ycrcb || transform.kind == Kind::logluv) && channels != 3) {
    fail_input("{}: {} takes three channels, R, G and B, not {}", where, name_of(transform.kind),
               channels);
  }
  if (!transform.weights.empty() && transform.weights.size() != channels) {
    fail_input("{}: {} channel weights for {} channels", where, transform.weights.size(), channels);
  }
  for (const double weight : transform.weights) {
    if (!(weight >= 1e-6 && weight <= 1e6)) {
      fail_input("{}: channel weight {} is not from 1e-6 to 1e6", where, weight);
    }
  }
  if (!transform.is_linear()) check_scale(transform, where);
  if (transform.kind == Kind::decorrelated) check_axes(transform, channels, where);
}

std::vector<double> inverse_matrix(const ColourTransform& transform, std::size_t channels) {
  std::vector<double> matrix = inverse_of(transform, channels);
  for (std::size_t c = 0; c < channels; ++c) {
    for (std::size_t k = 0; k < transform.weights.size(); ++k) {
      matrix[c * channels + k] /= transform.weights[k];
    }
  }
  return matrix;
}

LuvDecoding luv_decoding() {
  static const LuvDecoding decoding = make_luv_decoding();
  return decoding;
}

double largest_log(const ColourTransform& transform) {
  return std::log1p(transform.largest / transform.scale);
}

// With e the error of t, |t| u <= e, and every operation in float rounded by u:
//
//   linear  each of the C products has a rounded coefficient, and their sum at most C roundings:
//           R e + (C + 1) R |t| u / (1 - (C + 1) u),  R the largest sum of a row of |D|
//   log     da = (e + 2 |t| u) / w + t_max u  (a product with a rounded 1 / w, and a rounded
//   clamp),
//           dx = (s + largest) da + 8 u largest  (3 ulp of expm1, a rounded s and a product)
//   logluv  Y with dY as of log, u' and v' with du = (e + 2 |t| u) / w + 2 u (they are below 1, the
//           white and the clamp are rounded), and the terms of k0 + (k1 u' + k2) / v' with at most
//           8 roundings in sequence.
double inverted_error(const ColourTransform& transform, std::size_t channels, double error) {
  if (transform.is_identity()) return error;
  const double count = static_cast<double>(channels);
  if (transform.is_linear()) {
    const std::vector<double> matrix = inverse_matrix(transform, channels);
    double largest_row = 0;
    for (std::size_t c = 0; c < channels; ++c) {
      double sum = 0;
      for (std::size_t k = 0; k < channels; ++k) sum += std::abs(matrix[c * channels + k]);
      largest_row = std::max(largest_row, sum);
    }
    const double roundings = (count + 1) / (1 - (count + 1) * unit);
    return largest_row * error * (1 + roundings) + (count + 1) * 0x1p-149;
  }
  const auto weighted = [&](std::size_t c) {
    return 3 * error / (transform.weights.empty() ? 1 : transform.weights[c]);
  };
  const double slope = transform.scale + transform.largest;
  double log_error = weighted(0);
  if (transform.kind == Kind::log) {
    for (std::size_t c = 1; c < channels; ++c) log_error = std::max(log_error, weighted(c));
  }
  log_error += largest_log(transform) * unit;
  // an error of the exponent is one of e^da - 1
  const double magnitude_error =
      slope * std::expm1(log_error) + 8 * unit * transform.largest + 4 * 0x1p-149;
  if (transform.kind == Kind::log) return magnitude_error;

  const LuvDecoding decoding = luv_decoding();
  const double u_error = weighted(1) + 2 * unit, v_error = weighted(2) + 2 * unit;
  const double least_v = decoding.low_v - 2 * unit;
  double largest_error = 0;
  for (const auto& row : decoding.rows) {
    const double terms = std::abs(row[1]) * decoding.high_u + std::abs(row[2]);
    const double factor = std::abs(row[0]) + terms / least_v;
    const double factor_error = std::abs(row[1]) / least_v * u_error +
                                terms / (least_v * least_v) * v_error + 8 * unit * factor;
    largest_error =
        std::max(largest_error,
                 factor * magnitude_error + (transform.largest + magnitude_error) * factor_error);
  }
  return largest_error + 4 * 0x1p-149;
}

}  // namespace weft
