#include "weft/io/image.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstring>

#include "weft/error.hpp"
#include "weft/io/image_formats.hpp"
#include "weft/io/mapped_file.hpp"

namespace weft {
namespace {

std::string describe(const ImageInfo& info) {
  return fmt::format("{} x {} with {} channel{} of {}", info.width, info.height, info.channels,
                     info.channels == 1 ? "" : "s", name_of(info.dtype));
}

// Writes a whole file; what is left of a failed one is removed.
void write_file(const std::filesystem::path& path, std::span<const std::byte> bytes) {
  const int descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor < 0) {
    fail_runtime("{}: can't be created: {}", path.string(), std::strerror(errno));
  }
  int error = 0;
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor, bytes.data(), bytes.size());
    if (written < 0) {
      if (errno == EINTR) continue;
      error = errno;
      break;
    }
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  struct stat status {};
  const bool regular = ::fstat(descriptor, &status) == 0 && S_ISREG(status.st_mode);
  if (::close(descriptor) != 0 && error == 0) error = errno;
  if (error != 0) {
    if (regular) ::unlink(path.c_str());
    fail_runtime("{}: can't be written: {}", path.string(), std::strerror(error));
  }
}

void check_values(const std::string& name, const ImageInfo& info, std::size_t bytes) {
  if (info.width == 0 || info.height == 0 || info.channels == 0) {
    fail_runtime("{}: an image of {} can't be written", name, describe(info));
  }
  if (bytes != info.bytes()) {
    fail_runtime("{}: an image of {} has {} bytes, not {}", name, describe(info), info.bytes(),
                 bytes);
  }
}

}  // namespace

namespace formats {

void check_size(const std::string& name, std::size_t width, std::size_t height,
                std::size_t bytes_per_pixel, std::size_t file_bytes, std::size_t max_ratio) {
  if (width == 0 || height == 0 || width > max_image_side || height > max_image_side) {
    fail_input("{}: size {} x {}: each side must be within 1 and {}", name, width, height,
               max_image_side);
  }
  // At most 2^32 pixels from here on, so nothing overflows.
  const std::size_t bytes = width * height * bytes_per_pixel;
  if (bytes > max_image_bytes) {
    fail_input("{}: size {} x {}: {} bytes when decoded, more than {}", name, width, height, bytes,
               max_image_bytes);
  }
  if (bytes / max_ratio > file_bytes) {
    fail_input("{}: size {} x {}: a file of {} bytes can't hold that", name, width, height,
               file_bytes);
  }
}

}  // namespace formats

bool is_image_name(std::string_view name) {
  constexpr std::array<std::string_view, 4> endings{".png", ".jpg", ".jpeg", ".exr"};
  return std::any_of(endings.begin(), endings.end(), [name](std::string_view ending) {
    return name.size() > ending.size() &&
           std::equal(ending.rbegin(), ending.rend(), name.rbegin(), [](char a, char b) {
             return a == static_cast<char>(std::tolower(static_cast<unsigned char>(b)));
           });
  });
}

ImageInfo image_info(std::span<const std::byte> file, const std::string& name) {
  if (formats::is_png(file)) return formats::png_info(file, name);
  if (formats::is_jpeg(file)) return formats::jpeg_info(file, name);
  if (formats::is_exr(file)) return formats::exr_info(file, name);
  if (formats::is_hdr(file)) return formats::hdr_info(file, name);
  fail_input("{}: neither a PNG, a JPEG, an EXR nor a Radiance image ({} bytes)", name,
             file.size());
}

ImageInfo image_info(const std::filesystem::path& path) {
  const MappedFile file(path);
  return image_info(file.bytes(), path.string());
}

void read_image(std::span<const std::byte> file, const std::string& name, const ImageInfo& info,
                std::span<std::byte> out) {
  const ImageInfo found = image_info(file, name);
  if (found != info)
    fail_input("{}: {} where {} was expected", name, describe(found), describe(info));
  if (out.size() != info.bytes()) {
    fail_runtime("{}: {} bytes given for an image of {}", name, out.size(), describe(info));
  }
  if (formats::is_png(file)) {
    formats::read_png(file, name, info, out);
  } else if (formats::is_jpeg(file)) {
    formats::read_jpeg(file, name, info, out);
  } else if (formats::is_hdr(file)) {
    formats::read_hdr(file, name, info, out);
  } else {
    formats::read_exr(file, name, info, out);
  }
}

void read_image(const std::filesystem::path& path, const ImageInfo& info,
                std::span<std::byte> out) {
  const MappedFile file(path);
  read_image(file.bytes(), path.string(), info, out);
}

ExrCompression exr_compression_from_name(std::string_view name, std::string_view option) {
  if (name == "none") return ExrCompression::none;
  if (name == "zip") return ExrCompression::zip;
  if (name == "piz") return ExrCompression::piz;
  fail_input("{}: '{}' is none of none, zip, piz", option, name);
}

void write_exr(const std::filesystem::path& path, const ImageInfo& info,
               std::span<const std::byte> values, ExrCompression compression,
               std::span<const std::string> channel_names) {
  check_values(path.string(), info, values.size());
  write_file(path, formats::encode_exr(path.string(), info, values, compression, channel_names));
}

void write_png(const std::filesystem::path& path, const ImageInfo& info,
               std::span<const std::byte> values, int zlib_level) {
  check_values(path.string(), info, values.size());
  write_file(path, formats::encode_png(path.string(), info, values, zlib_level));
}

}  // namespace weft
