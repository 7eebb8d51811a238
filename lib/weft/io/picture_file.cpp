#include "weft/io/picture_file.hpp"

#include <vector>

#include "weft/btf/encoding.hpp"
#include "weft/error.hpp"
#include "weft/io/atomic_file.hpp"
#include "weft/io/image_formats.hpp"

namespace weft {
namespace {

void write_whole(const std::filesystem::path& path, std::span<const std::byte> bytes) {
  AtomicFile file(path);
  file.write(bytes);
  file.commit();
}

}  // namespace

ImageFormat picture_format(const std::filesystem::path& path, std::string_view option) {
  if (path.extension() == ".png") return ImageFormat::png;
  if (path.extension() == ".exr") return ImageFormat::exr;
  fail_input("{}: '{}' ends in none of .png, .exr", option, path.string());
}

void write_picture(const std::filesystem::path& path, const Picture& picture,
                   const ToneMapping& tone) {
  if (picture_format(path, "picture") == ImageFormat::png) {
    write_display_values(path, picture.width, picture.height, display_values(picture, tone));
    return;
  }
  std::vector<float> light;
  light.reserve(picture.pixels.size() * 3);
  for (const std::array<float, 4>& pixel : picture.pixels) {
    light.insert(light.end(), pixel.begin(), pixel.begin() + 3);
  }
  const ImageInfo info{picture.height, picture.width, 3, DType::f32};
  write_whole(path, formats::encode_exr(path.string(), info, std::as_bytes(std::span(light)),
                                        ExrCompression::zip, {}));
}

void write_display_values(const std::filesystem::path& path, std::size_t width, std::size_t height,
                          std::span<const double> values) {
  std::vector<std::byte> pixels(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) pixels[i] = std::byte{nearest_byte(values[i])};
  const ImageInfo info{height, width, 3, DType::u8};
  write_whole(path, formats::encode_png(path.string(), info, pixels, 6));
}

}  // namespace weft
