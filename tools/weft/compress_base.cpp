// weft compress of several raw BTFs: materials of one data base, or added to one.
#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

#include "btf_report.hpp"
#include "compress_options.hpp"
#include "job_report.hpp"
#include "weft/codecs/vq.hpp"
#include "weft/codecs/vq_base.hpp"
#include "weft/error.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/metrics/ssim.hpp"
#include "weft/model/storage.hpp"

namespace weft {
namespace {

// What makes sense for one model alone.
void check_options(const CompressOptions& options) {
  if (options.codec != vq_codec().name()) {
    fail_input("--codec {}: several materials share code-books, which models of --codec vq have",
               options.codec);
  }
  const auto refuse = [](const char* option, bool given) {
    if (given) fail_input("{}: not of materials that share code-books", option);
  };
  refuse("--prefer", !options.prefer.empty());
  refuse("--weights", !options.weights.empty());
  refuse("--occlusion", options.occlusion.model != "exact");
  check_parameters(vq_codec(), options.parameters);
  if (options.output.empty() && options.into.empty()) fail_input("--output is required");
  if (!options.into.empty()) check_model_output(options.into, "--into");
  if (!options.output.empty()) check_model_output(options.output, "--output");
  if (!std::isfinite(options.peak)) fail_input("--peak {}: not a number", options.peak);
}

// The names that are given, or those of the files.
std::vector<std::string> names_of(const CompressOptions& options) {
  std::vector<std::string> names;
  if (options.names.empty()) {
    for (const std::string& input : options.inputs) {
      names.push_back(std::filesystem::path(input).stem().string());
    }
    return names;
  }
  for (std::size_t begin = 0; begin != std::string::npos;) {
    const std::size_t end = options.names.find(',', begin);
    names.push_back(options.names.substr(begin, end - begin));
    begin = end == std::string::npos ? end : end + 1;
  }
  if (names.size() != options.inputs.size()) {
    fail_input("--names {}: {} names for {} inputs", options.names, names.size(),
               options.inputs.size());
  }
  return names;
}

// What is fitted: as the options say, else as in the data base, else as the codec does.
ColourRequest colour_of(const CompressOptions& options, const BtfInfo& info,
                        const VqBase* existing) {
  if (existing == nullptr) {
    return make_colour_request(options.transform, vq_codec().own_transform(info));
  }
  const ColourTransform& there = existing->materials.front().index.info.colour_transform;
  ColourRequest request = make_colour_request(options.transform, there.kind);
  if (options.transform.channel_weights.empty()) request.weights = there.weights;
  return request;
}

void add_materials(Report& report, const VqBaseResult& result, const VqBaseBytes& bytes) {
  std::vector<std::vector<Cell>> rows;
  const std::size_t before = result.base.materials.size() - result.measured.size();
  for (std::size_t i = before; i < result.base.materials.size(); ++i) {
    const VqMaterial& material = result.base.materials[i];
    const ErrorReport& errors = result.measured[i - before].errors;
    rows.push_back({text_cell(material.name), bytes_cell(material.index.info.btf.bytes()),
                    bytes_cell(bytes.own[i]), number_cell(errors.rmse),
                    number_cell(errors.psnr, "dB"), number_cell(errors.snr, "dB"),
                    number_cell(errors.max_error)});
    if (errors.ssim) rows.back().push_back(number_cell(*errors.ssim));
  }
  std::vector<std::string> columns{"name", "raw_size", "own_size", "rmse",
                                   "psnr", "snr",      "max_error"};
  if (result.measured.front().errors.ssim) columns.emplace_back("ssim");
  report.table("materials", std::move(columns), std::move(rows));
}

}  // namespace

void run_compress_base(const CompressOptions& options) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  check_options(options);
  const std::vector<std::string> names = names_of(options);
  std::optional<VqBase> existing;
  if (!options.into.empty()) existing = VqBase::read(options.into);
  const VqBase* const there = existing ? &*existing : nullptr;
  const bool nan_zero = options.nan == "zero";

  CompressRequest request;
  request.parameters = options.parameters;
  request.storage = storage_request(options.storage.empty() ? "f16" : options.storage);
  request.may_widen = options.storage.empty();
  request.peak = options.peak;
  request.ssim = options.ssim;
  request.log_error = options.log_error;
  std::vector<MaterialSource> materials;
  std::size_t raw = 0;
  for (std::size_t i = 0; i < options.inputs.size(); ++i) {
    const std::shared_ptr<TileSource> input = open_raw_btf(options.inputs[i]);
    const RecordedSelection selection = make_selection(options.selection, input->info());
    MaterialSource material{
        names[i], selected_part(input, selection, nan_zero), to_json(selection), {}};
    const BtfInfo& info = material.source->info();
    material.colour = colour_of(options, info, there);
    if (!options.target.empty()) request.goal = parse_goal(options.target, info);
    if (options.ssim || request.goal.kind == GoalKind::ssim) {
      check_ssim(info.shape.height, info.shape.width, 1.0);
    }
    raw += info.bytes();
    materials.push_back(std::move(material));
  }
  const std::unique_ptr<Device> device = open_device(options.device, options.report);
  ReportedJob reported(options.device, options.report, "");
  Job& job = reported.job();
  job.seed = options.seed;
  job.nan_zero = nan_zero;
  const VqBaseResult result = compress_vq_base(device.get(), materials, request, there, job);

  const std::string& output = options.output.empty() ? options.into : options.output;
  std::size_t size = 0;
  {
    const StageTimer timer(job, "write", 0, 0);
    size = write_vq_base(output, result.base);
    job.stage("write").bytes += static_cast<double>(size);
  }
  reported.finish_progress();
  const double seconds = std::chrono::duration<double>(Clock::now() - start).count();

  Report report;
  report.add("input", fmt::format("{}", fmt::join(options.inputs, ", ")));
  if (there) report.add("into", options.into);
  report.add("output", output);
  report.add("codec", vq_codec().name());
  report.add("parameters", json_cell(result.base.materials.back().index.info.parameters));
  report.add("storage", storage_text(result.base.books.info));
  if (there) {
    for (const VqMaterial& material : there->materials) raw += material.index.info.btf.bytes();
  }
  const VqBaseBytes bytes = vq_base_bytes(result.base);
  report.add("raw_size", bytes_cell(raw));
  report.add("file_size", bytes_cell(size));
  report.add("shared_size", bytes_cell(bytes.shared));
  report.add("ratio", static_cast<double>(raw) / static_cast<double>(size));
  add_materials(report, result, bytes);
  if (result.goal) {
    Report& goal = report.section("goal");
    goal.add("target", request.goal.text);
    goal.add("reached", result.goal->reached);
    goal.add("fits", result.goal->decompositions);
    goal.add("trials", result.goal->trials);
  }
  report.add("device", device_name(device));
  report.add("encode_time", result.encode_seconds, "s");
  report.add("time", seconds, "s");
  reported.add_fields(report);
  add_device_fields(report, device);
  report.print(options.report);
}

}  // namespace weft
