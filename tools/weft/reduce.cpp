// weft reduce: a tucker model with fewer ranks in some modes, the others untouched; or a vq model
// without the code-vectors that it does not use, as of a material of a data base.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "btf_report.hpp"
#include "common.hpp"
#include "report.hpp"
#include "subcommand.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/error.hpp"
#include "weft/model/tucker_parts.hpp"
#include "weft/model/vq.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

struct ReduceOptions {
  std::string model;
  std::string output;
  std::string ranks;
  OutputOptions report;
};

// A material alone.
void run_extract(const ReduceOptions& options, const VqModel& model) {
  if (!options.ranks.empty()) {
    fail_input(
        "--ranks {}: a model of codec vq has none; it loses the code-vectors that it does "
        "not use",
        options.ranks);
  }
  const std::unique_ptr<VqModel> less = model.select({});
  less->info = model.info;
  less->info.program_version = version();
  const std::size_t before = ModelFile(options.model).size();
  const std::size_t size = write_model(options.output, *less);
  Report report;
  report.add("model", options.model);
  report.add("output", options.output);
  report.add("codec", less->info.codec);
  std::vector<std::vector<Cell>> rows;
  const auto row = [&](const char* name, std::size_t whole, std::size_t part) {
    rows.push_back({text_cell(name), count_cell(whole), count_cell(part)});
  };
  const VqModel::Sizes& all = model.sizes;
  const VqModel::Sizes& used = less->sizes;
  row("P4", all.p4, used.p4);
  row("P3", all.p3, used.p3);
  row("M", all.m, used.m);
  row("P2", all.p2, used.p2);
  row("P1", all.p1, used.p1);
  row("I2", all.i2, used.i2);
  row("I1", all.i1, used.i1);
  row("C", all.c, used.c);
  report.table("code_books", {"name", "before", "entries"}, std::move(rows));
  report.add("model_size", bytes_cell(before));
  report.add("file_size", bytes_cell(size));
  report.print(options.report);
}

void run_reduce(const ReduceOptions& options) {
  if (output_kind(options.output) != OutputKind::model) {
    fail_input("--output: '{}' does not end in .weft", options.output);
  }
  const std::unique_ptr<Model> model = read_model(options.model);
  if (const auto* vq = dynamic_cast<const VqModel*>(model.get())) {
    run_extract(options, *vq);
    return;
  }
  const auto* tucker = dynamic_cast<const TuckerModel*>(model.get());
  if (tucker == nullptr) {
    fail_input("{}: a model of codec {} has no ranks to reduce, one of tucker has", options.model,
               model->info.codec);
  }
  if (options.ranks.empty()) fail_input("--ranks is required for a model of codec tucker");
  const std::unique_ptr<TuckerModel> less = with_ranks(*tucker, options.ranks);
  less->info.program_version = version();
  const std::size_t before = ModelFile(options.model).size();
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
  CLI::App* command = program.add_subcommand(
      "reduce", "Cut ranks of a tucker model, or take a material out of a data base");
  command
      ->add_option("MODEL", options->model,
                   "Model: .weft, of codec tucker, or of vq, as BASE.weft:NAME")
      ->required()
      ->type_name("");
  command->add_option("-o,--output", options->output, "Model to write: NAME.weft")
      ->required()
      ->type_name("FILE");
  command->add_option("--ranks", options->ranks, "Of tucker: new ranks of some modes, as l=3,v=20")
      ->type_name("RANKS")
      ->default_str("");
  add_output_options(*command, options->report);
  command->footer(
      "Modes that are not named keep their factors as they are; what is lost is the part of the\n"
      "core that is given up. The new model's errors are not known: 'weft verify' measures them.\n"
      "A model of codec vq keeps the code-vectors that it uses, and decodes to the same bits.\n"
      "\n"
      "Examples:\n"
      "  weft reduce cloth.weft --ranks l=9 -o sharp.weft    (of --codec tucker, say with l=27)\n"
      "  weft verify sharp.weft --against cloth.safetensors\n"
      "  weft reduce base.weft:wool -o wool.weft");
  command->callback([options, &action] { action = [options] { run_reduce(*options); }; });
}

}  // namespace weft
