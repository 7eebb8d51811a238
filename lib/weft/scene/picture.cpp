#include "weft/scene/picture.hpp"

#include <algorithm>
#include <cmath>
#include <span>

#include "weft/btf/encoding.hpp"
#include "weft/error.hpp"
#include "weft/metrics/ssim.hpp"
#include "weft/reference/tile.hpp"

namespace weft {
namespace {

constexpr double white = 4;

// The factor of the curve on a pixel of that luminance.
double curve_factor(ToneCurve curve, double luminance) {
  if (curve == ToneCurve::linear || !(luminance > 0)) return 1;
  // (1 + L / w^2) / (1 + L), in a form that stays finite with L
  return (1 / luminance + 1 / (white * white)) / (1 / luminance + 1);
}

double display_value(double light) {
  const double shown = encode_from_linear(Encoding::srgb, light);
  return std::isnan(shown) ? 0.0 : std::clamp(shown, 0.0, 1.0);
}

// [height][width][3]
std::vector<double> light_values(const Picture& picture) {
  std::vector<double> values;
  values.reserve(picture.pixels.size() * 3);
  for (const std::array<float, 4>& pixel : picture.pixels) {
    values.insert(values.end(), pixel.begin(), pixel.begin() + 3);
  }
  return values;
}

void check_sizes(const Picture& picture, const Picture& original) {
  if (picture.width != original.width || picture.height != original.height) {
    fail_input("pictures of {} x {} and {} x {} pixels can't be compared", picture.width,
               picture.height, original.width, original.height);
  }
}

}  // namespace

ToneCurve tone_curve_from_name(std::string_view name, std::string_view option) {
  if (name == "linear") return ToneCurve::linear;
  if (name == "reinhard") return ToneCurve::reinhard;
  fail_input("{}: '{}' is none of linear, reinhard", option, name);
}

std::vector<double> display_values(const Picture& picture, const ToneMapping& tone) {
  const double factor = std::exp2(tone.exposure);
  std::vector<double> values;
  values.reserve(picture.pixels.size() * 3);
  for (const std::array<float, 4>& pixel : picture.pixels) {
    double light[3];
    for (std::size_t c = 0; c < 3; ++c) light[c] = factor * static_cast<double>(pixel[c]);
    // Rec. 709 primaries
    const double luminance = 0.2126 * light[0] + 0.7152 * light[1] + 0.0722 * light[2];
    const double curve = curve_factor(tone.curve, luminance);
    for (const double channel : light) values.push_back(display_value(curve * channel));
  }
  return values;
}

PictureComparison compare_pictures(const Picture& picture, const Picture& original,
                                   const ToneMapping& tone) {
  check_sizes(picture, original);
  PictureComparison result;
  const std::vector<double> shown = display_values(picture, tone);
  const std::vector<double> wanted = display_values(original, tone);
  result.display = report(reference::error_sums(wanted, shown), 1.0);
  result.display.ssim = ssim(picture.height, picture.width, 3, wanted, shown, 1.0);
  const ErrorSums linear = reference::error_sums(light_values(original), light_values(picture));
  result.linear = report(linear, linear.max_reference > 0 ? linear.max_reference : 1.0);
  return result;
}

std::vector<double> difference_values(const Picture& picture, const Picture& original,
                                      const ToneMapping& tone, double scale) {
  check_sizes(picture, original);
  std::vector<double> values = display_values(picture, tone);
  const std::vector<double> wanted = display_values(original, tone);
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = std::min(1.0, scale * std::abs(values[i] - wanted[i]));
  }
  return values;
}

}  // namespace weft
