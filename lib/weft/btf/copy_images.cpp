#include "weft/btf/copy_images.hpp"

#include <algorithm>
#include <cstring>
#include <vector>

#include "weft/btf/encoding.hpp"
#include "weft/error.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

constexpr std::size_t tile_bytes = std::size_t{64} << 20;
// Images read at a time, so that a slow source shows that it moves.
constexpr std::size_t step = 16;

// Clamps floats that lie in bytes to +-limit.
void clamp_floats(std::span<std::byte> values, float limit) {
  for (std::size_t i = 0; i < values.size(); i += sizeof(float)) {
    float value = 0;
    std::memcpy(&value, values.data() + i, sizeof value);
    value = std::clamp(value, -limit, limit);
    std::memcpy(values.data() + i, &value, sizeof value);
  }
}

std::size_t images_of_a_run(const BtfInfo& info) {
  return std::clamp<std::size_t>(tile_bytes / info.image_bytes(), 1, info.shape.images());
}

}  // namespace

std::size_t copy_images_bytes(const BtfInfo& info) {
  return images_of_a_run(info) * info.image_bytes();
}

void check_same_shape(const BtfShape& from, const BtfShape& to) {
  if (from == to) return;
  fail_input(
      "a tensor [V,L,Y,X,C] of [{},{},{},{},{}] can't be written where [{},{},{},{},{}] is "
      "expected",
      from.views, from.lights, from.height, from.width, from.channels, to.views, to.lights,
      to.height, to.width, to.channels);
}

void copy_images(TileSource& source, TileSink& sink,
                 const std::function<void(std::size_t done)>& progress) {
  const BtfInfo& input = source.info();
  const BtfInfo& output = sink.info();
  check_same_shape(input.shape, output.shape);
  const Representation from{input.dtype, input.encoding};
  const Representation to{output.dtype, output.encoding};
  // The stored value whose light is the largest half.
  const auto limit = static_cast<float>(
      encode_from_linear(input.encoding, decode_to_linear(output.encoding, double{half_max})));
  const bool clamped = input.dtype == DType::f32 && output.dtype == DType::f16;
  const std::size_t images = input.shape.images();
  const std::size_t run = images_of_a_run(input);
  std::vector<std::byte> copied;
  std::vector<std::byte> rewritten;
  for (std::size_t first = 0; first < images; first += run) {
    check_interrupt();
    const std::size_t count = std::min(run, images - first);
    std::span<const std::byte> values =
        clamped ? std::span<const std::byte>{} : source.mapped(first, count);
    if (values.empty()) {
      copied.resize(count * input.image_bytes());
      for (std::size_t i = 0; i < count; i += step) {
        check_interrupt();
        const std::size_t part = std::min(step, count - i);
        source.read(first + i, part,
                    std::span(copied).subspan(i * input.image_bytes(), part * input.image_bytes()));
        progress(first + i + part);
      }
      if (clamped) clamp_floats(copied, limit);
      values = copied;
    }
    if (from != to) {
      rewritten.resize(count * output.image_bytes());
      convert_values(from, values, to, rewritten, "the output");
      values = rewritten;
    }
    sink.write(first, count, values);
    source.release(first, count);
    progress(first + count);
  }
  sink.finish();
}

}  // namespace weft
