#include "weft/codecs/tucker_options.hpp"

#include <algorithm>
#include <cmath>

#include "weft/codecs/rank_options.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

TuckerMethod method_from(std::string_view option, std::string_view text, bool iterates) {
  if (text == "hosvd") return TuckerMethod::hosvd;
  if (text == "sthosvd") return TuckerMethod::sthosvd;
  if (iterates && text == "hooi") return TuckerMethod::hooi;
  fail_input("--{} {}: {} is needed", option, text,
             iterates ? "hosvd, sthosvd or hooi" : "hosvd or sthosvd");
}

// Relative error by rounding core and factors, and products on the way, to float: each by at most a
// few units in the last place of every value, and errors of different tensors add up as squares,
// being orthogonal to what the cut of the ranks leaves.
double rounding_squares(const TuckerRequest& request) {
  double tensors = 1;
  for (std::size_t n = 0; n < request.groups.count(); ++n) tensors += request.cuts(n) ? 1 : 0;
  constexpr double unit = 0x1p-21;
  return tensors * unit * unit;
}

}  // namespace

TuckerOptions tucker_options(const Codec& codec, const Parameters& parameters,
                             const BtfInfo& source, const FitGoal& goal, Storage storage,
                             const Device* on_device) {
  TuckerOptions result;
  TuckerRequest& request = result.request;
  request.groups = ModeGroups(source.shape, value_of(codec, parameters, "merge"));
  request.storage = storage;

  // ranks
  const std::string_view ranks = value_of(codec, parameters, "ranks");
  request.most = named_ranks(request.groups, ranks);
  std::size_t others = 0;
  if (parameters.contains("rank")) {
    others = count_parameter(codec, parameters, "rank", 1);
  } else if (ranks.empty() && !goal) {
    others = 32;
  }
  for (std::size_t n = 0; n < request.most.size(); ++n) {
    const std::size_t size = request.groups.groups()[n].size;
    if (request.most[n] == 0) request.most[n] = others == 0 ? size : std::min(others, size);
  }

  // method
  request.method = method_from("method", value_of(codec, parameters, "method"), true);
  request.start = method_from("start", value_of(codec, parameters, "start"), false);
  request.iterations = count_parameter(codec, parameters, "iterations", 0);

  // goal
  if (goal.kind == FitGoal::Kind::relative) {
    const double wanted = goal.relative * goal.relative;
    const double rounding = rounding_squares(request);
    if (rounding > wanted / 2) {
      fail(ErrorKind::unmet_goal, "--target {}: float factors hold no less than {:.1g}", goal.text,
           std::sqrt(2 * rounding));
    }
    request.relative = std::sqrt(wanted - rounding);
  } else if (goal) {
    request.bytes = goal.bytes;
  }

  // arithmetic: of a float Gram matrix, eigenvalues below about n 2^-24 of the largest are noise
  const std::string_view arithmetic = value_of(codec, parameters, "arithmetic");
  if (arithmetic == "f64") {
    result.gram = Arithmetic::f64;
  } else if (arithmetic != "f32" && !arithmetic.empty()) {
    fail_input("--arithmetic {}: f32 or f64 is needed", arithmetic);
  }
  const bool has_fp64 = on_device != nullptr && on_device->limits().has_fp64;
  if (arithmetic.empty() && has_fp64 && request.relative > 0 && request.relative < 0.01) {
    result.gram = Arithmetic::f64;
  }
  return result;
}

}  // namespace weft
