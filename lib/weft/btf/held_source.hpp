// The images of a source computed once and kept, for jobs that read them several times and in
// blocks of texels: in memory, or in a temporary file that is mapped.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "weft/btf/tile.hpp"
#include "weft/tensor/float_store.hpp"

namespace weft {

class HeldSource final : public TileSource {
 public:
  // Reads all of `source`, of F32, which must outlive it.
  HeldSource(TileSource& source, FloatStore::Place place);

  const BtfInfo& info() const override { return source_.info(); }
  std::span<const float> texel_scale() const override { return source_.texel_scale(); }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override;
  std::span<const std::byte> mapped(std::size_t first, std::size_t count) override;

 private:
  TileSource& source_;
  FloatStore values_;
};

}  // namespace weft
