#include "tradeoff/pictures.hpp"

#include <algorithm>
#include <cstring>

#include "weft/error.hpp"
#include "weft/io/contact_sheet.hpp"
#include "weft/io/image_formats.hpp"

namespace weft {
namespace {

constexpr int best_compression = 9;

// Tiles of `width` x `height` whose left upper corners are at (x(k), y).
template <typename Left>
PixelImage gather(const PixelImage& from, std::size_t count, Left left, std::size_t top,
                  std::size_t width, std::size_t height, const StripSize& size) {
  const std::size_t tiles = std::min(count, size.tiles);
  const std::size_t w = std::min(width, size.side);
  const std::size_t h = std::min(height, size.side);
  const std::size_t x0 = (width - w) / 2;
  const std::size_t y0 = top + (height - h) / 2;
  const std::size_t channels = from.info.channels;
  PixelImage strip{{h, tiles * w, channels, DType::u8}, {}};
  strip.pixels.resize(strip.info.bytes());
  for (std::size_t y = 0; y < h; ++y) {
    for (std::size_t k = 0; k < tiles; ++k) {
      const std::size_t source = ((y0 + y) * from.info.width + left(k) + x0) * channels;
      std::memcpy(strip.pixels.data() + (y * tiles + k) * w * channels, from.pixels.data() + source,
                  w * channels);
    }
  }
  return strip;
}

}  // namespace

PixelImage read_pixels(const std::filesystem::path& path) {
  PixelImage image{image_info(path), {}};
  if (image.info.dtype != DType::u8) fail_input("{}: not of 8 bits per channel", path.string());
  image.pixels.resize(image.info.bytes());
  read_image(path, image.info, image.pixels);
  return image;
}

void write_pixels(const std::filesystem::path& path, const PixelImage& image) {
  write_png(path, image.info, image.pixels, best_compression);
}

PixelImage cut_strip(const PixelImage& sheet, std::size_t row, std::size_t count, std::size_t width,
                     std::size_t height, const StripSize& size) {
  const std::size_t spacing = ContactSheetOptions{}.spacing;
  const std::size_t top = spacing + row * (height + spacing);
  if (sheet.info.width != spacing + count * (width + spacing) ||
      sheet.info.height < top + height + spacing) {
    fail_runtime("a contact sheet of {} images of {} x {} has {} x {} pixels", count, width, height,
                 sheet.info.width, sheet.info.height);
  }
  return gather(
      sheet, count, [&](std::size_t k) { return spacing + k * (width + spacing); }, top, width,
      height, size);
}

PixelImage reduce_strip(const PixelImage& strip, std::size_t count, const StripSize& size) {
  const std::size_t width = strip.info.width / std::max<std::size_t>(count, 1);
  return gather(
      strip, count, [&](std::size_t k) { return k * width; }, 0, width, strip.info.height, size);
}

PixelImage halve(const PixelImage& image) {
  const std::size_t channels = image.info.channels;
  PixelImage half{{image.info.height / 2, image.info.width / 2, channels, DType::u8}, {}};
  half.pixels.resize(half.info.bytes());
  const auto at = [&](std::size_t y, std::size_t x, std::size_t c) {
    return std::to_integer<unsigned>(image.pixels[(y * image.info.width + x) * channels + c]);
  };
  std::size_t i = 0;
  for (std::size_t y = 0; y < half.info.height; ++y) {
    for (std::size_t x = 0; x < half.info.width; ++x) {
      for (std::size_t c = 0; c < channels; ++c) {
        const unsigned sum = at(2 * y, 2 * x, c) + at(2 * y, 2 * x + 1, c) +
                             at(2 * y + 1, 2 * x, c) + at(2 * y + 1, 2 * x + 1, c);
        half.pixels[i++] = static_cast<std::byte>((sum + 2) / 4);
      }
    }
  }
  return half;
}

std::string base64(std::span<const std::byte> bytes) {
  constexpr char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    unsigned word = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      word = word << 8 | (k < count ? std::to_integer<unsigned>(bytes[i + k]) : 0U);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      text += k <= count ? digits[word >> (18 - 6 * k) & 63U] : '=';
    }
  }
  return text;
}

std::string data_url(const PixelImage& image) {
  return "data:image/png;base64," +
         base64(formats::encode_png("picture", image.info, image.pixels, best_compression));
}

}  // namespace weft
