// weft verify: decodes a model on the device and by the reference and holds both against each other
// and against the raw BTF.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "btf_report.hpp"
#include "common.hpp"
#include "job_report.hpp"
#include "report.hpp"
#include "selection_options.hpp"
#include "subcommand.hpp"
#include "verify_mask.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/codecs/colour_source.hpp"
#include "weft/codecs/decoded_source.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/codecs/measure_log.hpp"
#include "weft/codecs/occlusion.hpp"
#include "weft/codecs/tucker.hpp"
#include "weft/device/tile_stream.hpp"
#include "weft/error.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/io/weights_file.hpp"
#include "weft/reference/tile.hpp"

namespace weft {
namespace {

struct VerifyOptions {
  std::string model;
  std::string expand;  // modes, "y,x"
  std::string against;
  std::string weights;
  double tolerance = 1;
  std::string nan = "error";
  bool ssim = false;
  bool log_error = false;
  SelectionOptions selection;
  DeviceOptions device;
  OutputOptions report;
};

// Weights to measure with, of the part of the raw BTF that is compared: those given, or those that
// the model was fitted with where that takes no files.
struct Weighing {
  Weights weights;
  bool fitted = false;  // whether the model was fitted with them
};

std::optional<Weighing> weighing(const VerifyOptions& options, const Model& model,
                                 const ModelSelection& selection) {
  const std::string where = options.model + ": metadata \"weights\"";
  std::string text = options.weights;
  if (text.empty() && !model.info.weights.empty()) {
    text = given_weights(model.info.weights, where);
    if (text.find('=') != std::string::npos) text.clear();
  }
  if (text.empty()) return {};
  const BtfInfo whole = open_raw_btf(options.against)->info();
  Weighing result{select(read_weights(text, whole), whole, selection.whole)};
  result.fitted = selection.part.selects_all() && !model.info.weights.empty() &&
                  are_given(result.weights, model.info.weights, where);
  return result;
}

// |device - reference| over all values, and the reference's errors against the raw BTF, if there is
// one: the reference decodes slowly, and so only once.
struct Difference {
  double largest = 0;
  double squares = 0;
  std::size_t count = 0;
  ErrorSums reference_errors;
  LogErrorSums reference_log_errors;

