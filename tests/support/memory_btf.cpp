#include "support/memory_btf.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "support/generators.hpp"

namespace weft::test {

MemorySource::MemorySource(BtfInfo info, std::vector<std::byte> bytes, bool mapped)
    : info_(std::move(info)), bytes_(std::move(bytes)), is_mapped_(mapped) {
  if (bytes_.size() != info_.bytes()) throw std::logic_error("source: bytes do not fit the shape");
}

std::span<const std::byte> MemorySource::images(std::size_t first, std::size_t count) {
  const std::size_t total = info_.shape.images();
  if (first > total || count > total - first) throw std::logic_error("source: no such images");
  return std::span<const std::byte>(bytes_).subspan(first * info_.image_bytes(),
                                                    count * info_.image_bytes());
}

void MemorySource::read(std::size_t first, std::size_t count, std::span<std::byte> out) {
  const std::span<const std::byte> from = images(first, count);
  if (out.size() != from.size()) throw std::logic_error("source: room of the wrong size");
  std::copy(from.begin(), from.end(), out.begin());
  images_read_ += count;
  largest_read_ = std::max(largest_read_, count);
}

std::span<const std::byte> MemorySource::mapped(std::size_t first, std::size_t count) {
  if (!is_mapped_) return {};
  images_read_ += count;
  largest_read_ = std::max(largest_read_, count);
  return images(first, count);
}

void MemorySource::release(std::size_t first, std::size_t count) {
  images(first, count);
}

MemorySink::MemorySink(BtfInfo info) : info_(std::move(info)), bytes_(info_.bytes()) {}

void MemorySink::write(std::size_t first, std::size_t count, std::span<const std::byte> values) {
  if (first != next_image_) throw std::logic_error("sink: images out of order");
  if (count > info_.shape.images() - first) throw std::logic_error("sink: too many images");
  if (values.size() != count * info_.image_bytes()) {
    throw std::logic_error("sink: values of the wrong size");
  }
  std::copy(values.begin(), values.end(),
            bytes_.begin() + static_cast<std::ptrdiff_t>(first * info_.image_bytes()));
  next_image_ += count;
}

void MemorySink::finish() {
  if (next_image_ != info_.shape.images()) throw std::logic_error("sink: images are missing");
  finished_ = true;
}

std::vector<double> MemorySink::values() const {
  return decode_values(bytes_, info_.dtype);
}

std::shared_ptr<MemorySource> random_source(const BtfShape& shape, DType dtype, std::uint64_t seed,
                                            double low, double high) {
  return source_of(shape, dtype, random_values(shape.values(), seed, low, high));
}

std::shared_ptr<MemorySource> source_of(const BtfShape& shape, DType dtype,
                                        std::span<const double> values) {
  return std::make_shared<MemorySource>(make_info(shape, dtype), encode_values(values, dtype));
}

}  // namespace weft::test
