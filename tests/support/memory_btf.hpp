// BTFs in memory as source and sink of a job.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/tile.hpp"

namespace weft::test {

class MemorySource final : public TileSource {
 public:
  // `bytes` is the whole tensor in info's dtype. With `mapped`, runs of images are handed out where
  // they lie, as by a mapped file.
  MemorySource(BtfInfo info, std::vector<std::byte> bytes, bool mapped = false);

  const BtfInfo& info() const override { return info_; }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override;
  std::span<const std::byte> mapped(std::size_t first, std::size_t count) override;
  void release(std::size_t first, std::size_t count) override;

  std::span<const std::byte> bytes() const { return bytes_; }
  // Images read so far, and the most in one call: what a job's memory bound led to.
  std::size_t images_read() const { return images_read_; }
  std::size_t largest_read() const { return largest_read_; }

 private:
  std::span<const std::byte> images(std::size_t first, std::size_t count);

  BtfInfo info_;
  std::vector<std::byte> bytes_;
  bool is_mapped_;
  std::size_t images_read_ = 0;
  std::size_t largest_read_ = 0;
};

class MemorySink final : public TileSink {
 public:
  explicit MemorySink(BtfInfo info);

  const BtfInfo& info() const override { return info_; }
  // Throws std::logic_error for images out of order or values of the wrong size.
  void write(std::size_t first, std::size_t count, std::span<const std::byte> values) override;
  // Throws std::logic_error if images are missing.
  void finish() override;

  bool finished() const { return finished_; }
  std::span<const std::byte> bytes() const { return bytes_; }
  // As numbers; 8-bit values in [0, 1].
  std::vector<double> values() const;

 private:
  BtfInfo info_;
  std::vector<std::byte> bytes_;
  std::size_t next_image_ = 0;
  bool finished_ = false;
};

// A source of values uniform in [low, high).
std::shared_ptr<MemorySource> random_source(const BtfShape& shape, DType dtype, std::uint64_t seed,
                                            double low = 0.0, double high = 1.0);
// A source of the given values, [V][L][Y][X][C].
std::shared_ptr<MemorySource> source_of(const BtfShape& shape, DType dtype,
                                        std::span<const double> values);

}  // namespace weft::test
