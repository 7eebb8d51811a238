// weft enlarge: a model of nested code-books with a larger planar index, synthesised by patches.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "btf_report.hpp"
#include "common.hpp"
#include "report.hpp"
#include "subcommand.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/error.hpp"
#include "weft/reference/enlarge_vq.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

struct EnlargeOptions {
  std::string model;
  std::string output;
  std::string size;
  std::optional<std::size_t> patch;
  std::optional<std::size_t> overlap;
  std::uint64_t seed = 0;
  OutputOptions report;
};

void run_enlarge(const EnlargeOptions& options) {
  if (output_kind(options.output) != OutputKind::model) {
    fail_input("--output: '{}' does not end in .weft", options.output);
  }
  const std::unique_ptr<Model> model = read_model(options.model);
  const auto* vq = dynamic_cast<const VqModel*>(model.get());
  if (vq == nullptr) {
    fail_input("{}: a model of codec {} has no planar index to enlarge, one of vq has",
               options.model, model->info.codec);
  }
  const BtfShape& shape = vq->info.btf.shape;
  reference::PatchRequest request = reference::patch_request(shape.height, shape.width);
  const ImageSize wanted = parse_image_size(options.size, "--size");
  request.height = wanted.height;
  request.width = wanted.width;
  if (options.patch) {
    request.patch = *options.patch;
    request.overlap = request.patch / 4;
  }
  if (options.overlap) request.overlap = *options.overlap;
  request.seed = options.seed;
  const std::unique_ptr<VqModel> large = reference::enlarge(*vq, request);
  large->info.program_version = version();
  const std::size_t before = ModelFile(options.model).size();
  const std::size_t size = write_model(options.output, *large);

  Report report;
  report.add("model", options.model);
  report.add("output", options.output);
  add_btf_fields(report, large->info.btf);
  report.add("patch", request.patch);
  report.add("overlap", request.overlap);
  report.add("model_size", bytes_cell(before));
  report.add("file_size", bytes_cell(size));
  report.print(options.report);
}

}  // namespace

void add_enlarge(CLI::App& program, Action& action) {
  auto options = std::make_shared<EnlargeOptions>();
  CLI::App* command =
      program.add_subcommand("enlarge", "Synthesise a larger texture of a vq model");
  command->add_option("MODEL", options->model, "Model: .weft, of codec vq")
      ->required()
      ->type_name("");
  command->add_option("-o,--output", options->output, "Model to write: NAME.weft")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("--size", options->size,
                   "Texels of the new texture, as 1024 or 1024x512, width first")
      ->required()
      ->type_name("SIZE");
  command
      ->add_option("--patch", options->patch,
                   "Side of a patch in texels; a fourth of the shorter side, 4 to 32, if none is "
                   "given")
      ->type_name("N");
  command
      ->add_option("--overlap", options->overlap,
                   "Texels by which patches overlap; a fourth of a patch if none are given")
      ->type_name("N");
  add_seed_option(*command, options->seed, "the choice of patches");
  add_output_options(*command, options->report);
  command->footer(
      "The planar index of nested code-books is made of patches of itself (image quilting); the\n"
      "code-books stay as they are, so that the file grows by the index alone.\n"
      "\n"
      "Examples:\n"
      "  weft enlarge cloth.weft --size 1024x1024 -o large.weft   (of --codec vq)\n"
      "  weft render large.weft --shape plane -o large.png");
  command->callback([options, &action] { action = [options] { run_enlarge(*options); }; });
}

}  // namespace weft
