// weft sheet: a contact sheet of a raw BTF or a model, alone or beside a reconstruction.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "common.hpp"
#include "report.hpp"
#include "selection_options.hpp"
#include "subcommand.hpp"
#include "weft/btf/selection.hpp"
#include "weft/btf/tile.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/codecs/decoded_source.hpp"
#include "weft/error.hpp"
#include "weft/io/contact_sheet.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/model/model_file.hpp"

namespace weft {
namespace {

struct SheetOptions {
  std::string original;
  std::string decoded;
  std::string output;
  std::size_t columns = 8;
  SelectionOptions selection;
  ContactSheetOptions sheet;
  OutputOptions report;
};

// A raw BTF or a model.
struct Input {
  std::string file;
  std::shared_ptr<TileSource> raw;
  std::shared_ptr<const Model> model;
};

Input open_input(const std::string& file) {
  if (ModelFile::looks_like(file)) return {file, nullptr, read_model(file)};
  return {file, open_raw_btf(file), nullptr};
}

// Images of a model, decoded one by one by the reference: a sheet needs few.
std::shared_ptr<TileSource> decoded_part(const Input& input, const Selection& part) {
  return select(decoded_source(nullptr, input.model), part);
}

struct Pair {
  std::shared_ptr<TileSource> original;
  std::shared_ptr<TileSource> decoded;  // or null
};

// The selected part of both. Where one is a model of a part of a BTF, it is a part of that part.
Pair selected_pair(const SelectionOptions& options, const Input& original, const Input* decoded) {
  if (original.raw && decoded && decoded->model) {
    const ModelSelection selection = make_selection(options, decoded->model->info, decoded->file);
    const std::shared_ptr<TileSource> part = decoded_part(*decoded, selection.part);
    return {
        part_of_original(original.raw, original.file, selection.whole, part->info().shape, false),
        part};
  }
  Pair pair;
  Selection part;
  if (original.raw) {
    part = make_selection(options, original.raw->info());
    pair.original = select(original.raw, part);
  } else {
    part = make_selection(options, original.model->info, original.file).part;
    pair.original = decoded_part(original, part);
  }
  if (!decoded) return pair;
  pair.decoded =
      decoded->raw
          ? select(decoded->raw, part)
          : decoded_part(*decoded,
                         make_selection(options, decoded->model->info, decoded->file).part);
  return pair;
}

// All selected images where views or lights were, else some spread over all.
std::vector<std::size_t> chosen_images(const SheetOptions& options, const BtfShape& shape) {
  if (options.selection.views.empty() && options.selection.lights.empty()) {
    return spread_images(shape, options.columns);
  }
  std::vector<std::size_t> images(shape.images());
  std::iota(images.begin(), images.end(), std::size_t{0});
  return images;
}

void run_sheet(const SheetOptions& options) {
  if (std::filesystem::path(options.output).extension() != ".png") {
    fail_input("{}: a contact sheet is a PNG; let its name end in .png", options.output);
  }
  const Input original = open_input(options.original);
  std::optional<Input> decoded;
  if (!options.decoded.empty()) decoded = open_input(options.decoded);
  const Pair pair = selected_pair(options.selection, original, decoded ? &*decoded : nullptr);
  ContactSheetOptions sheet = options.sheet;
  sheet.images = chosen_images(options, pair.original->info().shape);
  const ContactSheet done =
      write_contact_sheet(options.output, *pair.original, pair.decoded.get(), sheet);

  Report report;
  report.add("contact_sheet", options.output);
  report.add("images", sheet.images.size());
  report.add("width", done.width, "pixels").add("height", done.height, "pixels");
  report.add("exposure", done.exposure);
  report.print(options.report);
}

}  // namespace

void add_sheet(CLI::App& program, Action& action) {
  auto options = std::make_shared<SheetOptions>();
  CLI::App* command = program.add_subcommand(
      "sheet", "Draw a contact sheet of a raw BTF or a model, alone or beside a reconstruction");
  command->add_option("RAW", options->original, "Raw BTF (.safetensors, .npy) or model (.weft)")
      ->required()
      ->type_name("")
      ->default_str("");
  command
      ->add_option("DECODED", options->decoded,
                   "Its reconstruction: a model of it or of a part of it, or a raw BTF of the same "
                   "shape")
      ->type_name("")
      ->default_str("");
  command->add_option("-o,--output", options->output, "The PNG to write")
      ->required()
      ->type_name("FILE.png")
      ->default_str("");
  command
      ->add_option("--columns", options->columns, "Number of images, spread over views and lights")
      ->type_name("N")
      ->check(CLI::Range(1, 256));
  command
      ->add_option("--per-row", options->sheet.per_row,
                   "Images side by side before a new row begins; 0 for all in one row")
      ->type_name("N")
      ->check(CLI::Range(0, 256));
  command
      ->add_option("--difference", options->sheet.difference_scale,
                   "Factor on the difference of the displayed values")
      ->type_name("N");
  command
      ->add_option(
          "--exposure", options->sheet.exposure,
          "Factor on linear light; 0 chooses it: 1 for 8-bit data, else the 99th percentile "
          "becomes white")
      ->type_name("X");
  add_selection_options(*command, options->selection);
  add_output_options(*command, options->report);
  command->footer(
      "Rows: the original; with DECODED also the reconstruction, and their difference. With "
      "--views "
      "or\n"
      "--lights, all images that they select.\n"
      "\n"
      "Examples:\n"
      "  weft sheet cloth.safetensors -o cloth.png\n"
      "  weft sheet cloth.safetensors cloth.weft --difference 20 -o compared.png\n"
      "  weft sheet cloth.safetensors --views 0,40 --lights 0-7 -o chosen.png");
  command->callback([options, &action] { action = [options] { run_sheet(*options); }; });
}

}  // namespace weft
