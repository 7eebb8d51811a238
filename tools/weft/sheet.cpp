// weft sheet: a contact sheet of a raw BTF or a model, alone or beside a reconstruction.
#include <CLI/CLI.hpp>
#include <cstring>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common.hpp"
#include "report.hpp"
#include "selection_options.hpp"
#include "subcommand.hpp"
#include "weft/btf/selection.hpp"
#include "weft/btf/tile.hpp"
#include "weft/codecs/codec.hpp"
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
  std::string views, lights;
  ContactSheetOptions sheet;
  OutputOptions report;
};

// Images of a model, decoded one by one by the reference: a sheet needs few.
class ModelSource final : public TileSource {
 public:
  explicit ModelSource(const std::filesystem::path& path)
      : model_(read_model(path)),
        decoder_(find_codec(model_->info.codec).reference_decoder(*model_)),
        info_(model_->info.btf) {
    info_.dtype = DType::f32;
  }

  const BtfInfo& info() const override { return info_; }

  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    std::vector<double> values(count * info_.shape.image_values());
    decoder_->decode(first, count, values);
    const std::vector<float> stored(values.begin(), values.end());
    std::memcpy(out.data(), stored.data(), out.size());
  }

 private:
  std::unique_ptr<Model> model_;
  std::unique_ptr<ReferenceDecoder> decoder_;
  BtfInfo info_;
};

std::shared_ptr<TileSource> open_raw_or_model(const std::filesystem::path& path) {
  if (ModelFile::looks_like(path)) return std::make_shared<ModelSource>(path);
  return open_raw_btf(path);
}

// The images of --views and --lights, or some spread over all.
std::vector<std::size_t> chosen_images(const SheetOptions& options, const BtfInfo& info) {
  if (options.views.empty() && options.lights.empty()) {
    return spread_images(info.shape, options.columns);
  }
  const auto indices = [](const std::string& text, std::size_t limit, const char* option) {
    return parse_indices(text.empty() ? "all" : text, limit, option);
  };
  std::vector<std::size_t> images;
  for (const std::size_t view : indices(options.views, info.shape.views, "--views")) {
    for (const std::size_t light : indices(options.lights, info.shape.lights, "--lights")) {
      images.push_back(view * info.shape.lights + light);
    }
  }
  return images;
}

void run_sheet(const SheetOptions& options) {
  if (std::filesystem::path(options.output).extension() != ".png") {
    fail_input("{}: a contact sheet is a PNG; let its name end in .png", options.output);
  }
  const std::shared_ptr<TileSource> original = open_raw_or_model(options.original);
  const std::shared_ptr<TileSource> decoded =
      options.decoded.empty() ? nullptr : open_raw_or_model(options.decoded);
  ContactSheetOptions sheet = options.sheet;
  sheet.images = chosen_images(options, original->info());
  const ContactSheet done = write_contact_sheet(options.output, *original, decoded.get(), sheet);

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
                   "Its reconstruction: a model, or a raw BTF of the same shape")
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
  command->add_option("--views", options->views, "Images of these views instead: 0,3,8-11, or all")
      ->type_name("LIST")
      ->default_str("");
  command->add_option("--lights", options->lights, "... under these lights")
      ->type_name("LIST")
      ->default_str("");
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
  add_output_options(*command, options->report);
  command->footer(
      "Rows: the original; with DECODED also the reconstruction, and their difference.\n"
      "\n"
      "Examples:\n"
      "  weft sheet cloth.safetensors -o cloth.png\n"
      "  weft sheet cloth.safetensors cloth.weft --difference 20 -o compared.png\n"
      "  weft sheet cloth.safetensors --views 0,40 --lights 0-7 -o chosen.png");
  command->callback([options, &action] { action = [options] { run_sheet(*options); }; });
}

}  // namespace weft
