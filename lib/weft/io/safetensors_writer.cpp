#include <fmt/core.h>

#include <array>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/safetensors.hpp"
#include "weft/io/safetensors_header.hpp"

namespace weft {

std::size_t safetensors_file_size(std::vector<TensorInfo> tensors, Metadata metadata,
                                  std::size_t reserve) {
  const SafetensorsHeader header =
      plan_safetensors(std::move(tensors), std::move(metadata), "safetensors");
  std::size_t size =
      8 + padded_header_size(format_safetensors_header(header, "safetensors").size(), reserve);
  for (const TensorInfo& tensor : header.tensors) size += tensor.bytes();
  return size;
}

SafetensorsWriter::SafetensorsWriter(const std::filesystem::path& path,
                                     std::vector<TensorInfo> tensors, Metadata metadata,
                                     std::size_t reserve)
    : file_(path) {
  SafetensorsHeader header =
      plan_safetensors(std::move(tensors), std::move(metadata), path.string());
  const std::string text = format_safetensors_header(header, path.string());
  header_bytes_ = padded_header_size(text.size(), reserve);
  tensors_ = std::move(header.tensors);
  metadata_ = std::move(header.metadata);
  offsets_ = std::move(header.begins);
  for (std::size_t& offset : offsets_) offset += 8 + header_bytes_;
  written_.assign(tensors_.size(), 0);
}

std::size_t SafetensorsWriter::index_of(std::string_view tensor) const {
  for (std::size_t i = 0; i < tensors_.size(); ++i) {
    if (tensors_[i].name == tensor) return i;
  }
  fail_runtime("{}: tensor \"{}\" was not announced", file_.path().string(), shown(tensor));
}

void SafetensorsWriter::write(std::string_view tensor, std::size_t offset,
                              std::span<const std::byte> bytes) {
  const std::size_t index = index_of(tensor);
  const std::size_t size = tensors_[index].bytes();
  if (offset > size || bytes.size() > size - offset) {
    fail_runtime("{}: tensor \"{}\": bytes [{}, {}) of {}", file_.path().string(), shown(tensor),
                 offset, offset + bytes.size(), size);
  }
  file_.write_at(offsets_[index] + offset, bytes);
  written_[index] += bytes.size();
}

void SafetensorsWriter::set_metadata(const std::string& key, std::string value) {
  metadata_[key] = std::move(value);
}

void SafetensorsWriter::finish() {
  for (std::size_t i = 0; i < tensors_.size(); ++i) {
    if (written_[i] < tensors_[i].bytes()) {
      fail_runtime("{}: tensor \"{}\": only {} of {} bytes were written", file_.path().string(),
                   shown(tensors_[i].name), written_[i], tensors_[i].bytes());
    }
  }
  SafetensorsHeader header{metadata_, tensors_, offsets_};
  for (std::size_t& begin : header.begins) begin -= 8 + header_bytes_;
  std::string text = format_safetensors_header(header, file_.path().string());
  if (text.size() > header_bytes_) {
    fail_runtime("{}: header takes {} bytes, room was kept for {}", file_.path().string(),
                 text.size(), header_bytes_);
  }
  text.resize(header_bytes_, ' ');
  std::array<std::byte, 8> length;
  for (std::size_t i = 0; i < length.size(); ++i) {
    length[i] = static_cast<std::byte>(header_bytes_ >> (8 * i) & 0xff);
  }
  file_.write_at(0, length);
  file_.write_at(length.size(), std::as_bytes(std::span(text)));
  file_.commit();
}

std::size_t SafetensorsWriter::file_size() const {
  return tensors_.empty() ? 8 + header_bytes_ : offsets_.back() + tensors_.back().bytes();
}

}  // namespace weft
