#include "occlusion_options.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <cmath>
#include <string_view>
#include <vector>

#include "tradeoff/grid.hpp"
#include "weft/codecs/compress.hpp"
#include "weft/error.hpp"
#include "weft/model/occlusion_metadata.hpp"

namespace weft {
namespace {

// Its parameters, --storage and --target, as words of a command line.
void take_options(const std::vector<std::string>& words, const std::string& text,
                  OcclusionRequest& request) {
  request.storage = storage_request("f16");
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    const std::size_t equals = word.find('=');
    const std::string name = word.substr(0, equals);
    if (!name.starts_with("--") || name.size() == 2) {
      fail_input("--occlusion '{}': '{}' is no option", text, word);
    }
    std::string value;
    if (equals != std::string::npos) {
      value = word.substr(equals + 1);
    } else if (++i < words.size()) {
      value = words[i];
    } else {
      fail_input("--occlusion '{}': {} is without a value", text, word);
    }
    if (name == "--storage") {
      request.storage = storage_request(value);
    } else if (name == "--target") {
      request.target = value;
    } else {
      request.parameters[name.substr(2)] = value;
    }
  }
}

// A count, or a share of all texels in percent.
std::size_t most_errors(const std::string& text, std::size_t texels) {
  std::string_view digits = text;
  const bool percent = digits.ends_with('%');
  if (percent) digits.remove_suffix(1);
  double value = 0;
  const char* const end = digits.data() + digits.size();
  const auto [stop, status] = std::from_chars(digits.data(), end, value);
  const double most = percent ? 100.0 : static_cast<double>(texels);
  // written so that NaN fails
  if (status != std::errc() || stop != end || !(value >= 0 && value <= most) ||
      (!percent && value != std::floor(value))) {
    fail_input(
        "--occlusion-errors {}: a number of texels up to {} is needed, or a percentage as 0.1%",
        text, texels);
  }
  return static_cast<std::size_t>(percent ? value / 100 * static_cast<double>(texels) : value);
}

}  // namespace

void add_mapping_options(CLI::App& command, MappingOptions& options) {
  command
      .add_option("--occlusion-threshold", options.threshold,
                  "Decoded values of a mask's model from this one on are opaque, those of at most "
                  "0 hidden [0.05 of distances, 0.5 of masks]")
      ->type_name("T");
  command
      .add_option("--occlusion-weight", options.weight,
                  "Values between have this times them as opacity [12 of distances, 1 of masks]")
      ->type_name("W");
}

VisibilityMapping make_mapping(const MappingOptions& options, VisibilityMapping known) {
  if (options.threshold) {
    known.threshold = *options.threshold;
    validate(known, "--occlusion-threshold");
  }
  if (options.weight) {
    known.weight = *options.weight;
    validate(known, "--occlusion-weight");
  }
  return known;
}

void add_occlusion_options(CLI::App& command, OcclusionOptions& options) {
  command
      .add_option("--occlusion", options.model,
                  "How the mask of a material with holes is kept: exact, packed without loss; or a "
                  "codec with its options, --storage and --target, as 'kcta --clusters 8 --ranks "
                  "y=24,x=24', "
                  "a model of its own within the file, which renders with soft edges")
      ->type_name("TEXT");
  command
      .add_option("--occlusion-of", options.of,
                  "What that model is fitted to: distance, the signed distances to the material's "
                  "outline, which keep edges sharp, or mask [distance]")
      ->check(CLI::IsMember({"distance", "mask"}))
      ->type_name("WHAT");
  command
      .add_option("--occlusion-band", options.band,
                  "Distances are clipped to this, of the largest, which helps where holes are "
                  "small and where views have none")
      ->check(CLI::Range(0.005, 1.0))
      ->type_name("SHARE");
  command
      .add_option("--occlusion-errors", options.errors,
                  "Most texels whose decoded visibility may be wrong, as 500, or as 0.1% of all "
                  "views' texels: the relative error is chosen by it, of codecs that take goals")
      ->type_name("COUNT");
  add_mapping_options(command, options.mapping);
}

std::optional<OcclusionRequest> make_occlusion_request(const OcclusionOptions& options,
                                                       const BtfInfo& info) {
  if (options.model == "exact") {
    const auto refuse = [](const char* option) {
      fail_input("{}: of a model of the mask, which --occlusion asks for", option);
    };
    if (!options.of.empty()) refuse("--occlusion-of");
    if (!options.errors.empty()) refuse("--occlusion-errors");
    if (options.mapping.threshold) refuse("--occlusion-threshold");
    if (options.mapping.weight) refuse("--occlusion-weight");
    return std::nullopt;
  }
  if (info.mask.empty()) fail_input("--occlusion '{}': the input has no mask", options.model);
  const TradeoffPoint given = parse_point(options.model, "--occlusion");
  OcclusionRequest request;
  request.codec = &find_codec(given.codec);
  take_options(given.options, options.model, request);
  check_parameters(*request.codec, request.parameters);
  if (options.of == "mask") request.kind = OcclusionKind::mask;
  request.band = options.band;
  request.mapping = make_mapping(options.mapping, default_mapping(request.kind));
  if (!options.errors.empty()) {
    if (!request.target.empty()) {
      fail_input("--occlusion-errors {}: the mask's model has a goal, --target {}", options.errors,
                 request.target);
    }
    request.most_errors = most_errors(options.errors, info.mask.size());
  }
  return request;
}

void add_error_texel_fields(Report& report, const ErrorTexels& errors) {
  report.add("texels", errors.texels);
  report.add("error_texels", errors.wrong);
  report.add("error_texel_share", errors.share());
}

void add_occlusion_section(Report& report, const ModelInfo& info) {
  const Occlusion* const occlusion = info.occlusion.get();
  if (!occlusion) return;
  const ModelInfo& model = occlusion->model->info;
  Report& section = report.section("occlusion");
  section.add("codec", model.codec);
  section.add("parameters", json_cell(model.parameters));
  section.add("storage", storage_text(model));
  section.add("of", name_of(occlusion->kind));
  section.add("threshold", occlusion->mapping.threshold);
  section.add("weight", occlusion->mapping.weight);
  section.add("size", bytes_cell(occlusion_tensor_bytes(*occlusion)));
  add_error_texel_fields(section, occlusion->errors);
}

}  // namespace weft
