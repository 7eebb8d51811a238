// The metadata of a model file, both ways.
#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "weft/io/safetensors.hpp"
#include "weft/model/model.hpp"

namespace weft {

// Checksum of every tensor by name: 16 hex digits.
using Checksums = std::map<std::string, std::string>;

// XXH3-64 over bytes as they are stored.
std::string checksum_of(std::span<const std::byte> bytes);

// The same of bytes that come in parts.
class Checksum {
 public:
  Checksum();
  ~Checksum();
  Checksum(const Checksum&) = delete;
  Checksum& operator=(const Checksum&) = delete;
  void add(std::span<const std::byte> bytes);
  std::string text() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// Throws an input error that names `where` if a field can't be written.
Metadata model_metadata(const ModelInfo& info, const std::string& where);
std::string checksums_json(const Checksums& checksums);

// Reads and checks everything that the metadata says, with directions, but without mask.
ModelInfo read_model_info(const SafetensorsFile& file);
Checksums read_checksums(const SafetensorsFile& file);

}  // namespace weft
