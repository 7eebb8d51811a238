// weft compress: fits a model to a raw BTF, measures its errors and writes it.
#include "weft/codecs/compress.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <string>

#include "btf_report.hpp"
#include "common.hpp"
#include "compress_options.hpp"
#include "job_report.hpp"
#include "occlusion_options.hpp"
#include "report.hpp"
#include "selection_options.hpp"
#include "subcommand.hpp"
#include "transform_options.hpp"
#include "weft/codecs/choose_codec.hpp"
#include "weft/codecs/decoded_source.hpp"
#include "weft/codecs/weighted_fit.hpp"
#include "weft/error.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/io/weights_file.hpp"
#include "weft/metrics/ssim.hpp"

namespace weft {
namespace {

void add_goal_fields(Report& report, const Goal& goal, const CompressResult& result) {
  report.add("target", goal.text);
  report.add("reached", result.goal->reached);
  report.add("decompositions", result.goal->decompositions);
  report.add("trials", result.goal->trials);
  report.add("search_time", result.encode_seconds, "s");
  report.add("decomposition_time", result.goal->encode_seconds, "s");
}

Preference preference_of(const CompressOptions& options) {
  for (const Preference known : {Preference::decode, Preference::encode}) {
    if (options.prefer == name_of(known)) return known;
  }
  return Preference::size;
}

// Why a codec was taken.
void add_choice_fields(Report& report, const CodecChoice& choice, Preference preference) {
  report.add("preferred", name_of(preference));
  report.add("tried_on", choice.part);
  std::vector<std::vector<Cell>> rows;
  for (const CodecTrial& trial : choice.trials) {
    rows.push_back({text_cell(trial.codec->name()), flag_cell(trial.met),
                    number_cell(trial.reached), number_cell(trial.snr, "dB"),
                    bytes_cell(static_cast<std::uint64_t>(trial.bytes)),
                    number_cell(trial.encode_seconds, "s"), number_cell(trial.lookups, "/s"),
                    text_cell(trial.outcome)});
  }
  report.table(
      "codecs",
      {"codec", "met", "reached", "snr", "foreseen_size", "foreseen_time", "look_ups", "outcome"},
      std::move(rows));
}

void run_compress(const CompressOptions& options) {
  using Clock = std::chrono::steady_clock;
  if (makes_data_base(options)) {
    run_compress_base(options);
    return;
  }
  // Everything that can be wrong with the request is found before any work.
  if (options.output.empty()) fail_input("--output is required");
  check_model_output(options.output, "--output");
  const std::string& input_file = options.inputs.front();
  if (!std::isfinite(options.peak)) fail_input("--peak {}: not a number", options.peak);
  // null where the goal chooses it
  const Codec* const codec = options.codec == "auto" ? nullptr : &find_codec(options.codec);
  if (codec) {
    check_parameters(*codec, options.parameters);
    if (!options.prefer.empty()) {
      fail_input("--prefer {}: of --codec auto; {} is given", options.prefer, codec->name());
    }
  } else {
    if (options.target.empty()) fail_input("--codec auto: --target is needed to choose by");
    if (!options.parameters.empty()) {
      const auto& [name, value] = *options.parameters.begin();
      fail_input("--{} {}: --codec auto chooses the parameters", name, value);
    }
  }
  const StorageRequest storage = storage_request(options.storage.empty() ? "f16" : options.storage);
  // A tensor train is cut further as it is, and measured against what it decodes to.
  std::unique_ptr<Device> device;
  std::shared_ptr<const Model> given;
  std::shared_ptr<TileSource> input;
  if (codec && codec->name() == "tt" && ModelFile::looks_like(input_file)) {
    given = read_model(input_file);
    const ModelSelection part = make_selection(options.selection, given->info, input_file);
    if (!part.part.selects_all()) given = selected_model(given, part.part, input_file);
    device = open_device(options.device, options.report);
    input = decoded_source(device.get(), given);
  } else {
    input = open_raw_btf(input_file);
  }
  const auto train = std::dynamic_pointer_cast<const TtModel>(given);
  if (given && !train) {
    fail_input(
        "{}: of models, one of codec tt can be cut further, in all channels where its colour "
        "transform mixes them; this is of codec {}",
        input_file, given->info.codec);
  }
  RecordedSelection selection;
  if (!given) selection = make_selection(options.selection, input->info());
  Weights weights;
  if (!options.weights.empty()) {
    if (given) {
      fail_input("--weights {}: a train that is cut further keeps to its own errors",
                 options.weights);
    }
    const Weights whole = read_weights(options.weights, input->info());
    selection = {without_zeros(whole, input->info(), selection), input->info().shape};
    weights = select(whole, input->info(), selection);
    if (codec) {
      check_weights(*codec, options.parameters, select(input->info(), selection).shape, weights);
    }
  }
  const bool nan_zero = options.nan == "zero";
  const std::shared_ptr<TileSource> source = selected_part(input, selection, nan_zero);
  Goal goal;
  if (!options.target.empty()) goal = parse_goal(options.target, source->info());
  if (options.ssim || goal.kind == GoalKind::ssim) {
    check_ssim(source->info().shape.height, source->info().shape.width, 1.0);
  }
  const std::optional<OcclusionRequest> occlusion =
      make_occlusion_request(options.occlusion, source->info());
  if (!given) device = open_device(options.device, options.report);

  ReportedJob reported(options.device, options.report, "");  // stages count what they pass over
  Job& job = reported.job();
  job.seed = options.seed;
  job.nan_zero = nan_zero;
  CompressRequest request;
  request.codec = codec;
  request.parameters = options.parameters;
  request.storage = storage;
  request.selection = to_json(selection);
  request.colour =
      make_colour_request(options.transform, codec ? codec->own_transform(source->info())
                                                   : ColourTransform::Kind::none);
  request.weights = weights;
  if (!options.weights.empty()) request.weights_json = weights_json(options.weights, weights);
  request.peak = options.peak;
  request.ssim = options.ssim;
  request.log_error = options.log_error;
  request.goal = goal;
  request.may_widen = options.storage.empty();
  request.train = train;
  const Clock::time_point start = Clock::now();
  if (given) request.occlusion = given->info.occlusion;
  if (occlusion) {
    request.occlusion = compress_occlusion(device.get(), source->info(), *occlusion, job);
  }
  CodecChoice choice;
  if (!codec) {
    choice = compress_by_best(device.get(), *source, request, preference_of(options), job);
  } else {
    choice.result = compress(device.get(), *source, request, job);
  }
  const CompressResult& result = choice.result;
  const std::unique_ptr<Model>& model = result.model;

  // write
  std::size_t size = 0;
  {
    const StageTimer timer(job, "write", 0, 0);
    size = write_model(options.output, *model);
    job.stage("write").bytes += static_cast<double>(size);
  }
  reported.finish_progress();
  const double seconds = std::chrono::duration<double>(Clock::now() - start).count();

  Report report;
  report.add("input", input_file);
  report.add("output", options.output);
  report.add("codec", model->info.codec);
  report.add("parameters", json_cell(model->info.parameters));
  report.add("storage", storage_text(model->info));
  add_transform_field(report, model->info.colour_transform);
  report.add("selection",
             selection_cell(recorded_from_json(model->info.selection, options.output)));
  if (!model->info.weights.empty()) report.add("weights", json_cell(model->info.weights));
  add_btf_fields(report, model->info);
  report.add("raw_size", bytes_cell(source->info().bytes()));
  report.add("file_size", bytes_cell(size));
  report.add("ratio", static_cast<double>(source->info().bytes()) / static_cast<double>(size));
  add_occlusion_section(report, model->info);
  if (train) report.add("errors_against", input_file);
  Report& errors = report.section("errors");
  add_error_fields(errors, result.errors);
  if (result.errors.weighted) {
    add_weighted_fields(report.section("weighted_errors"), *result.errors.weighted);
  }
  if (result.errors.ssim) errors.add("lowest_ssim", result.lowest_ssim);
  if (result.goal) add_goal_fields(report.section("goal"), goal, result);
  if (!codec) add_choice_fields(report, choice, preference_of(options));
  report.add("device", device_name(device));
  report.add("encode_time", result.encode_seconds, "s");
  report.add("time", seconds, "s");
  report.add("input_rate", static_cast<double>(source->info().bytes()) / seconds / 1e6, "MB/s");
  reported.add_fields(report);
  add_device_fields(report, device);
  report.print(options.report);
}

}  // namespace

void check_model_output(const std::string& output, const char* option) {
  if (output_kind(output) != OutputKind::model) {
    fail_input("{}: '{}' does not end in .weft", option, output);
  }
  const std::filesystem::path folder = std::filesystem::absolute(output).parent_path();
  if (!std::filesystem::is_directory(folder)) {
    fail_input("{}: '{}': there is no folder '{}'", option, output, folder.string());
  }
}

void add_compress(CLI::App& program, Action& action) {
  auto options = std::make_shared<CompressOptions>();
  CLI::App* command = program.add_subcommand("compress", "Compress a raw BTF into a model");
  command
      ->add_option("INPUT", options->inputs,
                   "Raw BTF: .safetensors, or .npy with a .json of directions beside it; several "
                   "with --codec vq, materials of one data base; or "
                   "with --codec tt a model of it, which is cut further")
      ->required()
      ->type_name("");
  command->add_option("-o,--output", options->output, "Model to write: NAME.weft")
      ->type_name("FILE")
      ->default_str("");
  command
      ->add_option("--into", options->into,
                   "Of --codec vq: the data base, or model, to which the inputs are added as "
                   "materials; it is replaced where no --output is given")
      ->type_name("FILE")
      ->default_str("");
  command
      ->add_option("--names", options->names,
                   "Names of the inputs as materials of a data base, as wool,cord; those of the "
                   "files without")
      ->type_name("NAMES")
      ->default_str("");
  std::string names;
  for (const Codec* codec : codecs()) {
    names += fmt::format("{}{} ({})", names.empty() ? "" : "; ", codec->name(), codec->summary());
  }
  names += "; or auto: the best of them for --target and --prefer, tried on a part of the input";
  command->add_option("--codec", options->codec, names)->type_name("NAME");
  for (const Codec* codec : codecs()) {
    for (const ParameterSpec& spec : codec->parameters()) {
      const std::string flag = "--" + std::string(spec.name);
      const std::string help = spec.default_value.empty()
                                   ? std::string(spec.help)
                                   : fmt::format("{} [{}]", spec.help, spec.default_value);
      if (CLI::Option* shared = command->get_option_no_throw(flag)) {
        // what another codec means by it, where that differs
        const std::string known = shared->get_description();
        if (known.find(help) == std::string::npos) {
          shared->description(fmt::format("{}; {}: {}", known, codec->name(), help));
        }
        continue;
      }
      command
          ->add_option_function<std::string>(
              flag,
              [options, name = std::string(spec.name)](const std::string& value) {
                options->parameters[name] = value;
              },
              help)
          ->type_name("VALUE")
          ->group("Codec");
    }
  }
  command->add_option("--target", options->target, std::string(goal_help))->type_name("KIND=VALUE");
  command
      ->add_option("--prefer", options->prefer,
                   "Of --codec auto, what counts among codecs that meet the goal: size (of a goal "
                   "that says it, the errors), decode (random look-ups) or encode (time) [size]")
      ->check(CLI::IsMember({"size", "decode", "encode"}))
      ->type_name("WHAT");
  command
      ->add_option(
          "--storage", options->storage,
          "f16 (half with a power of two per component), f32, q=BITS (4 to 16 bits a value, a "
          "step per component, entropy-coded), or auto (steps by their measured effect on "
          "the error, which stays within 1.01 times that of f16; auto=SLACK: 1 + SLACK); f16 if "
          "nothing is given, or f32 "
          "where f16 does not hold the --target")
      ->type_name("TYPE");
  add_transform_options(*command, options->transform);
  command
      ->add_option("--nan", options->nan,
                   "NaN and infinite values in the input: error, or zero to read them as 0")
      ->check(CLI::IsMember({"error", "zero"}))
      ->type_name("CHOICE");
  add_seed_option(*command, options->seed, "random starts");
  command
      ->add_option("--peak", options->peak,
                   "Peak of the PSNR; 0: 1 for 8-bit data, the largest magnitude for float data")
      ->check(CLI::NonNegativeNumber)
      ->type_name("NUMBER");
  command->add_flag("--ssim", options->ssim,
                    "Measure the structural similarity too, mean over images of 11 x 11 texels or "
                    "more; the peak is the PSNR's");
  command
      ->add_option("--weights", options->weights,
                   "Weights of the squared errors that a fit minimises: cos (a view's projected "
                   "area, and of BRDFs the light's squared cosine) and NPY files "
                   "views=FILE,lights=FILE,texels=FILE, whose product is taken; what has weight "
                   "zero is not selected")
      ->type_name("WEIGHTS");
  command->add_flag(
      "--log-error", options->log_error,
      "Measure the errors of ln(1 + |x| / s) too, s the mean magnitude: relative ones "
      "of what is bright; always under --transform log and logluv");
  add_occlusion_options(*command, options->occlusion);
  add_selection_options(*command, options->selection);
  add_device_options(*command, options->device);
  add_output_options(*command, options->report);
  command->footer(
      "Errors are measured: the model, as stored, is decoded and compared with the input. Equal\n"
      "inputs, options and devices give equal models, whatever --memory is, unless it is what "
      "bounds\n"
      "the components of --tolerance and --energy.\n"
      "\n"
      "Examples:\n"
      "  weft compress cloth.safetensors --codec pca --rank 64 -o cloth.weft\n"
      "  weft compress cloth.safetensors --rank 100 --storage f32 --memory 1GiB -o cloth.weft\n"
      "  weft compress cloth.safetensors --codec lpca --storage auto -o cloth.weft\n"
      "  weft compress cloth.safetensors --weights cos,texels=roi.npy -o cloth.weft\n"
      "  weft compress cloth.safetensors --region 0,0,64x64 --level 1 -o part.weft\n"
      "  weft compress copper.safetensors --transform log --rank 24 -o copper.weft\n"
      "  weft compress cloth.safetensors --views 'theta<=60' --lights 'theta<=60' -o upper.weft\n"
      "  weft compress net.safetensors --occlusion 'tt --target rel=0.1' -o net.weft\n"
      "  weft compress cloth.safetensors --codec view-pca --target psnr=38 -o cloth.weft\n"
      "  weft compress cloth.safetensors --codec auto --target ratio=100 --prefer decode -o "
      "cloth.weft\n"
      "  weft compress cloth.safetensors --codec tt --target rel=0.1 -o train.weft\n"
      "  weft compress train.weft --codec tt --target rel=0.2 -o shorter.weft\n"
      "  weft compress wool.safetensors cord.safetensors --codec vq --levels 4 -o base.weft\n"
      "  weft compress felt.safetensors --codec vq --into base.weft\n"
      "  weft compress knit.npy --device reference --json -o knit.weft");
  command->callback([options, &action] { action = [options] { run_compress(*options); }; });
}

}  // namespace weft
