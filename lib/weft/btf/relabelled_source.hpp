// A BTF whose bytes are those of another and which says something else of them: without its mask,
// in another encoding, or with channels as texels.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <utility>

#include "weft/btf/tile.hpp"

namespace weft {

class RelabelledSource final : public TileSource {
 public:
  // Images of `info` are as many and as long as those of `source`.
  RelabelledSource(std::shared_ptr<TileSource> source, BtfInfo info)
      : source_(std::move(source)),
        info_(std::move(info)),
        same_texels_(info_.shape.texels() == source_->info().shape.texels()) {}
  // `source` must outlive it.
  RelabelledSource(TileSource& source, BtfInfo info)
      : RelabelledSource(std::shared_ptr<TileSource>(std::shared_ptr<void>(), &source),
                         std::move(info)) {}

  const BtfInfo& info() const override { return info_; }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    source_->read(first, count, out);
  }
  // None where texels are others.
  std::span<const float> texel_scale() const override {
    return same_texels_ ? source_->texel_scale() : std::span<const float>();
  }
  std::span<const std::byte> mapped(std::size_t first, std::size_t count) override {
    return source_->mapped(first, count);
  }
  bool read_part(std::size_t image, std::size_t first, std::size_t count,
                 std::span<std::byte> out) override {
    return same_texels_ && source_->read_part(image, first, count, out);
  }
  void prefetch(std::size_t first, std::size_t count) override { source_->prefetch(first, count); }
  void release(std::size_t first, std::size_t count) override { source_->release(first, count); }

 private:
  std::shared_ptr<TileSource> source_;
  BtfInfo info_;
  bool same_texels_;
};

}  // namespace weft
