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

// Relative error by rounding core and factors to what is stored: each by at most half a unit in the
// last place of every value, and errors of different tensors add up as squares, being orthogonal to
// what the cut of the ranks leaves.
double rounding_squares(Storage storage, const TuckerRequest& request) {
  double tensors = 1;
  for (std::size_t n = 0; n < request.groups.count(); ++n) tensors += request.cuts(n) ? 1 : 0;
  // float: of the products on the way as well
  const double unit = storage == Storage::f16 ? 0x1p-11 : 0x1p-21;
  return tensors * unit * unit;
}

}  // namespace

TuckerParameters tucker_options(const Codec& codec, const Parameters& parameters,
                                const BtfInfo& source, Storage storage, const Device* device) {
  TuckerParameters result;
  TuckerRequest& request = result.options.request;
  request.groups = ModeGroups(source.shape, value_of(codec, parameters, "merge"));
  request.storage = storage;
  result.goal = fit_goal(parameters, source);

  // ranks
  const std::string_view ranks = value_of(codec, parameters, "ranks");
  request.most = named_ranks(request.groups, ranks);
  std::size_t others = 0;
  if (parameters.contains("rank")) {
    others = count_parameter(codec, parameters, "rank", 1);
  } else if (ranks.empty() && !result.goal) {
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
  if (result.goal.kind == FitGoal::Kind::relative) {
    request.relative = result.goal.relative;
    const double wanted = request.relative * request.relative;
    if (storage == Storage::f16 && rounding_squares(storage, request) > wanted / 2) {
      request.storage = Storage::f32;
      result.note = fmt::format("stored as f32: f16 does not hold {}", result.goal.text);
    }
    const double rounding = rounding_squares(request.storage, request);
    if (rounding > wanted / 2) {
      fail(ErrorKind::unmet_goal, "--target {}: float factors hold no less than {:.1g}",
           result.goal.text, std::sqrt(2 * rounding));
    }
    request.relative = std::sqrt(wanted - rounding);
  } else if (result.goal) {
    request.bytes = result.goal.bytes;
    if (request.bytes == 0) fail_input("--target {}: no bytes are left", result.goal.text);
  }

  // arithmetic: of a float Gram matrix, eigenvalues below about n 2^-24 of the largest are noise
  const std::string_view arithmetic = value_of(codec, parameters, "arithmetic");
  if (arithmetic == "f64") {
    result.options.gram = Arithmetic::f64;
  } else if (arithmetic != "f32" && !arithmetic.empty()) {
    fail_input("--arithmetic {}: f32 or f64 is needed", arithmetic);
  }
  const bool has_fp64 = device != nullptr && device->limits().has_fp64;
  if (arithmetic.empty() && has_fp64 && request.relative > 0 && request.relative < 0.01) {
    result.options.gram = Arithmetic::f64;
  }
  return result;
}

}  // namespace weft
