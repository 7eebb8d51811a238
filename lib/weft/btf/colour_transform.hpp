// Colour and range transforms: what a codec is given to fit, t, instead of the stored values x of a
// texel. They act on values as they are stored (8-bit data: [0, 1]), whatever their encoding.
//
//   none          t[c] = x[c]
//   log           t[c] = sgn(x[c]) ln(1 + |x[c]| / s)
//   ycrcb         Y = 0.299 R + 0.587 G + 0.114 B, Cr = (R - Y) / 1.402, Cb = (B - Y) / 1.772
//                 (ITU-R BT.601-7, section 2.5, without offsets)
//   logluv        L = ln(1 + Y / s), u' - u'_n, v' - v'_n
//                 with u' = 4 X / (X + 15 Y + 3 Z), v' = 9 Y / (X + 15 Y + 3 Z) (Ward Larson, "The
//                 LogLuv Encoding for Full Gamut, High Dynamic Range Images", JGT 3(1), 1998), real
//                 instead of rounded to 32 bits; X, Y, Z of linear RGB with the primaries and white
//                 point of ITU-R BT.709
//   decorrelated  t = Q x, the rows of Q the principal axes of the channels' covariance
//
// All of them give 0 for black. The paper's log2 Y has no value there: L is linear below s and
// turns into a logarithm above; black has the chromaticity of white, u'_n, v'_n.
//
// Channel weights w are budgets: a codec fits w[c] t[c], so that an error in a channel of weight 2
// counts twice. Decoding divides by them and inverts:
//
//   log     x = sgn(t) s (exp(min(|t|, t_max)) - 1),  t_max = ln(1 + largest / s)
//   logluv  Y from L in [0, t_max] alike; u', v' within the box round the triangle of the
//   primaries,
//           which all colours that were fitted lie in; R, G, B at least 0
//
// so that what a fit overshoots stays finite: no decoded magnitude (no luminance) exceeds the
// largest of the data.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace weft {

struct ColourTransform {
  enum class Kind : std::uint8_t { none, log, ycrcb, logluv, decorrelated };

  Kind kind = Kind::none;
  double scale = 1;             // s of log and logluv
  double largest = 0;           // largest magnitude of the data (log) or luminance (logluv)
  std::vector<double> axes;     // Q [C, C] of decorrelated
  std::vector<double> weights;  // w [C]; empty: all are 1

  bool operator==(const ColourTransform&) const = default;

  // Nothing is changed.
  bool is_identity() const { return kind == Kind::none && weights.empty(); }
  // Averages of t decode to averages of x.
  bool is_linear() const { return kind != Kind::log && kind != Kind::logluv; }
  // A channel of x takes more than its own of t.
  bool mixes_channels() const { return kind != Kind::none && kind != Kind::log; }

  // t of one texel x, in place; C values.
  void apply(std::span<double> texel) const;
  // The inverse.
  void invert(std::span<double> texel) const;
  // The same for a run of texels.
  void invert_all(std::size_t channels, std::span<double> texels) const;

  // The part that channels of x take, where they are not mixed.
  ColourTransform select(std::span<const std::size_t> channels) const;
};

// "none" "log" "ycrcb" "logluv" "decorrelated".
std::string_view name_of(ColourTransform::Kind kind);
// The inverse; throws an input error that names `where` and the value.
ColourTransform::Kind colour_transform_from_name(std::string_view name, std::string_view where);

// Throws an input error that names `where` unless data of that many channels can be transformed so:
// ycrcb and logluv take three; scale, largest and weights are positive and finite (largest may be
// 0), largest / scale is at most 2^100; axes are C x C and orthonormal.
void validate(const ColourTransform& transform, std::size_t channels, std::string_view where);

// As text of a model's metadata: "none", or a JSON object whose numbers read back exactly.
std::string to_text(const ColourTransform& transform);
// The inverse: validated, and strict about what the object holds.
ColourTransform colour_transform_from_text(std::string_view text, std::size_t channels,
                                           std::string_view where);

// x = D t of a linear transform: D [C, C], row after row.
std::vector<double> inverse_matrix(const ColourTransform& transform, std::size_t channels);

// logluv decodes channel c as Y (k0 + (k1 u' + k2) / v') with a row (k0, k1, k2) for each c, and
// u', v' within [low, high].
struct LuvDecoding {
  std::array<std::array<double, 3>, 3> rows;
  double white_u, white_v;
  double low_u, high_u, low_v, high_v;
};
LuvDecoding luv_decoding();

// The clamp of log and logluv: ln(1 + largest / s).
double largest_log(const ColourTransform& transform);

// Bound of the error of a decoded value x, inverted in float, where every t is wrong by at most
// `error`. Values t were rounded to float at least once: |t| 2^-24 <= error.
double inverted_error(const ColourTransform& transform, std::size_t channels, double error);

}  // namespace weft
