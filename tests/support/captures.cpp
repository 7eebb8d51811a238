#include "support/captures.hpp"

#include <zip.h>

#include <stdexcept>

#include "support/image_files.hpp"
#include "support/temporary_folder.hpp"

namespace weft::test {

std::vector<std::byte> bytes_of_text(const std::string& text) {
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

std::vector<std::byte> smooth_png(const ImageInfo& info, unsigned seed) {
  const TemporaryFolder folder;
  write_png(folder / "a.png", info, smooth_image(info, seed));
  return file_bytes(folder / "a.png");
}

void write_folder(const std::filesystem::path& folder, const Files& files) {
  for (const auto& [name, content] : files) write_bytes(folder / name, content);
}

void write_zip(const std::filesystem::path& path, const Files& files, bool deflate) {
  int code = 0;
  zip_t* archive = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code);
  if (!archive) throw std::runtime_error("can't be created: " + path.string());
  for (const auto& [name, content] : files) {
    zip_source_t* source = zip_source_buffer(archive, content.data(), content.size(), 0);
    const zip_int64_t index = zip_file_add(archive, name.c_str(), source, ZIP_FL_ENC_UTF_8);
    if (index < 0) throw std::runtime_error("can't be added: " + name);
    zip_set_file_compression(archive, static_cast<zip_uint64_t>(index),
                             deflate ? ZIP_CM_DEFLATE : ZIP_CM_STORE, 0);
  }
  if (zip_close(archive) != 0) throw std::runtime_error("can't be written: " + path.string());
}

std::vector<std::byte> read_all(TileSource& source) {
  std::vector<std::byte> values(source.info().bytes());
  source.read(0, source.info().shape.images(), values);
  return values;
}

}  // namespace weft::test
