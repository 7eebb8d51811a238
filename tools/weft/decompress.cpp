// weft decompress: a model, whole or in part, to images, NPY or a raw BTF.
#include "weft/codecs/decompress.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include "btf_report.hpp"
#include "common.hpp"
#include "job_report.hpp"
#include "report.hpp"
#include "selection_options.hpp"
#include "subcommand.hpp"
#include "weft/btf/copy_images.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/codecs/decoded_source.hpp"
#include "weft/codecs/occlusion.hpp"
#include "weft/codecs/tucker.hpp"
#include "weft/error.hpp"
#include "weft/io/image_folder.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft {
namespace {

struct DecompressOptions {
  std::string model;
  std::string output;
  std::string format = "exr";
  std::string compression = "zip";
  std::string expand;  // modes, "y,x"
  std::string dtype;   // of the model's raw tensor, or F16 for EXR
  std::size_t threads = 0;
  bool replace = false;
  SelectionOptions selection;
  DeviceOptions device;
  OutputOptions report;
};

DType output_type(const DecompressOptions& options, DType otherwise) {
  if (options.dtype.empty()) return otherwise;
  return parse_dtype(options.dtype, "--dtype");
}

// The sink, and the same as image folder where it is one.
struct Output {
  std::unique_ptr<TileSink> sink;
  ImageFolderSink* images = nullptr;
};

Output create_output(const DecompressOptions& options, const BtfInfo& data) {
  BtfInfo info = data;
  Output output;
  switch (output_kind(options.output)) {
    case OutputKind::folder: {
      ImageFolderOptions folder;
      folder.format = image_format_from_name(options.format, "--format");
      folder.compression = exr_compression_from_name(options.compression, "--compression");
      folder.exr_dtype = output_type(options, DType::f16);
      folder.threads = options.threads;
      folder.replace = options.replace;
      if (folder.format == ImageFormat::exr && folder.exr_dtype == DType::u8) {
        fail_input("--dtype u8: EXR holds f16 or f32");
      }
      if (folder.format == ImageFormat::png && !options.dtype.empty() && options.dtype != "u8") {
        fail_input("--dtype {}: PNG holds u8", options.dtype);
      }
      auto images = std::make_unique<ImageFolderSink>(options.output, info, folder);
      output.images = images.get();
      output.sink = std::move(images);
      return output;
    }
    case OutputKind::npy:
      info.dtype = output_type(options, data.dtype);
      output.sink = create_npy_btf(options.output, info);
      return output;
    case OutputKind::safetensors:
      info.dtype = output_type(options, data.dtype);
      output.sink = create_raw_btf(options.output, info);
      return output;
    case OutputKind::model:
      break;
  }
  fail_input("--output: '{}' names a model; a folder, .npy or .safetensors is needed",
             options.output);
}

std::size_t tensor_bytes(const Model& model) {
  std::size_t bytes = 0;
  for (const ModelTensor& tensor : model.tensors()) bytes += tensor.values.size();
  return bytes;
}

void run_decompress(const DecompressOptions& options) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  std::shared_ptr<const Model> model = expand_modes(read_model(options.model), options.expand);
  const Codec& codec = find_codec(model->info.codec);
  const ModelSelection selection = make_selection(options.selection, model->info, options.model);
  Selection part = selection.part;
  part.level = 0;
  if (!part.selects_all()) model = codec.select(*model, part);
  std::unique_ptr<Device> device = open_device(options.device, options.report);
  ReportedJob reported(options.device, options.report);
  Job& job = reported.job();

  job.held.push_back({"model", 2 * tensor_bytes(*model)});

  if (model->info.occlusion) job.held.push_back({"mask", decoded_mask_bytes(model->info)});

  // Levels above 0 and the reference's decoding go image by image.
  Selection level;
  level.level = selection.part.level;
  BtfInfo info = select(with_decoded_mask(device.get(), model->info, job), level);
  info.source = selected_source(info.source, selection.whole);
  model = at_held_level(model, level.level);
  std::shared_ptr<TileSource> images;
  if (level.level != 0 || !device) {
    BtfInfo as_floats = info;
    as_floats.dtype = DType::f32;
    MemoryPlan plan;
    plan.add("decoded images", 3 * model->info.btf.shape.image_values() * sizeof(double));
    plan.add("images in and out", 2 * copy_images_bytes(as_floats));
    if (device) plan.add("model on the device", codec.decoder_bytes(*model));
    job.plan(plan);
    images = select(decoded_source(device.get(), model), level);
  }
  Output output = create_output(options, info);
  if (output.images) job.held.push_back({"image queue", output.images->queue_bytes()});
  const Clock::time_point decode_start = Clock::now();
  if (images) {
    const StageTimer timer(job, "decode and write");
    copy_images(*images, *output.sink, [&](std::size_t done) {
      job.advance("decompress", done, images->info().shape.images());
    });
  } else {
    decompress(*device, *model, *output.sink, job);
  }
  reported.finish_progress();
  const double seconds = std::chrono::duration<double>(Clock::now() - decode_start).count();

