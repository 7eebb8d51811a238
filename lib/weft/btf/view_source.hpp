// The images of one view of a source as a source of their own, in runs as the whole hands them out.
#pragma once

#include <cstddef>
#include <span>

#include "weft/btf/tile.hpp"

namespace weft {

class ViewSource final : public TileSource {
 public:
  // `whole` must outlive it.
  ViewSource(TileSource& whole, std::size_t view);

  const BtfInfo& info() const override { return info_; }
  std::span<const float> texel_scale() const override { return whole_.texel_scale(); }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override;
  std::span<const std::byte> mapped(std::size_t first, std::size_t count) override;
  void prefetch(std::size_t first, std::size_t count) override;
  void release(std::size_t first, std::size_t count) override;

 private:
  TileSource& whole_;
  std::size_t first_;
  BtfInfo info_;
};

}  // namespace weft
