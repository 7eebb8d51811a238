#include "weft/io/mapped_btf.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "weft/error.hpp"

namespace weft {

MappedBtfSource::MappedBtfSource(std::shared_ptr<const MappedFile> file, std::size_t offset,
                                 BtfInfo info)
    : file_(std::move(file)), offset_(offset), info_(std::move(info)) {}

std::span<const std::byte> MappedBtfSource::images(std::size_t first, std::size_t count) const {
  const std::size_t total = info_.shape.images();
  if (first > total || count > total - first) {
    fail_input("{}: images [{}, {}) of {}", file_->path().string(), first, first + count, total);
  }
  return file_->bytes().subspan(offset_ + first * info_.image_bytes(), count * info_.image_bytes());
}

void MappedBtfSource::read(std::size_t first, std::size_t count, std::span<std::byte> out) {
  const std::span<const std::byte> from = images(first, count);
  if (out.size() != from.size()) {
    fail_input("{}: {} images take {} bytes, not {}", file_->path().string(), count, from.size(),
               out.size());
  }
  std::copy(from.begin(), from.end(), out.begin());
}

std::span<const std::byte> MappedBtfSource::mapped(std::size_t first, std::size_t count) {
  const std::span<const std::byte> values = images(first, count);
  const bool aligned = reinterpret_cast<std::uintptr_t>(values.data()) % size_of(info_.dtype) == 0;
  return aligned ? values : std::span<const std::byte>{};
}

void MappedBtfSource::prefetch(std::size_t first, std::size_t count) {
  file_->prefetch(offset_ + first * info_.image_bytes(), images(first, count).size());
}

void MappedBtfSource::release(std::size_t first, std::size_t count) {
  // Images seldom end where a page does. A page that this run shares with the images before it goes
  // too, or a long file would leave one page per run behind; what is needed again is read again.
  constexpr std::size_t largest_page = 65536;
  const std::size_t bytes = images(first, count).size();
  const std::size_t begin = offset_ + first * info_.image_bytes();
  const std::size_t shared = std::min(begin, begin % largest_page);
  file_->release(begin - shared, bytes + shared);
}

void check_next_images(const BtfInfo& info, std::size_t first, std::size_t count, std::size_t bytes,
                       std::size_t& written, std::string_view where) {
  const std::size_t total = info.shape.images();
  if (first != written || count > total - written) {
    fail_runtime("{}: images [{}, {}) of {} were written after {}", where, first, first + count,
                 total, written);
  }
  if (bytes != count * info.image_bytes()) {
    fail_runtime("{}: {} images take {} bytes, not {}", where, count, count * info.image_bytes(),
                 bytes);
  }
  written += count;
}

void check_all_images(const BtfInfo& info, std::size_t written, std::string_view where) {
  if (written != info.shape.images()) {
    fail_runtime("{}: only {} of {} images were written", where, written, info.shape.images());
  }
}

}  // namespace weft
