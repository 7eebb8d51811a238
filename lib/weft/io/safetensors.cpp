#include "weft/io/safetensors.hpp"

#include <algorithm>
#include <array>
#include <fstream>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/safetensors_header.hpp"

namespace weft {
namespace {

constexpr std::size_t length_bytes = 8;

std::uint64_t read_length(const std::byte* bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = length_bytes; i-- > 0;) {
    value = value << 8 | std::to_integer<std::uint64_t>(bytes[i]);
  }
  return value;
}

}  // namespace

std::size_t TensorInfo::elements() const {
  std::size_t count = 1;
  for (const std::size_t size : shape) count *= size;
  return count;
}

std::string shape_text(const std::vector<std::size_t>& shape) {
  std::string text;
  for (std::size_t i = 0; i < std::min<std::size_t>(shape.size(), 8); ++i) {
    text += fmt::format("{}{}", i == 0 ? "" : ", ", shape[i]);
  }
  return fmt::format("[{}{}]", text, shape.size() > 8 ? ", ..." : "");
}

SafetensorsFile::SafetensorsFile(const std::filesystem::path& path)
    : file_(std::make_shared<MappedFile>(path)), path_(path) {
  const std::string where = path.string();
  const std::span<const std::byte> bytes = file_->bytes();
  if (bytes.size() < length_bytes + 2) {
    fail_input("{}: {} bytes are too few for a safetensors file", where, bytes.size());
  }
  // Compared so that no claimed length overflows.
  const std::uint64_t header_bytes = read_length(bytes.data());
  if (header_bytes > max_safetensors_header) {
    fail_input("{}: not a safetensors file: header length {} is over the limit of {}", where,
               header_bytes, max_safetensors_header);
  }
  if (header_bytes > bytes.size() - length_bytes) {
    fail_input(
        "{}: header length {} passes the end of the file, {} bytes: truncated or not a "
        "safetensors file",
        where, header_bytes, bytes.size());
  }
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()) + length_bytes,
                              header_bytes);
  const std::size_t data_begin = length_bytes + header_bytes;
  SafetensorsHeader header = parse_safetensors_header(text, bytes.size() - data_begin, where);
  metadata_ = std::move(header.metadata);
  tensors_ = std::move(header.tensors);
  offsets_ = std::move(header.begins);
  for (std::size_t& offset : offsets_) offset += data_begin;
}

SafetensorsFile SafetensorsFile::part(
    std::filesystem::path path, Metadata metadata,
    const std::function<std::optional<std::string>(std::string_view name)>& name_in_part) const {
  SafetensorsFile part;
  part.file_ = file_;
  part.path_ = std::move(path);
  part.metadata_ = std::move(metadata);
  for (std::size_t i = 0; i < tensors_.size(); ++i) {
    std::optional<std::string> name = name_in_part(tensors_[i].name);
    if (!name) continue;
    part.tensors_.push_back({std::move(*name), tensors_[i].dtype, tensors_[i].shape});
    part.offsets_.push_back(offsets_[i]);
  }
  return part;
}

const TensorInfo* SafetensorsFile::find(std::string_view name) const {
  for (const TensorInfo& tensor : tensors_) {
    if (tensor.name == name) return &tensor;
  }
  return nullptr;
}

const TensorInfo& SafetensorsFile::get(std::string_view name) const {
  const TensorInfo* tensor = find(name);
  if (tensor == nullptr) fail_input("{}: no tensor \"{}\"", path().string(), name);
  return *tensor;
}

std::span<const std::byte> SafetensorsFile::data(const TensorInfo& tensor) const {
  return file_->bytes().subspan(offset(tensor), tensor.bytes());
}

std::size_t SafetensorsFile::offset(const TensorInfo& tensor) const {
  const TensorInfo& own = get(tensor.name);
  return offsets_[static_cast<std::size_t>(&own - tensors_.data())];
}

std::string_view SafetensorsFile::value(const std::string& key) const {
  const auto found = metadata_.find(key);
  return found == metadata_.end() ? std::string_view{} : std::string_view{found->second};
}

std::string_view SafetensorsFile::require(const std::string& key) const {
  const auto found = metadata_.find(key);
  if (found == metadata_.end()) fail_input("{}: no metadata \"{}\"", path().string(), key);
  return found->second;
}

bool SafetensorsFile::looks_like(const std::filesystem::path& path) {
  std::array<char, length_bytes + 1> first{};
  std::ifstream stream(path, std::ios::binary);
  if (!stream.read(first.data(), first.size())) return false;
  const std::uint64_t header_bytes = read_length(reinterpret_cast<const std::byte*>(first.data()));
  return header_bytes >= 2 && header_bytes <= max_safetensors_header && first.back() == '{';
}

}  // namespace weft
