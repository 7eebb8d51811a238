// Models as the parts of one file: a model and that of its mask, or the materials of a data base
// and what they share.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "weft/io/safetensors.hpp"
#include "weft/model/model.hpp"

namespace weft {

struct FilePart {
  const Model* model = nullptr;
  std::string prefix;                          // of the names of its tensors
  bool with_directions = false;                // and mask, as tensors beside the model's
  std::shared_ptr<const Occlusion> occlusion;  // what the model belongs to, if it is one of a mask
};

// Writes the parts atomically, with these metadata; those that say how tensors are coded, the
// checksums and as new a format as these take are added. Returns the bytes of the file.
std::size_t write_parts(const std::filesystem::path& path, std::span<const FilePart> parts,
                        Metadata metadata);

// The bytes that it would write, without writing; and those of one part's tensors.
std::size_t parts_size(std::span<const FilePart> parts, Metadata metadata);
std::size_t part_bytes(const FilePart& part);

}  // namespace weft