  double rms() const { return std::sqrt(squares / static_cast<double>(count)); }
};

Difference compare(Device& device, const Codec& codec, const Model& model, TileSource* raw,
                   SimilarityRequest* similarity, WeightedErrors* weighted,
                   std::optional<double> log_scale, Job& job) {
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t run = image_granule(shape);
  const std::size_t values = run * shape.image_values();
  const auto decoder = codec.decoder(device, model);
  const auto reference_decoder = codec.reference_decoder(model);
  Buffer decoded(device, values * sizeof(float), "decoded images");
  std::vector<float> on_device(values);
  std::vector<double> by_reference(values);
  std::vector<double> original(raw ? values : 0);
  Difference difference;
  const StageTimer timer(job, "device against reference");
  for (std::size_t first = 0; first < shape.images(); first += run) {
    check_interrupt();
    const std::size_t count = std::min(run, shape.images() - first);
    const std::size_t size = count * shape.image_values();
    decoder->decode(first, count, decoded);
    device.flush();
    reference_decoder->decode(first, count, std::span(by_reference).first(size));
    device.read(decoded, std::span(on_device).first(size));
    for (std::size_t i = 0; i < size; ++i) {
      const double d = std::abs(static_cast<double>(on_device[i]) - by_reference[i]);
      // A NaN is kept: none is greater.
      if (std::isnan(d) || d > difference.largest) difference.largest = d;
      difference.squares += d * d;
    }
    difference.count += size;
    if (raw) {
      const std::span<double> tile = std::span(original).first(size);
      reference::read_tile(*raw, first, count, job.nan_zero, tile);
      difference.reference_errors.merge(
          reference::error_sums(tile, std::span(by_reference).first(size)));
      if (similarity) add_similarities(shape, count, tile, by_reference, *similarity);
      if (weighted) add_weighted_errors(shape, first, count, tile, by_reference, *weighted);
      if (log_scale) {
        difference.reference_log_errors.merge(
            reference::log_error_sums(tile, std::span(by_reference).first(size), *log_scale));
      }
    }
    job.advance("device against reference", first + count, shape.images());
  }
  return difference;
}

struct LevelErrors {
  ErrorSums sums;
  LogErrorSums log_sums;
};

// Errors of decoded images whose mip level is that of `raw`.
LevelErrors level_errors(TileSource& decoded, TileSource& raw, SimilarityRequest* similarity,
                         WeightedErrors* weighted, std::optional<double> log_scale, Job& job) {
  const BtfShape& shape = raw.info().shape;
  std::vector<double> wanted(shape.image_values());
  std::vector<double> found(shape.image_values());
  LevelErrors errors;
  const StageTimer timer(job, "errors of the mip level");
  for (std::size_t image = 0; image < shape.images(); ++image) {
    check_interrupt();
    reference::read_tile(raw, image, 1, job.nan_zero, wanted);
    reference::read_tile(decoded, image, 1, false, found);
    errors.sums.merge(reference::error_sums(wanted, found));
    if (similarity) add_similarities(shape, 1, wanted, found, *similarity);
    if (weighted) add_weighted_errors(shape, image, 1, wanted, found, *weighted);
    if (log_scale) errors.log_sums.merge(reference::log_error_sums(wanted, found, *log_scale));
  }
  return errors;
}

std::vector<Cell> error_row(std::string_view name, const ErrorReport& errors, bool ssim) {
  std::vector<Cell> row{
      text_cell(name),         number_cell(errors.rmse),     number_cell(errors.psnr),
      number_cell(errors.snr), number_cell(errors.relative), number_cell(errors.max_error)};
  if (ssim) row.push_back(errors.ssim ? number_cell(*errors.ssim) : Cell{"-", "null", true});
  return row;
}

std::vector<Cell> weighted_row(std::string_view name, const WeightedErrorReport& errors) {
  return {text_cell(name), number_cell(errors.rmse), number_cell(errors.psnr),
          number_cell(errors.snr), number_cell(errors.relative)};
}

// The scale of log errors: as recorded, or by the data; none where they are not asked for.
std::optional<double> log_scale_of(const VerifyOptions& options,
                                   const std::optional<ErrorReport>& recorded, const Model& model,
                                   TileSource& raw, Job& job) {
  if (recorded && recorded->log) return recorded->log->scale;
  if (!model.info.colour_transform.is_linear()) return model.info.colour_transform.scale;
  if (options.log_error) return mean_magnitude(raw, job);
  return std::nullopt;
}

std::vector<Cell> log_row(std::string_view name, const LogErrorReport& errors) {
  return {text_cell(name), number_cell(errors.rmse), number_cell(errors.snr)};
}

void run_verify(const VerifyOptions& options) {
  if (!std::isfinite(options.tolerance)) {
    fail_input("--tolerance {}: not a number", options.tolerance);
  }
  if (options.device.reference()) {
    fail_input("--device reference: the check needs a device to compare the reference with");
  }
  std::shared_ptr<const Model> model = expand_modes(read_model(options.model), options.expand);
  const Codec& codec = find_codec(model->info.codec);
  const ModelSelection selection = make_selection(options.selection, model->info, options.model);
  const bool whole = selection.part.selects_all();
  const std::optional<ErrorReport> recorded = model->info.errors;
  // Mip levels that the model does not hold are averages of decoded images: of what both decode,
  // that is.
  Selection stored = selection.part;
  stored.level = 0;
  Selection level;
  level.level = selection.part.level;
  if (!stored.selects_all()) model = codec.select(*model, stored);
  model = at_held_level(model, level.level);
  const bool averaged = level.level > 0;
  const BtfShape shape = select(model->info.btf, level).shape;
  std::shared_ptr<TileSource> raw;
  if (options.log_error && options.against.empty()) {
    fail_input("--log-error: errors against what? --against names the raw BTF");
  }
  if (options.ssim) {
    if (options.against.empty()) fail_input("--ssim: similar to what? --against names the raw BTF");
    check_ssim(shape.height, shape.width, 1.0);
  }
  if (!options.against.empty()) {
    raw = part_of_original(open_raw_btf(options.against), "--against " + options.against,
                           selection.whole, shape, options.nan == "zero");
  } else if (averaged) {
    fail_input("--level: compared with what? --against names the raw BTF");
  }
  if (!options.weights.empty() && options.against.empty()) {
    fail_input("--weights {}: of what? --against names the raw BTF", options.weights);
  }
  std::optional<Weighing> weights;
  if (raw) weights = weighing(options, *model, selection);
  std::unique_ptr<Device> device = open_device(options.device, options.report);

  ReportedJob reported(options.device, options.report);
  Job& job = reported.job();
  job.nan_zero = options.nan == "zero";
  const std::size_t run_values =
      image_granule(model->info.btf.shape) * model->info.btf.shape.image_values();
  MemoryPlan plan;
  plan.add("model on the device", codec.decoder_bytes(*model));
  plan.add("decoded images", run_values * (2 * sizeof(float) + 3 * sizeof(double)));
  if (model->info.occlusion) plan.add("mask", 2 * decoded_mask_bytes(model->info));
  job.plan(plan);

  // the device's errors first: they give the peak
  ErrorReport device_errors;
  std::optional<double> log_scale;
  SimilarityRequest similarity;
  const Weights none;
  WeightedErrors weighted{weights ? weights->weights : none, {}};
  WeightedErrors weighted_reference{weighted.weights, {}};
  if (raw) {
    if (recorded) similarity.peak = recorded->peak;
    SimilarityRequest* const similar = options.ssim ? &similarity : nullptr;
    WeightedErrors* const weighted_sums = weights ? &weighted : nullptr;
    log_scale = log_scale_of(options, recorded, *model, *raw, job);
    LogErrorRequest log{log_scale.value_or(1), {}};
    ErrorSums sums;
    if (averaged) {
      const auto decoded = select(decoded_source(device.get(), model), level);
      if (similar && similarity.peak == 0) {
        const LevelErrors first = level_errors(*decoded, *raw, nullptr, nullptr, {}, job);
        similarity.peak = psnr_peak(raw->info(), first.sums);
      }
      const LevelErrors found =
          level_errors(*decoded, *raw, similar, weighted_sums, log_scale, job);
      sums = found.sums;
      log.sums = found.log_sums;
    } else {
      sums = measure_errors(*device, *codec.decoder(*device, *model), *raw, job, similar,
                            weighted_sums);
      if (log_scale) measure_log_errors(device.get(), *model, *raw, log, job);
    }
    device_errors = weft::report(sums, recorded ? recorded->peak : psnr_peak(raw->info(), sums));
    if (options.ssim) device_errors.ssim = similarity.sums.mean();
    if (log_scale) device_errors.log = weft::report(log.sums, log.scale);
  }
  SimilarityRequest by_reference{similarity.peak, {}};
  const double unit = codec.decode_tolerance(*model);
  SimilarityRequest* const similar_reference = options.ssim ? &by_reference : nullptr;
  WeightedErrors* const weighed_reference = weights ? &weighted_reference : nullptr;
  Difference difference;
  if (averaged) {
    difference = compare(*device, codec, *model, nullptr, nullptr, nullptr, {}, job);
    const LevelErrors found = level_errors(*select(decoded_source(nullptr, model), level), *raw,
                                           similar_reference, weighed_reference, log_scale, job);
    difference.reference_errors = found.sums;
    difference.reference_log_errors = found.log_sums;
  } else {
    difference = compare(*device, codec, *model, raw.get(), similar_reference, weighed_reference,
                         log_scale, job);
  }
  const bool agree = difference.largest <= options.tolerance * unit;

  Report report;
  report.add("model", options.model);
  report.add("codec", codec.name());
  report.add("selection", selection_cell(selection.whole));
  report.add("device", device_name(device));
  report.add("values", difference.count);
  Report& check = report.section("device_against_reference");
  check.add("largest_difference", difference.largest);
  check.add("rms_difference", difference.rms());
  check.add("tolerance", unit);
  check.add("largest_in_tolerances", unit > 0 ? difference.largest / unit : 0.0);
  check.add("rms_in_tolerances", unit > 0 ? difference.rms() / unit : 0.0);
  check.add("allowed_tolerances", options.tolerance);
  check.add("agree", agree);
  const BtfInfo* const raw_info = raw ? &raw->info() : nullptr;
  const MaskCheck mask =
      verify_mask(*device, *model, level, raw_info, whole, options.tolerance, report, job);

  bool as_recorded = true;
  if (raw) {
    ErrorReport reference_errors = weft::report(difference.reference_errors, device_errors.peak);
    if (options.ssim) reference_errors.ssim = by_reference.sums.mean();
    std::vector<std::vector<Cell>> rows{error_row("device", device_errors, options.ssim),
                                        error_row("reference", reference_errors, options.ssim)};
    const char* const record =
        whole ? "recorded in the model" : "recorded of all that the model holds";
    if (recorded) {
      rows.push_back(error_row(record, *recorded, options.ssim));
      // The same sums on another device differ by rounding alone.
      as_recorded =
          !whole || std::abs(device_errors.rmse - recorded->rmse) <= 1e-3 * recorded->rmse + unit;
    }
    report.add("against", options.against);
    report.add("psnr_peak", device_errors.peak);
    std::vector<std::string> columns{"decoded_by", "rmse", "psnr", "snr", "relative", "max_error"};
    if (options.ssim) columns.emplace_back("ssim");
    report.table("errors", std::move(columns), std::move(rows));
    if (weights) {
      const double peak = device_errors.peak;
      const WeightedErrorReport on_device = weighted_report(weighted.sums, peak);
      std::vector<std::vector<Cell>> weighted_rows{
          weighted_row("device", on_device),
          weighted_row("reference", weighted_report(weighted_reference.sums, peak))};
      if (weights->fitted && recorded && recorded->weighted) {
        const WeightedErrorReport& fitted = *recorded->weighted;
        weighted_rows.push_back(weighted_row(record, fitted));
        as_recorded =
            as_recorded && std::abs(on_device.rmse - fitted.rmse) <= 1e-3 * fitted.rmse + unit;
      }
      report.table("weighted_errors", {"decoded_by", "rmse", "psnr", "snr", "relative"},
                   std::move(weighted_rows));
    } else if (!model->info.weights.empty()) {
      job.notes.emplace_back("weighted errors are not measured: --weights gives no files");
    }
    if (log_scale) {
      std::vector<std::vector<Cell>> log_rows{
          log_row("device", *device_errors.log),
          log_row("reference", weft::report(difference.reference_log_errors, *log_scale))};
      if (recorded && recorded->log) log_rows.push_back(log_row(record, *recorded->log));
      report.add("log_scale", *log_scale);
      report.table("log_errors", {"decoded_by", "log_rmse", "log_snr"}, std::move(log_rows));
    }
    as_recorded = as_recorded && mask.as_recorded;
    if (whole) report.add("as_recorded", as_recorded);
  }
  reported.finish_progress();
  reported.add_fields(report);
  add_device_fields(report, device);
  report.print(options.report);

  if (!mask.agree) {
    fail(ErrorKind::unmet_goal,
         "{}: device and reference differ in what the model of the mask decodes to", options.model);
  }
  if (!agree) {
    fail(ErrorKind::unmet_goal,
         "device and reference differ by {:.4g}, {:.4g} times the tolerance of {:.4g}; allowed are "
         "{}",
         difference.largest, difference.largest / unit, unit, options.tolerance);
  }
  if (!as_recorded) {
    fail(ErrorKind::unmet_goal,
         "{} is not what {} was fitted to: its errors differ from the recorded", options.against,
         options.model);
  }
}

}  // namespace

void add_verify(CLI::App& program, Action& action) {
  auto options = std::make_shared<VerifyOptions>();
  CLI::App* command = program.add_subcommand(
      "verify", "Check a model: device against reference, and both against the raw BTF");
  command->add_option("MODEL", options->model, "Model: .weft")->required()->type_name("");
  command
      ->add_option(
          "--expand", options->expand,
          "Modes of a tucker or kcta model, as y,x, whose factors are multiplied into its cores "
          "before both decode it")
      ->type_name("MODES");
  command
      ->add_option("--against", options->against,
                   "Raw BTF that the model was made of; the model's selection of it is taken")
      ->type_name("FILE");
  command
      ->add_option(
          "--weights", options->weights,
          "Measure errors with weights too, as compress takes them; a model fitted with cos "
          "needs no telling")
      ->type_name("WEIGHTS");
  command
      ->add_option("--tolerance", options->tolerance,
                   "Largest difference allowed, in units of the derived rounding bound")
      ->check(CLI::Range(1e-6, 1e6))
      ->type_name("NUMBER");
  command
      ->add_option("--nan", options->nan,
                   "NaN and infinite values in the raw BTF: error, or zero to read them as 0")
      ->check(CLI::IsMember({"error", "zero"}))
      ->type_name("CHOICE");
  command->add_flag("--ssim", options->ssim,
                    "With --against: the structural similarity too, mean over images");
  command->add_flag(
      "--log-error", options->log_error,
      "With --against: the errors of ln(1 + |x| / s) too, s the mean magnitude; always "
      "of models with --transform log or logluv");
  add_selection_options(*command, options->selection);
  add_device_options(*command, options->device);
  add_output_options(*command, options->report);
  command->footer(
      "Views, lights, channels, texels and levels count in the raw BTF, also where the model holds "
      "only\n"
      "a part of it. The tolerance is the worst that float rounding can do in the codec's "
      "decoding\n"
      "formula, from the number of terms and the magnitudes in the model. Exit status 1 beyond "
      "it.\n"
      "\n"
      "Examples:\n"
      "  weft verify cloth.weft\n"
      "  weft verify cloth.weft --against cloth.safetensors --json\n"
      "  weft verify cloth.weft --against cloth.safetensors --views 'theta>60' --region "
      "center:32x32");
  command->callback([options, &action] { action = [options] { run_verify(*options); }; });
}

}  // namespace weft
