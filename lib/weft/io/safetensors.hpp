// The safetensors container: 8-byte little-endian header length, JSON header, tensor data.
//
//   [ u64 H ][ header: H bytes of JSON, padded with spaces ][ tensor 0 | tensor 1 | ... ]
//
// As the public format asks: offsets are relative to the end of the header; tensors follow each
// other without gaps or overlaps and the last ends the file; __metadata__ holds strings only. Ours
// are ordered by descending element size and the data begins at a multiple of 64 bytes, so every
// tensor is aligned. Readers of foreign files accept any order and any alignment.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "weft/io/atomic_file.hpp"
#include "weft/io/mapped_file.hpp"
#include "weft/tensor/dtype.hpp"

namespace weft {

using Metadata = std::map<std::string, std::string>;

struct TensorInfo {
  std::string name;
  DType dtype = DType::u8;
  std::vector<std::size_t> shape;

  // Number of elements; 1 for a scalar (empty shape). Only meaningful after validation: the product
  // of a hostile shape may overflow.
  std::size_t elements() const;
  std::size_t bytes() const { return elements() * size_of(dtype); }
};

// "[2, 3]" for messages; shortened where it is long.
std::string shape_text(const std::vector<std::size_t>& shape);

// A safetensors file opened for reading; values stay in the mapping. The constructor checks the
// whole header: length within the file and at most 100 MiB, valid JSON, known dtypes, shapes whose
// product does not overflow and equals the byte range, ranges within the file, no gaps, no
// overlaps, nothing after the last, metadata of strings only, no duplicate names. What is wrong is
// an input error that names the file, the tensor and the value. Nothing is allocated in proportion
// to a claimed size.
class SafetensorsFile {
 public:
  explicit SafetensorsFile(const std::filesystem::path& path);

  // A part of the file as a file of its own, whose metadata are given, with the tensors that
  // name_in_part gives a name. Messages call it `path`.
  SafetensorsFile part(
      std::filesystem::path path, Metadata metadata,
      const std::function<std::optional<std::string>(std::string_view name)>& name_in_part) const;

  const std::filesystem::path& path() const { return path_; }
  const Metadata& metadata() const { return metadata_; }
  // In order of their offsets.
  const std::vector<TensorInfo>& tensors() const { return tensors_; }

  // nullptr if there is none of that name.
  const TensorInfo* find(std::string_view name) const;
  // Throws an input error naming file and tensor if there is none.
  const TensorInfo& get(std::string_view name) const;
  // The tensor's bytes in the mapping. May be unaligned in foreign files.
  std::span<const std::byte> data(const TensorInfo& tensor) const;
  // Where the tensor's data begins in the file.
  std::size_t offset(const TensorInfo& tensor) const;
  // Metadata value; empty string_view if absent. `require` throws an input error instead.
  std::string_view value(const std::string& key) const;
  std::string_view require(const std::string& key) const;

  const MappedFile& file() const { return *file_; }
  // True if the first bytes look like a safetensors header.
  static bool looks_like(const std::filesystem::path& path);

 private:
  SafetensorsFile() = default;

  std::shared_ptr<const MappedFile> file_;
  std::filesystem::path path_;
  Metadata metadata_;
  std::vector<TensorInfo> tensors_;
  std::vector<std::size_t> offsets_;
};

// Writes a safetensors file atomically. All tensors are announced first; their bytes may then come
// in any order and in pieces. Metadata may change until finish(), within the room that was kept.
class SafetensorsWriter {
 public:
  // `reserve`: bytes kept in the header for metadata that is not known yet. The tensors are ordered
  // by descending element size, keeping their order otherwise.
  SafetensorsWriter(const std::filesystem::path& path, std::vector<TensorInfo> tensors,
                    Metadata metadata, std::size_t reserve = 0);

  // Writes bytes of one tensor from `offset` on.
  void write(std::string_view tensor, std::size_t offset, std::span<const std::byte> bytes);
  void set_metadata(const std::string& key, std::string value);
  // Checks that as many bytes came as each tensor has, writes the header, and commits.
  void finish();

  // Size of the finished file in bytes.
  std::size_t file_size() const;

 private:
  std::size_t index_of(std::string_view tensor) const;

  AtomicFile file_;
  std::vector<TensorInfo> tensors_;
  std::vector<std::size_t> offsets_;  // from the start of the file
  std::vector<std::size_t> written_;  // bytes that came so far
  Metadata metadata_;
  std::size_t header_bytes_ = 0;  // without the 8 bytes of its length
};

// The bytes that a file with these tensors and this metadata takes.
std::size_t safetensors_file_size(std::vector<TensorInfo> tensors, Metadata metadata,
                                  std::size_t reserve = 0);

}  // namespace weft
