#include "weft/btf/held_source.hpp"

#include <algorithm>

#include "weft/error.hpp"

namespace weft {

HeldSource::HeldSource(TileSource& source, FloatStore::Place place)
    : source_(source), values_(source.info().shape.values(), place) {
  const BtfShape& shape = source.info().shape;
  if (source.info().dtype != DType::f32) fail_runtime("held source: values are not F32");
  for (std::size_t i = 0; i < shape.images(); ++i) {
    check_interrupt();
    source.read(i, 1,
                std::as_writable_bytes(
                    std::span(values_).subspan(i * shape.image_values(), shape.image_values())));
    source.release(i, 1);
  }
}

void HeldSource::read(std::size_t first, std::size_t count, std::span<std::byte> out) {
  const std::span<const std::byte> values = mapped(first, count);
  std::copy(values.begin(), values.end(), out.begin());
}

std::span<const std::byte> HeldSource::mapped(std::size_t first, std::size_t count) {
  const std::size_t image = info().shape.image_values();
  return std::as_bytes(std::span<const float>(values_).subspan(first * image, count * image));
}

}  // namespace weft
