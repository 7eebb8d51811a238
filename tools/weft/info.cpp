// weft info: what files hold, without reading their values.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "albedo_report.hpp"
#include "btf_report.hpp"
#include "common.hpp"
#include "occlusion_options.hpp"
#include "report.hpp"
#include "selection_options.hpp"
#include "subcommand.hpp"
#include "transform_options.hpp"
#include "weft/btf/tile.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/error.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/io/safetensors.hpp"
#include "weft/model/material_file.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/storage.hpp"
#include "weft/model/vq_base.hpp"
#include "weft/reference/light_sampler.hpp"
#include "weft/reference/lookup.hpp"

namespace weft {
namespace {

struct InfoOptions {
  std::vector<std::string> files;
  bool albedo = false;
  OutputOptions output;
};

void add_tensor_table(Report& report, const SafetensorsFile& file) {
  std::vector<std::vector<Cell>> rows;
  for (const TensorInfo& tensor : file.tensors()) {
    std::string shape = "[";
    for (const std::size_t size : tensor.shape) {
      shape += fmt::format("{}{}", shape.size() > 1 ? "," : "", size);
    }
    rows.push_back({text_cell(tensor.name), text_cell(name_of(tensor.dtype)),
                    json_cell(shape + "]"),
                    Cell{format_bytes(tensor.bytes()), std::to_string(tensor.bytes()), true}});
  }
  report.table("tensors", {"tensor", "dtype", "shape", "bytes"}, std::move(rows));
}

// The materials of a data base, what is theirs and what they share.
void describe_base(Report& report, const std::filesystem::path& path) {
  const VqBase base = VqBase::read(path);
  const VqModel::Sizes& s = base.books.sizes;
  const OnionSizes& n = base.books.grid.sizes;
  report.add("kind", "data base");
  report.add("codec", base.books.info.codec);
  report.add("storage", storage_text(base.books.info));
  report.add("grid", base.books.grid.kind == VqGrid::Kind::onion ? "onion" : "measured");
  report.add("slices", fmt::format("{},{},{},{}", n.alpha, n.beta, n.theta, n.phi));
  Report& books = report.section("code_books");
  for (const auto& [name, size] :
       std::initializer_list<std::pair<const char*, std::size_t>>{{"P1", s.p1},
                                                                  {"P2", s.p2},
                                                                  {"M", s.m},
                                                                  {"P3", s.p3},
                                                                  {"P4", s.p4},
                                                                  {"C", s.c},
                                                                  {"I1", s.i1},
                                                                  {"I2", s.i2}}) {
    books.add(name, size);
  }
  const VqBaseBytes bytes = vq_base_bytes(base);
  std::size_t raw = 0;
  std::vector<std::vector<Cell>> rows;
  for (std::size_t i = 0; i < base.materials.size(); ++i) {
    const ModelInfo& info = base.materials[i].index.info;
    const BtfShape& shape = info.btf.shape;
    raw += info.btf.bytes();
    rows.push_back({text_cell(base.materials[i].name),
                    json_cell(fmt::format("[{},{},{},{},{}]", shape.views, shape.lights,
                                          shape.height, shape.width, shape.channels)),
                    count_cell(base.materials[i].index.coarser.size() + 1),
                    bytes_cell(info.btf.bytes()), bytes_cell(bytes.own[i]),
                    number_cell(info.errors ? info.errors->snr : std::nan(""), "dB")});
  }
  const auto size = static_cast<std::size_t>(std::filesystem::file_size(path));
  report.add("raw_size", bytes_cell(raw));
  report.add("file_size", bytes_cell(size));
  report.add("shared_size", bytes_cell(bytes.shared));
  report.add("ratio", static_cast<double>(raw) / static_cast<double>(size));
  report.add("checksums", "verified");
  report.table("materials", {"name", "shape", "levels", "raw_size", "own_size", "snr"},
               std::move(rows));
}

// Bytes of the tensors that are one material's.
std::size_t own_bytes(const SafetensorsFile& file, const std::string& material) {
  std::size_t bytes = 0;
  for (const TensorInfo& tensor : file.tensors()) {
    if (tensor.name.starts_with(material + "/")) bytes += tensor.bytes();
  }
  return bytes;
}

// Whether a path is that of a data base, and not of a material in it.
bool names_base(const std::filesystem::path& path) {
  return material_path(path).name.empty() && !read_materials(SafetensorsFile(path)).empty();
}

void describe_model(Report& report, const std::filesystem::path& path, bool albedo) {
  // Opening it verifies the container, the metadata and the checksum of every tensor.
  const ModelFile model(path);
  // Reading it verifies that its tensors fit each other and its codec.
  const Codec& codec = find_codec(model.info().codec);
  const std::unique_ptr<Model> read = read_model(model);
  const ModelInfo& info = read->info;
  report.add("kind", "model");
  report.add("program_version", info.program_version);
  report.add("codec", info.codec);
  report.add("parameters", json_cell(info.parameters));
  report.add("storage", storage_text(info));
  report.add("selection", selection_cell(recorded_from_json(info.selection, path.string())));
  add_transform_field(report, info.colour_transform);
  if (!info.weights.empty()) report.add("weights", json_cell(info.weights));
  add_btf_fields(report, info);
  report.add("raw_size", bytes_cell(info.btf.bytes()));
  report.add("file_size", bytes_cell(model.size()));
  const MaterialPath material = material_path(path);
  if (material.name.empty()) {
    report.add("ratio", static_cast<double>(info.btf.bytes()) / static_cast<double>(model.size()));
  } else {
    // the file holds others too
    report.add("own_size", bytes_cell(own_bytes(SafetensorsFile(material.file), material.name)));
  }
  report.add("checksums", "verified");
  if (info.errors) add_error_fields(report.section("errors"), *info.errors);
  if (info.errors && info.errors->weighted) {
    add_weighted_fields(report.section("weighted_errors"), *info.errors->weighted);
  }
  add_occlusion_section(report, info);
  add_tensor_table(report, model.file());
  if (albedo) add_albedo_table(report, info.btf, *codec.light_sampler(nullptr, *read));
}

void describe_raw(Report& report, const std::filesystem::path& path, bool albedo) {
  const std::shared_ptr<TileSource> source = open_raw_btf(path);
  report.add("kind", "raw BTF");
  add_btf_fields(report, source->info());
  report.add("raw_size", bytes_cell(source->info().bytes()));
  report.add("file_size", bytes_cell(std::filesystem::file_size(path)));
  if (SafetensorsFile::looks_like(path)) add_tensor_table(report, SafetensorsFile(path));
  if (albedo) {
    const auto sampler =
        reference::slice_light_sampler(source->info(), reference::tile_sampler(*source));
    add_albedo_table(report, source->info(), *sampler);
  }
}

void run_info(const InfoOptions& options) {
  Report report;
  std::size_t bad = 0;
  std::string first_error;
  for (const std::string& name : options.files) {
    const std::filesystem::path path(name);
    Report description;
    description.add("file", name);
    try {
      if (ModelFile::looks_like(path) && names_base(path)) {
        if (options.albedo) {
          fail_input("--albedo: of a material; name one, as {}:NAME", path.string());
        }
        describe_base(description, path);
      } else if (ModelFile::looks_like(path)) {
        describe_model(description, path, options.albedo);
      } else {
        describe_raw(description, path, options.albedo);
      }
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::input) throw;
      if (bad++ == 0) first_error = error.what();
      description = Report();
      description.add("file", name).add("error", error.what());
    }
    report.item("files") = std::move(description);
  }
  if (bad == 0) {
    report.print(options.output);
    return;
  }
  // One bad file among several hides nothing about the others.
  if (options.files.size() > 1) report.print(options.output);
  if (bad == 1) fail_input("{}", first_error);
  fail_input("{} of {} files are not valid; the first: {}", bad, options.files.size(), first_error);
}

}  // namespace

void add_info(CLI::App& program, Action& action) {
  auto options = std::make_shared<InfoOptions>();
  CLI::App* command = program.add_subcommand(
      "info", "Say what raw BTFs and models hold: sizes, directions, codec, ratio, errors");
  command
      ->add_option("FILE", options->files,
                   "Raw BTFs (.safetensors, or .npy with a .json beside it) and models (.weft)")
      ->required()
      ->type_name("")
      ->default_str("");
  command->add_flag("--albedo", options->albedo,
                    "Tell what the material reflects in all of even light, for each measured view: "
                    "the mean over up to 64 texels");
  add_output_options(*command, options->output);
  command->footer(
      "The header of every file and the checksums of models are verified; the values of raw BTFs "
      "are\n"
      "not read without --albedo. Exit status 2 if a file is not valid.\n"
      "\n"
      "Examples:\n"
      "  weft info cloth.safetensors\n"
      "  weft info cloth.weft other.weft\n"
      "  weft info base.weft base.weft:wool    (a data base, and a material in it)\n"
      "  weft info --albedo cloth.weft\n"
      "  weft info --json cloth.weft");
  command->callback([options, &action] { action = [options] { run_info(*options); }; });
}

}  // namespace weft
