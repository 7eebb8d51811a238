#include "weft/model/vq_base.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/btf_tensors.hpp"
#include "weft/model/material_file.hpp"
#include "weft/model/model_metadata.hpp"
#include "weft/model/model_writer.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

// Tensors that may be quantised and that each material has of its own.
bool is_own(std::string_view tensor) {
  return tensor.starts_with("P6");
}

// Takes those of one or the other kind of tensors out of a list by name.
template <typename Map>
void keep_kind(Map& map, bool own) {
  for (auto at = map.begin(); at != map.end();) {
    at = is_own(at->first) == own ? std::next(at) : map.erase(at);
  }
}

VqMaterial material_of(std::string name, const VqModel& model) {
  VqMaterial material{std::move(name), {}};
  VqModel& index = material.index;
  index.info = model.info;
  keep_kind(index.info.quantised, true);
  index.p6 = model.p6;
  index.coarser = model.coarser;
  return material;
}

// A model without its planar index and what is a material's.
void strip(VqModel& model) {
  ModelInfo info;
  info.codec = model.info.codec;
  info.storage = model.info.storage;
  info.quantised = std::move(model.info.quantised);
  keep_kind(info.quantised, false);
  model.info = std::move(info);
  model.p6 = {};
  model.coarser.clear();
}

std::vector<FilePart> parts_of(const VqBase& base) {
  std::vector<FilePart> parts{{&base.books, "", false, nullptr}};
  for (const VqMaterial& material : base.materials) {
    parts.push_back({&material.index, material.name + "/", true, nullptr});
  }
  return parts;
}

Metadata metadata_of(const VqBase& base, const std::string& where) {
  Metadata metadata;
  metadata["weft.format"] = base_format_version;
  metadata["weft.version"] = version();
  metadata["codec"] = base.books.info.codec;
  metadata["storage"] = base.books.info.storage == Storage::f16 ? "f16" : "f32";
  std::vector<MaterialEntry> entries;
  for (const VqMaterial& material : base.materials) {
    entries.push_back({material.name, model_metadata(material.index.info, where)});
    for (const char* shared : {"weft.format", "codec", "storage"}) {
      entries.back().metadata.erase(shared);
    }
  }
  metadata["materials"] = materials_json(entries);
  return metadata;
}

}  // namespace

bool VqBase::has(std::string_view name) const {
  return std::any_of(materials.begin(), materials.end(),
                     [&](const VqMaterial& material) { return material.name == name; });
}

std::unique_ptr<VqModel> VqBase::model(std::size_t material) const {
  auto model = std::make_unique<VqModel>(books);
  const VqModel& index = materials[material].index;
  model->info = index.info;
  model->info.codec = books.info.codec;
  model->info.storage = books.info.storage;
  for (const auto& [tensor, quantisation] : books.info.quantised) {
    model->info.quantised[tensor] = quantisation;
  }
  model->p6 = index.p6;
  model->coarser = index.coarser;
  return model;
}

void check_shares(const VqBase& base, const ModelInfo& info, const VqGrid& grid,
                  std::size_t channels, std::string_view where) {
  const VqMaterial& first = base.materials.front();
  const ModelInfo& other = first.index.info;
  const auto differ = [&](std::string_view what, const std::string& here,
                          const std::string& there) {
    fail_input("{}: {} {}, of '{}' {}: materials of a data base have it in common", where, what,
               here, first.name, there);
  };
  const auto sizes = [](const VqGrid& of) {
    return fmt::format("{} of {} x {} x {} x {}",
                       of.kind == VqGrid::Kind::onion ? "onion slices" : "measured directions",
                       of.sizes.alpha, of.sizes.beta, of.sizes.theta, of.sizes.phi);
  };
  if (channels != base.books.chromaticities + 1) {
    differ("channels", std::to_string(channels), std::to_string(base.books.chromaticities + 1));
  }
  if (grid != base.books.grid) differ("grid", sizes(grid), sizes(base.books.grid));
  if (grid.kind == VqGrid::Kind::measured &&
      (info.btf.view_directions != other.btf.view_directions ||
       info.btf.light_directions != other.btf.light_directions ||
       info.btf.layout != other.btf.layout)) {
    differ("measured directions", "its own", "others");
  }
  if (info.colour_transform.kind != other.colour_transform.kind) {
    differ("colour transform", std::string(name_of(info.colour_transform.kind)),
           std::string(name_of(other.colour_transform.kind)));
  }
  if (info.colour_transform.weights != other.colour_transform.weights) {
    differ("colour weights", fmt::format("{}", fmt::join(info.colour_transform.weights, ",")),
           fmt::format("{}", fmt::join(other.colour_transform.weights, ",")));
  }
}

VqBase VqBase::read(const std::filesystem::path& path) {
  const SafetensorsFile file(path);
  const std::vector<MaterialEntry> entries = read_materials(file);
  VqBase base;
  if (entries.empty()) {
    std::unique_ptr<VqModel> model = VqModel::read(ModelFile(path));
    if (model->info.occlusion || model->channels.size() != model->chromaticities + 1) {
      fail_input("{}: a model of {} can't become a data base", path.string(),
                 model->info.occlusion ? "a mask" : "some channels");
    }
    const std::string name = path.stem().string();
    check_material_name(name, path.string());
    base.materials.push_back(material_of(name, *model));
    strip(*model);
    base.books = std::move(*model);
    return base;
  }
  for (const MaterialEntry& entry : entries) {
    const std::string where = path.string() + ":" + entry.name;
    std::unique_ptr<VqModel> model = VqModel::read(ModelFile(where));
    base.materials.push_back(material_of(entry.name, *model));
    if (base.materials.size() == 1) {
      strip(*model);
      base.books = std::move(*model);
    }
    check_shares(base, base.materials.back().index.info, base.books.grid,
                 base.materials.back().index.info.btf.shape.channels, where);
  }
  return base;
}

std::size_t write_vq_base(const std::filesystem::path& path, const VqBase& base) {
  const std::string where = path.string();
  for (const VqMaterial& material : base.materials) validate(material.index.info.btf, where);
  return write_parts(path, parts_of(base), metadata_of(base, where));
}

std::size_t vq_base_size(const VqBase& base) {
  return parts_size(parts_of(base), metadata_of(base, "data base"));
}

VqBaseBytes vq_base_bytes(const VqBase& base) {
  VqBaseBytes bytes;
  const std::vector<FilePart> parts = parts_of(base);
  bytes.shared = part_bytes(parts.front());
  for (std::size_t i = 1; i < parts.size(); ++i) bytes.own.push_back(part_bytes(parts[i]));
  return bytes;
}

}  // namespace weft
