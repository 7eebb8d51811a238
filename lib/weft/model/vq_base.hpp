// Data bases of materials of codec vq that share their code-books (Havran et al. 2010, sections 4.3
// and 5.1): P1 to P4, M, C, I1 and I2 are there once, and each material has a planar index P6 of
// its own, with its directions and what else the metadata of a model say. See material_file.hpp.
//
// Code-vectors keep their place and their values when a material is added: what was there decodes
// to the same bits. Materials have in common: the grid and, where that is one of measured
// directions, these; the number of channels; the kind and the weights of the colour transform; f16
// or f32.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "weft/model/vq.hpp"

namespace weft {

struct VqMaterial {
  std::string name;
  VqModel index;  // the planar indices of its levels, and what there is to know of it
};

struct VqBase {
  VqModel books;  // without a planar index; info holds how they are stored
  std::vector<VqMaterial> materials;

  bool has(std::string_view name) const;
  // A material as a model of its own, with all code-vectors.
  std::unique_ptr<VqModel> model(std::size_t material) const;

  // A data base, or a model of codec vq as one of a material by the name of the file. Throws input
  // errors for what is wrong with it, or for materials that do not have in common what they must.
  static VqBase read(const std::filesystem::path& path);
};

// Throws an input error that begins with `where` unless a material of this description can be in
// the data base.
void check_shares(const VqBase& base, const ModelInfo& info, const VqGrid& grid,
                  std::size_t channels, std::string_view where);

// Writes it atomically; returns the bytes of the file, which the other foresees.
std::size_t write_vq_base(const std::filesystem::path& path, const VqBase& base);
std::size_t vq_base_size(const VqBase& base);

// Bytes of the tensors that materials share, and of those of each.
struct VqBaseBytes {
  std::size_t shared = 0;
  std::vector<std::size_t> own;
};
VqBaseBytes vq_base_bytes(const VqBase& base);

}  // namespace weft
