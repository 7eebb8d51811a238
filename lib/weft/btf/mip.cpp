#include "weft/btf/mip.hpp"

#include <algorithm>

namespace weft {

std::size_t mip_side(std::size_t side, std::size_t level) {
  for (std::size_t i = 0; i < level && side > 1; ++i) side = side / 2 + side % 2;
  return side;
}

std::size_t last_mip_level(std::size_t height, std::size_t width) {
  std::size_t level = 0;
  while (mip_side(std::max(height, width), level) > 1) ++level;
  return level;
}

std::size_t average_mip(std::vector<float>& values, std::size_t height, std::size_t width,
                        std::size_t channels, std::size_t level) {
  for (; level > 0; --level) {
    const std::size_t rows = mip_side(height, 1);
    const std::size_t columns = mip_side(width, 1);
    // The target lies before or at the first of its sources, so the average can stay in place.
    for (std::size_t y = 0; y < rows; ++y) {
      const std::size_t y_end = std::min(2 * y + 2, height);
      for (std::size_t x = 0; x < columns; ++x) {
        const std::size_t x_end = std::min(2 * x + 2, width);
        const auto count = static_cast<double>((y_end - 2 * y) * (x_end - 2 * x));
        for (std::size_t c = 0; c < channels; ++c) {
          double sum = 0;
          for (std::size_t from_y = 2 * y; from_y < y_end; ++from_y) {
            for (std::size_t from_x = 2 * x; from_x < x_end; ++from_x) {
              sum += static_cast<double>(values[(from_y * width + from_x) * channels + c]);
            }
          }
          values[(y * columns + x) * channels + c] = static_cast<float>(sum / count);
        }
      }
    }
    height = rows;
    width = columns;
  }
  return height * width * channels;
}

void reduce_to_mip(Representation representation, std::size_t height, std::size_t width,
                   std::size_t channels, std::size_t level, std::span<const std::byte> image,
                   std::span<std::byte> out, std::string_view where) {
  const Representation linear{DType::f32, Encoding::linear};
  std::vector<float> values(height * width * channels);
  convert_values(representation, image, linear, std::as_writable_bytes(std::span(values)), where);
  values.resize(average_mip(values, height, width, channels, level));
  convert_values(linear, std::as_bytes(std::span(values)), representation, out, where);
}

}  // namespace weft
