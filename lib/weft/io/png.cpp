// PNG by libpng. Its errors end in a longjmp, which must not cross objects with destructors: each
// codec call runs in a function that owns nothing, on a state whose owner is its caller.
#include <png.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstdio>
#include <cstring>

#include "weft/error.hpp"
#include "weft/io/image_formats.hpp"

namespace weft::formats {
namespace {

constexpr std::array<unsigned char, 8> signature{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
// Deflate expands at most 1032 times.
constexpr std::size_t max_ratio = 1100;
constexpr std::size_t header_bytes = 33;  // signature and IHDR chunk

struct Header {
  std::size_t width = 0;
  std::size_t height = 0;
  unsigned depth = 0;
  unsigned colour_type = 0;
};

std::uint32_t big_endian(Bytes file, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value = value << 8 | std::to_integer<std::uint32_t>(file[offset + i]);
  }
  return value;
}

Header parse_header(Bytes file, const std::string& name) {
  if (file.size() < header_bytes || big_endian(file, 8) != 13 ||
      std::memcmp(file.data() + 12, "IHDR", 4) != 0) {
    fail_input("{}: the PNG header is missing or cut short", name);
  }
  return {big_endian(file, 16), big_endian(file, 20), std::to_integer<unsigned>(file[24]),
          std::to_integer<unsigned>(file[25])};
}

struct State {
  png_structp png = nullptr;
  png_infop info = nullptr;
  const std::byte* input = nullptr;
  std::size_t left = 0;
  std::vector<std::byte>* output = nullptr;
  bool out_of_memory = false;
  std::array<char, 200> message{};
};

[[noreturn]] void on_error(png_structp png, png_const_charp text) {
  auto* state = static_cast<State*>(png_get_error_ptr(png));
  std::snprintf(state->message.data(), state->message.size(), "%s", text);
  png_longjmp(png, 1);
}

void on_warning(png_structp, png_const_charp) {}

void take_bytes(png_structp png, png_bytep to, png_size_t count) {
  auto* state = static_cast<State*>(png_get_io_ptr(png));
  if (count > state->left) png_error(png, "the file ends early");
  std::memcpy(to, state->input, count);
  state->input += count;
  state->left -= count;
}

void put_bytes(png_structp png, png_bytep from, png_size_t count) {
  auto* state = static_cast<State*>(png_get_io_ptr(png));
  const auto* first = reinterpret_cast<const std::byte*>(from);
  try {
    state->output->insert(state->output->end(), first, first + count);
  } catch (const std::bad_alloc&) {
    state->out_of_memory = true;
  }
  if (state->out_of_memory) png_error(png, "out of memory");
}

void flush_nothing(png_structp) {}

bool decode(State& state, std::byte* out, std::size_t height, std::size_t row_bytes) {
  if (setjmp(png_jmpbuf(state.png))) return false;
  png_set_user_limits(state.png, max_image_side, max_image_side);
  png_set_read_fn(state.png, &state, take_bytes);
  png_read_info(state.png, state.info);
  png_set_palette_to_rgb(state.png);
  png_set_expand_gray_1_2_4_to_8(state.png);
  png_set_strip_alpha(state.png);
  const int passes = png_set_interlace_handling(state.png);
  png_read_update_info(state.png, state.info);
  if (png_get_rowbytes(state.png, state.info) != row_bytes) {
    png_error(state.png, "rows are not of the announced size");
  }
  for (int pass = 0; pass < passes; ++pass) {
    for (std::size_t y = 0; y < height; ++y) {
      png_read_row(state.png, reinterpret_cast<png_bytep>(out + y * row_bytes), nullptr);
    }
  }
  png_read_end(state.png, nullptr);
  return true;
}

bool encode(State& state, const std::byte* values, const ImageInfo& info, int zlib_level) {
  if (setjmp(png_jmpbuf(state.png))) return false;
  png_set_write_fn(state.png, &state, put_bytes, flush_nothing);
  png_set_compression_level(state.png, zlib_level);
  png_set_IHDR(state.png, state.info, static_cast<png_uint_32>(info.width),
               static_cast<png_uint_32>(info.height), 8,
               info.channels == 1 ? PNG_COLOR_TYPE_GRAY : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(state.png, state.info);
  const std::size_t row_bytes = info.width * info.channels;
  for (std::size_t y = 0; y < info.height; ++y) {
    png_write_row(state.png, reinterpret_cast<png_const_bytep>(values + y * row_bytes));
  }
  png_write_end(state.png, state.info);
  return true;
}

}  // namespace

bool is_png(Bytes file) {
  return file.size() >= signature.size() &&
         std::memcmp(file.data(), signature.data(), signature.size()) == 0;
}

ImageInfo png_info(Bytes file, const std::string& name) {
  const Header header = parse_header(file, name);
  if (header.depth == 16) fail_input("{}: 16 bits per channel are not read, only 8", name);
  ImageInfo info;
  info.width = header.width;
  info.height = header.height;
  switch (header.colour_type) {
    case PNG_COLOR_TYPE_GRAY:
    case PNG_COLOR_TYPE_GRAY_ALPHA:
      info.channels = 1;
      break;
    case PNG_COLOR_TYPE_RGB:
    case PNG_COLOR_TYPE_RGB_ALPHA:
    case PNG_COLOR_TYPE_PALETTE:
      info.channels = 3;
      break;
    default:
      fail_input("{}: PNG colour type {} does not exist", name, header.colour_type);
  }
  // One bit per pixel may expand to three bytes: 24 times, on top of deflate.
  const std::size_t expansion = header.depth < 8 ? 8 / std::max(header.depth, 1u) : 1;
  check_size(name, info.width, info.height, info.channels, file.size(),
             max_ratio * expansion * info.channels);
  return info;
}

void read_png(Bytes file, const std::string& name, const ImageInfo& info,
              std::span<std::byte> out) {
  State state;
  state.input = file.data();
  state.left = file.size();
  state.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &state, on_error, on_warning);
  if (state.png) state.info = png_create_info_struct(state.png);
  const bool done =
      state.info && decode(state, out.data(), info.height, info.width * info.channels);
  png_destroy_read_struct(&state.png, &state.info, nullptr);
  if (!done) fail_input("{}: damaged PNG: {}", name, state.message.data());
}

std::vector<std::byte> encode_png(const std::string& name, const ImageInfo& info, Bytes values,
                                  int zlib_level) {
  if (info.dtype != DType::u8 || (info.channels != 1 && info.channels != 3)) {
    fail_runtime("{}: PNG holds 1 or 3 channels of U8, not {} of {}", name, info.channels,
                 name_of(info.dtype));
  }
  std::vector<std::byte> file;
  State state;
  state.output = &file;
  state.png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &state, on_error, on_warning);
  if (state.png) state.info = png_create_info_struct(state.png);
  const bool done = state.info && encode(state, values.data(), info, std::clamp(zlib_level, 0, 9));
  png_destroy_write_struct(&state.png, &state.info);
  if (!done) fail_runtime("{}: PNG can't be encoded: {}", name, state.message.data());
  return file;
}

}  // namespace weft::formats
