#include "support/image_files.hpp"

#include <cstdio>
// jpeglib.h needs FILE to be declared.
#include <jpeglib.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace weft::test {

std::vector<std::byte> make_jpeg(const ImageInfo& info, std::span<const std::byte> values,
                                 int quality, bool progressive) {
  jpeg_compress_struct encoder{};
  jpeg_error_mgr errors{};
  encoder.err = jpeg_std_error(&errors);
  jpeg_create_compress(&encoder);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&encoder, &bytes, &size);
  encoder.image_width = static_cast<JDIMENSION>(info.width);
  encoder.image_height = static_cast<JDIMENSION>(info.height);
  encoder.input_components = static_cast<int>(info.channels);
  encoder.in_color_space = info.channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
  jpeg_set_defaults(&encoder);
  jpeg_set_quality(&encoder, quality, TRUE);
  for (int c = 0; c < encoder.num_components; ++c) {
    encoder.comp_info[c].h_samp_factor = 1;
    encoder.comp_info[c].v_samp_factor = 1;
  }
  if (progressive) jpeg_simple_progression(&encoder);
  jpeg_start_compress(&encoder, TRUE);
  std::vector<JSAMPLE> row(info.width * info.channels);
  for (std::size_t y = 0; y < info.height; ++y) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      row[i] = std::to_integer<JSAMPLE>(values[y * row.size() + i]);
    }
    JSAMPROW pointer = row.data();
    jpeg_write_scanlines(&encoder, &pointer, 1);
  }
  jpeg_finish_compress(&encoder);
  jpeg_destroy_compress(&encoder);
  const auto* first = reinterpret_cast<const std::byte*>(bytes);
  std::vector<std::byte> file(first, first + size);
  std::free(bytes);
  return file;
}

std::vector<std::byte> file_bytes(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("can't be read: " + path.string());
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

void write_bytes(const std::filesystem::path& path, std::span<const std::byte> bytes) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  if (!file) throw std::runtime_error("can't be written: " + path.string());
}

void write_text(const std::filesystem::path& path, const std::string& text) {
  write_bytes(path, std::as_bytes(std::span(text)));
}

std::vector<std::byte> smooth_image(const ImageInfo& info, unsigned seed) {
  std::vector<std::byte> values(info.bytes());
  std::size_t i = 0;
  for (std::size_t y = 0; y < info.height; ++y) {
    for (std::size_t x = 0; x < info.width; ++x) {
      for (std::size_t c = 0; c < info.channels; ++c) {
        const double wave = std::sin(0.31 * static_cast<double>(x) + 0.7 * seed) +
                            std::cos(0.23 * static_cast<double>(y + c) + 1.3 * seed);
        values[i++] = static_cast<std::byte>(std::lround(127.5 + 60 * wave));
      }
    }
  }
  return values;
}

}  // namespace weft::test
