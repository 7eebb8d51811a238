// Model files (`.weft`): the safetensors container with a model's tensors, directions and metadata.
//
// Metadata: weft.format ("1"; "2" with entropy-coded tensors, see coded_tensor.hpp; "3" with a
// packed mask, or with a model of it, see occlusion_metadata.hpp, and the metadata `occlusion`; "4"
// a data base of several materials, see material_file.hpp),
// weft.version, codec, parameters, selection, colour_transform, storage ("f16" or "f32"), shape
// ("[V,L,Y,X,C]" of what decoding gives), dtype, encoding, quantity, layout, channel_names, source,
// weights (where the model was fitted with some), errors, checksums
// ({"tensor": "16 hex digits of XXH3-64"}). Tensors: the codec's, `view_directions`,
// `light_directions`, optionally `mask`, U8 or coded as bits, or those of its model; with F16
// storage a real-valued tensor NAME is F16 and stands beside NAME.scale (F32, one power of two per
// component).
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "weft/io/safetensors.hpp"
#include "weft/model/model.hpp"

namespace weft {

// A model file opened and validated: container, format version, metadata, checksums, finite values,
// scales that are powers of two. The codec's own checks (shapes against each other, index ranges)
// follow in its `read`.
class ModelFile {
 public:
  // A model, or FILE.weft:NAME, a material of a data base.
  explicit ModelFile(const std::filesystem::path& path);

  const ModelInfo& info() const { return info_; }
  const SafetensorsFile& file() const { return *file_; }
  // Bytes of the file.
  std::size_t size() const { return file_->file().bytes().size(); }

  // Whether a model stands for the mask; what the file says of it, without the model itself; and
  // that model as a file of its own, whose tensors have `occlusion.` in front of their names.
  bool has_occlusion() const { return occlusion_ != nullptr; }
  const Occlusion& occlusion() const { return *occlusion_; }
  ModelFile occlusion_model() const;

  // Whether the model has a tensor of that name.
  bool has(std::string_view name) const;

  // A real-valued tensor as float, from F32, or from F16 and its scales. Throws an input error that
  // names file, tensor, the found and the wanted shape.
  std::vector<float> real_tensor(std::string_view name, const std::vector<std::size_t>& shape,
                                 std::size_t component_axis) const {
    return real_tensor(name, shape, component_axis, info_.storage);
  }
  // The same of a tensor that is stored in its own way: see storage_of.
  std::vector<float> real_tensor(std::string_view name, const std::vector<std::size_t>& shape,
                                 std::size_t component_axis, Storage storage) const;
  // How a real-valued tensor is stored, for codecs that keep some of theirs in float.
  Storage storage_of(std::string_view name) const;
  // An index tensor, of whichever of U8, U16, U32 it is stored as; every index is below `limit`.
  std::vector<std::uint32_t> index_tensor(std::string_view name,
                                          const std::vector<std::size_t>& shape,
                                          std::size_t limit) const;
  // Shape of a tensor, of what a blob holds if it is one; throws an input error if it is not there.
  std::vector<std::size_t> shape_of(std::string_view name) const;
  // An input error that names the file.
  [[noreturn]] void reject(const std::string& why) const;

  static bool looks_like(const std::filesystem::path& path);

 private:
  ModelFile(std::shared_ptr<const SafetensorsFile> file, ModelInfo info, std::string_view prefix);

  void read_mask();

  std::shared_ptr<const SafetensorsFile> file_;
  ModelInfo info_;
  std::string prefix_;  // of the names of its tensors
  std::shared_ptr<const Occlusion> occlusion_;
};

// Writes the model atomically; returns the bytes of the file.
std::size_t write_model(const std::filesystem::path& path, const Model& model);

// The bytes that write_model would write, without writing.
std::size_t model_file_size(const Model& model);

}  // namespace weft
