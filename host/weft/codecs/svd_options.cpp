#include "weft/codecs/svd_options.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <string>

#include "weft/error.hpp"

namespace weft {
namespace {

constexpr std::size_t default_rank = 64;

std::string_view given(const Parameters& parameters, std::string_view name) {
  const auto found = parameters.find(name);
  return found == parameters.end() ? std::string_view{} : std::string_view(found->second);
}

// A number in (0, 1); 0 where none is given.
double fraction(const Parameters& parameters, std::string_view name) {
  if (!parameters.contains(name)) return 0;
  const std::string_view text = given(parameters, name);
  double value = 0;
  const char* end = text.data() + text.size();
  const auto [stop, status] = std::from_chars(text.data(), end, value);
  if (status != std::errc() || stop != end || !(value > 0 && value < 1)) {
    fail_input("--{} {}: a number between 0 and 1 is needed", name, text);
  }
  return value;
}

}  // namespace

std::string_view name_of(Arithmetic arithmetic) {
  return arithmetic == Arithmetic::f32 ? "f32" : "f64";
}

double mean_noise(Arithmetic arithmetic) {
  return arithmetic == Arithmetic::f32 ? 0x1p-24 : 0x1p-53;
}

SvdOptions svd_options(const Codec& codec, const Parameters& parameters) {
  SvdOptions options;
  if (parameters.contains("svd")) {
    const std::string_view text = given(parameters, "svd");
    bool known = false;
    for (const SvdMethod method :
         {SvdMethod::automatic, SvdMethod::gram, SvdMethod::randomized, SvdMethod::qr}) {
      if (name_of(method) != text) continue;
      options.method = method;
      known = true;
    }
    if (!known) fail_input("--svd {}: one of auto, gram, randomized, qr is needed", text);
  }
  if (parameters.contains("arithmetic")) {
    const std::string_view text = given(parameters, "arithmetic");
    if (text != "f32" && text != "f64") fail_input("--arithmetic {}: f32 or f64 is needed", text);
    options.arithmetic = text == "f64" ? Arithmetic::f64 : Arithmetic::f32;
  }
  options.tolerance = fraction(parameters, "tolerance");
  options.energy = fraction(parameters, "energy");
  if (parameters.contains("rank")) {
    options.rank = count_parameter(codec, parameters, "rank", 1);
  } else if (!options.has_goal()) {
    options.rank = default_rank;
  }
  return options;
}

SvdOptions nested_svd_options(const Codec& codec, const Parameters& parameters,
                              const NestedRequest& request, std::size_t values, std::size_t bases) {
  SvdOptions options = svd_options(codec, parameters);
  for (const std::string_view name : {"tolerance", "energy"}) {
    if (parameters.contains(name)) {
      fail_input("--{} {}: --target chooses the rank", name, given(parameters, name));
    }
  }
  if (parameters.contains("rank")) return options;
  if (request.relative > 0) {
    constexpr double loosest = 0.999;
    options.rank = 0;
    options.tolerance = std::min(request.relative, loosest);
    return options;
  }
  // one more, so that the smallest that is too large is among them, and some for bases that take
  // more than others
  const double components =
      request.growth * static_cast<double>(request.values) / static_cast<double>(values * bases);
  options.rank = 1 + static_cast<std::size_t>(bases > 1 ? 1.5 * components : components);
  return options;
}

std::string rank_bound(const SvdOptions& options, const Parameters& parameters, std::size_t rank,
                       std::size_t most) {
  if (rank == most || (!options.has_goal() && rank < options.rank)) {
    return "the data holds no more components";
  }
  if (parameters.contains("rank")) return fmt::format("--rank {}", given(parameters, "rank"));
  return {};
}

reference::SvdRequest reference_request(const SvdOptions& options) {
  reference::SvdRequest request;
  request.method = options.method;
  request.rank = options.rank;
  request.tolerance = options.tolerance;
  request.energy = options.energy;
  request.mean_noise = mean_noise(options.arithmetic);
  return request;
}

std::string svd_parameters_json(const SvdOptions& options, SvdMethod chosen, std::size_t passes,
                                std::string_view reason) {
  std::string json;
  if (options.rank > 0) json += fmt::format(R"("rank":{},)", options.rank);
  if (options.tolerance > 0) json += fmt::format(R"("tolerance":{},)", options.tolerance);
  if (options.energy > 0) json += fmt::format(R"("energy":{},)", options.energy);
  return json + fmt::format(R"("svd":"{}","arithmetic":"{}","passes":{},"reason":"{}")",
                            name_of(chosen), name_of(options.arithmetic), passes, reason);
}

}  // namespace weft
