// What every PCA-like codec lets its user choose about a truncated SVD.
//
//   A = T - mean, unfolded     A ~ A_k = U_k (U_k^T A)
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include "weft/codecs/codec.hpp"
#include "weft/codecs/nested_models.hpp"
#include "weft/ops/arithmetic.hpp"
#include "weft/reference/truncated_svd.hpp"

namespace weft {

struct SvdOptions {
  SvdMethod method = SvdMethod::automatic;
  Arithmetic arithmetic = Arithmetic::f32;
  std::size_t rank = 0;  // most components; 0: as many as the goals below ask for
  double tolerance = 0;  // wanted |A - A_k| / |T|, the relative error as reported; 0: none
  double energy = 0;     // wanted |A_k|^2 / |A|^2 of the data without its mean; 0: none

  bool has_goal() const { return tolerance > 0 || energy > 0; }
};

// "f32" "f64".
std::string_view name_of(Arithmetic arithmetic);

// Components shorter than this part of the mean's norm are left out. In f32 they are what its own
// rounding leaves; in f64 that is a component like any other, since the mean is kept as a float.
double mean_noise(Arithmetic arithmetic);

// The parameters of a codec on this engine, for its table.
inline constexpr std::array<ParameterSpec, 5> svd_parameters{{
    {"rank", "", "number of components k, 64 unless a goal is given; with a goal, the most"},
    {"svd", "auto", "how: gram, randomized, qr, or auto by goal and shape"},
    {"arithmetic", "f32", "f32, or f64 where the device has it"},
    {"tolerance", "", "goal: relative error of the factors before they are stored, as 1e-3"},
    {"energy", "", "goal: part of the squared norm without the mean to be kept, as 0.99"},
}};

// The options that `parameters` ask for. Throws input errors that name the option and the value.
SvdOptions svd_options(const Codec& codec, const Parameters& parameters);

// A decomposition from which a goal cuts its models: of the given --rank; else until the request's
// error is met, or with as many components of `values` numbers as it may take in `bases` bases.
// Throws input errors for goals beside the one that is to be met.
SvdOptions nested_svd_options(const Codec& codec, const Parameters& parameters,
                              const NestedRequest& request, std::size_t values, std::size_t bases);
// Why there are no more than `rank` components, of `most` that data of this shape can have; empty
// where a further decomposition may have more.
std::string rank_bound(const SvdOptions& options, const Parameters& parameters, std::size_t rank,
                       std::size_t most);

// What they ask of the reference, which computes in double; `arithmetic` as asked of the device.
reference::SvdRequest reference_request(const SvdOptions& options);

// The same as members of a JSON object, with what was chosen and why: "rank":8,"svd":"gram", ...
std::string svd_parameters_json(const SvdOptions& options, SvdMethod chosen, std::size_t passes,
                                std::string_view reason);

}  // namespace weft
