// Rendered pictures, and how they are shown.
//
// A display value s of linear light u is
//
//   s = sRGB(curve(2^exposure u)),   clipped to [0, 1]
//
// with the curves
//
//   linear     x: what is brighter than 1 is clipped
//   reinhard   x L'/L, L' = L (1 + L / w^2) / (1 + L), L the luminance, w = 4 the luminance that is
//              shown as white (Reinhard, Stark, Shirley, Ferwerda: Photographic Tone Reproduction
//              for Digital Images, SIGGRAPH 2002, eq. (4)): highlights keep their shape, middle
//              tones darken
#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

#include "weft/metrics/error_sums.hpp"

namespace weft {

// Linear rgb over the background, and the share of the pixel that shows material; row by row from
// the top.
struct Picture {
  std::size_t width = 0;
  std::size_t height = 0;
  std::vector<std::array<float, 4>> pixels;
};

enum class ToneCurve { linear, reinhard };
// "linear", "reinhard"; throws an input error that names `option`.
ToneCurve tone_curve_from_name(std::string_view name, std::string_view option);

struct ToneMapping {
  double exposure = 0;  // stops
  ToneCurve curve = ToneCurve::linear;
};

// Display values in [0, 1], [height][width][3]; NaN is black.
std::vector<double> display_values(const Picture& picture, const ToneMapping& tone);

// A picture against the one it should be.
struct PictureComparison {
  ErrorReport display;  // of display values: peak 1, with SSIM (L = 1, mean over R, G and B)
  ErrorReport linear;   // of linear light: peak the largest magnitude of the original, no SSIM
};

// Throws an input error if the sizes differ or are below SSIM's window.
PictureComparison compare_pictures(const Picture& picture, const Picture& original,
                                   const ToneMapping& tone);

// scale |s - s'| of the display values, clipped to [0, 1]: what an eye would see, enlarged.
std::vector<double> difference_values(const Picture& picture, const Picture& original,
                                      const ToneMapping& tone, double scale);

}  // namespace weft
