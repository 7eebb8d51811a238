#include "weft/btf/texel_block.hpp"

#include <algorithm>
#include <vector>

#include "weft/error.hpp"

namespace weft {

void read_image_texels(TileSource& source, std::size_t image, std::size_t first, std::size_t count,
                       std::vector<std::byte>& whole, std::span<std::byte> out) {
  const BtfInfo& info = source.info();
  const std::size_t texel_bytes = info.shape.channels * size_of(info.dtype);
  if (first > info.shape.texels() || count > info.shape.texels() - first ||
      out.size() != count * texel_bytes) {
    fail_input("texels [{}, {}) of {}, {} bytes of them", first, first + count, info.shape.texels(),
               out.size());
  }
  std::span<const std::byte> values = source.mapped(image, 1);
  if (values.empty()) {
    if (source.read_part(image, first, count, out)) return;
    whole.resize(info.image_bytes());
    source.read(image, 1, whole);
    values = whole;
  }
  const auto texels = values.subspan(first * texel_bytes, out.size());
  std::copy(texels.begin(), texels.end(), out.begin());
}

void read_texels(TileSource& source, std::size_t first, std::size_t count,
                 std::span<std::byte> out) {
  const BtfInfo& info = source.info();
  const BtfShape& shape = info.shape;
  const std::size_t texel_bytes = shape.channels * size_of(info.dtype);
  if (first > shape.texels() || count > shape.texels() - first ||
      out.size() != shape.images() * count * texel_bytes) {
    fail_input("texels [{}, {}) of {}, {} bytes of them", first, first + count, shape.texels(),
               out.size());
  }
  constexpr std::size_t run = 64;  // images that are released together
  std::vector<std::byte> whole;
  for (std::size_t image = 0; image < shape.images(); ++image) {
    read_image_texels(source, image, first, count, whole,
                      out.subspan(image * count * texel_bytes, count * texel_bytes));
    const std::size_t done = image % run + 1;
    if (done == run || image + 1 == shape.images()) source.release(image + 1 - done, done);
  }
}

std::size_t texel_granule(const BtfShape& shape) {
  constexpr std::size_t working_set = std::size_t{8} << 20;
  constexpr std::size_t whole_vectors = 64;
  const std::size_t fitting =
      working_set / (shape.images() * shape.channels * sizeof(float)) / whole_vectors;
  return std::min(std::max<std::size_t>(fitting, 1) * whole_vectors, shape.texels());
}

}  // namespace weft
