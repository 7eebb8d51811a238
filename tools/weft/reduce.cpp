// weft reduce: a tucker model with fewer ranks in some modes, the others untouched.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>

#include "btf_report.hpp"
#include "common.hpp"
#include "report.hpp"
#include "subcommand.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/error.hpp"
#include "weft/model/tucker_parts.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

struct ReduceOptions {
  std::string model;
  std::string output;
  std::string ranks;
  OutputOptions report;
};

void run_reduce(const ReduceOptions& options) {
  if (output_kind(options.output) != OutputKind::model) {
    fail_input("--output: '{}' does not end in .weft", options.output);
  }
  const std::unique_ptr<Model> model = read_model(options.model);
  const auto* tucker = dynamic_cast<const TuckerModel*>(model.get());
  if (tucker == nullptr) {
    fail_input("{}: a model of codec {} has no ranks to reduce, one of tucker has", options.model,
               model->info.codec);
  }
  const std::unique_ptr<TuckerModel> less = with_ranks(*tucker, options.ranks);
  less->info.program_version = version();
  const std::size_t before = std::filesystem::file_size(options.model);
  const std::size_t size = write_model(options.output, *less);

  Report report;
  report.add("model", options.model);
  report.add("output", options.output);
  report.add("codec", less->info.codec);
  Report& ranks = report.section("ranks");
  for (std::size_t n = 0; n < less->groups.count(); ++n) {
    ranks.add(less->groups.groups()[n].name, less->ranks[n]);
  }
  report.add("model_size", bytes_cell(before));
  report.add("file_size", bytes_cell(size));
  report.print(options.report);
}

}  // namespace

void add_reduce(CLI::App& program, Action& action) {
  auto options = std::make_shared<ReduceOptions>();
  CLI::App* command = program.add_subcommand("reduce", "Cut ranks of a tucker model");
  command->add_option("MODEL", options->model, "Model: .weft, of codec tucker")
      ->required()
      ->type_name("");
  command->add_option("-o,--output", options->output, "Model to write: NAME.weft")
      ->required()
      ->type_name("FILE");
  command->add_option("--ranks", options->ranks, "New ranks of some modes, as l=3,v=20")
      ->required()
      ->type_name("RANKS");
  add_output_options(*command, options->report);
  command->footer(
      "Modes that are not named keep their factors as they are; what is lost is the part of the\n"
      "core that is given up. The new model's errors are not known: 'weft verify' measures them.\n"
      "\n"
      "Examples:\n"
      "  weft reduce cloth.weft --ranks l=9 -o sharp.weft    (of --codec tucker, say with l=27)\n"
      "  weft verify sharp.weft --against cloth.safetensors");
  command->callback([options, &action] { action = [options] { run_reduce(*options); }; });
}

}  // namespace weft