  Report report;
  report.add("model", options.model);
  report.add("codec", codec.name());
  report.add("output", options.output);
  report.add("selection", selection_cell(selection.whole));
  add_btf_fields(report, output.sink->info());
  report.add("device", device_name(device));
  const auto count = static_cast<double>(info.shape.images());
  report.add("decode_time", seconds, "s");
  report.add("time", std::chrono::duration<double>(Clock::now() - start).count(), "s");
  report.add("image_rate", count / seconds, "images/s");
  report.add("texel_rate", count * static_cast<double>(info.shape.texels()) / seconds, "texels/s");
  if (output.images) {
    const auto threads = static_cast<double>(output.images->threads());
    report.add("writing_threads", output.images->threads());
    report.add("image_bytes", bytes_cell(output.images->bytes_written()));
    report.add("writing_busy_time", output.images->busy_seconds(), "s");
    // Of the time that all writing threads had.
    report.add("writing_share", output.images->busy_seconds() / (threads * seconds));
    report.add("waited_for_writing", output.images->wait_seconds(), "s");
  }
  reported.add_fields(report);
  add_device_fields(report, device);
  report.print(options.report);
}

}  // namespace

void add_decompress(CLI::App& program, Action& action) {
  auto options = std::make_shared<DecompressOptions>();
  CLI::App* command =
      program.add_subcommand("decompress", "Decompress a model to images, NPY or a raw BTF");
  command->add_option("MODEL", options->model, "Model: .weft")->required()->type_name("");
  command
      ->add_option("-o,--output", options->output,
                   "A folder for images, NAME.npy, or NAME.safetensors")
      ->required()
      ->type_name("PATH");
  command->add_option("--format", options->format, "Images in a folder: exr (linear light) or png")
      ->check(CLI::IsMember({"exr", "png"}))
      ->type_name("NAME");
  command->add_option("--compression", options->compression, "Of EXR: none, zip or piz")
      ->check(CLI::IsMember({"none", "zip", "piz"}))
      ->type_name("NAME");
  command
      ->add_option("--dtype", options->dtype,
                   "u8, f16 or f32; by default f16 for EXR, and the raw tensor's type otherwise")
      ->check(CLI::IsMember({"u8", "f16", "f32"}))
      ->type_name("TYPE");
  command
      ->add_option("--threads", options->threads,
                   "Threads that encode and write images; 0: as many as the machine has")
      ->check(CLI::Range(0, 256))
      ->type_name("COUNT");
  command
      ->add_option(
          "--expand", options->expand,
          "Modes of a tucker or kcta model, as y,x, whose factors are multiplied into its cores "
          "once: memory for speed")
      ->type_name("MODES");
  command->add_flag("--replace", options->replace,
                    "Let an existing folder that is not empty give way");
  add_selection_options(*command, options->selection);
  add_device_options(*command, options->device);
  add_output_options(*command, options->report);
  command->footer(
      "Only what is selected is decoded; views, lights, channels, texels and levels count in the "
      "BTF\n"
      "that the model was made of, also where it holds only a part of it. Values that the output's "
      "type can't hold are clamped: to\n"
      "[0, 1] for 8 bits, to +-65504 for half.\n"
      "\n"
      "Examples:\n"
      "  weft decompress cloth.weft -o images/\n"
      "  weft decompress cloth.weft --format png --views 0,40 --lights 0-5 -o png/\n"
      "  weft decompress cloth.weft --region 0,0,64x64 --dtype f32 -o part.npy\n"
      "  weft decompress cloth.weft --level 2 -o small.safetensors\n"
      "  weft decompress tensors.weft --expand y,x -o images/");
  command->callback([options, &action] { action = [options] { run_decompress(*options); }; });
}

}  // namespace weft
