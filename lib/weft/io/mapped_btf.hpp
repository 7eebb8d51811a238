// A BTF whose values lie in one piece of a mapped file, as in both raw forms.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/btf/tile.hpp"
#include "weft/io/mapped_file.hpp"

namespace weft {

class MappedBtfSource final : public TileSource {
 public:
  // The file holds info.bytes() bytes from `offset` on; both were checked.
  MappedBtfSource(std::shared_ptr<const MappedFile> file, std::size_t offset, BtfInfo info);

  const BtfInfo& info() const override { return info_; }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override;
  // Empty where the file does not hold the values aligned to their size.
  std::span<const std::byte> mapped(std::size_t first, std::size_t count) override;
  void prefetch(std::size_t first, std::size_t count) override;
  void release(std::size_t first, std::size_t count) override;

 private:
  std::span<const std::byte> images(std::size_t first, std::size_t count) const;

  std::shared_ptr<const MappedFile> file_;
  std::size_t offset_;
  BtfInfo info_;
};

// Keeps a sink's images in order: throws unless images [first, first + count) of `bytes` bytes
// follow the `written` ones, and counts them.
void check_next_images(const BtfInfo& info, std::size_t first, std::size_t count, std::size_t bytes,
                       std::size_t& written, std::string_view where);

// Throws unless all images were written.
void check_all_images(const BtfInfo& info, std::size_t written, std::string_view where);

}  // namespace weft
