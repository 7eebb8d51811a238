// JPEG by libjpeg. As in png.cpp, its errors end in a longjmp, so the functions that call it own
// nothing. What the library only warns of (data that ends early or makes no sense) is an error
// here: a measurement with grey blocks in it is no measurement.
#include <cstdio>
// jpeglib.h needs FILE to be declared.
#include <jerror.h>
#include <jpeglib.h>

#include <array>
#include <csetjmp>

#include "weft/error.hpp"
#include "weft/io/image_formats.hpp"

namespace weft::formats {
namespace {

// An optimised code spends a bit on a block of 64 values and end-of-band runs spend less; beyond
// this a header is taken for a lie.
constexpr std::size_t max_ratio = 8192;
// A scan of few bytes costs a pass over the whole image; real files have about ten.
constexpr int max_scans = 200;

struct State {
  jpeg_decompress_struct decoder{};
  jpeg_error_mgr errors{};
  jpeg_progress_mgr progress{};
  std::jmp_buf stop{};
  std::array<char, JMSG_LENGTH_MAX> message{};
};

State& state_of(j_common_ptr common) {
  return *static_cast<State*>(common->client_data);
}

[[noreturn]] void on_error(j_common_ptr common) {
  State& state = state_of(common);
  common->err->format_message(common, state.message.data());
  std::longjmp(state.stop, 1);
}

void on_message(j_common_ptr common, int level) {
  if (level >= 0) return;
  switch (common->err->msg_code) {
    case JWRN_EXTRANEOUS_DATA:
    case JWRN_ADOBE_XFORM:
    case JWRN_JFIF_MAJOR:
      return;  // of no consequence for the pixels
    default:
      on_error(common);
  }
}

void print_nothing(j_common_ptr) {}

void on_progress(j_common_ptr common) {
  State& state = state_of(common);
  if (state.decoder.input_scan_number <= max_scans) return;
  std::snprintf(state.message.data(), state.message.size(), "more than %d scans", max_scans);
  std::longjmp(state.stop, 1);
}

// Up to the header: 1 or 3 channels are chosen as output.
bool open(State& state, Bytes file) {
  if (setjmp(state.stop)) return false;
  jpeg_create_decompress(&state.decoder);
  state.progress.progress_monitor = on_progress;
  state.decoder.progress = &state.progress;
  jpeg_mem_src(&state.decoder, reinterpret_cast<const unsigned char*>(file.data()),
               static_cast<unsigned long>(file.size()));
  jpeg_read_header(&state.decoder, TRUE);
  return true;
}

bool decode(State& state, std::byte* out, std::size_t row_bytes) {
  if (setjmp(state.stop)) return false;
  jpeg_start_decompress(&state.decoder);
  while (state.decoder.output_scanline < state.decoder.output_height) {
    auto* row = reinterpret_cast<JSAMPROW>(out + state.decoder.output_scanline * row_bytes);
    jpeg_read_scanlines(&state.decoder, &row, 1);
  }
  jpeg_finish_decompress(&state.decoder);
  return true;
}

// A decoder that has read the header of one file, and is destroyed with the object.
class Decoder {
 public:
  Decoder(Bytes file, const std::string& name) : name_(name) {
    state_.decoder.err = jpeg_std_error(&state_.errors);
    state_.errors.error_exit = on_error;
    state_.errors.emit_message = on_message;
    state_.errors.output_message = print_nothing;
    state_.decoder.client_data = &state_;
    if (!open(state_, file)) {
      jpeg_destroy_decompress(&state_.decoder);
      fail_input("{}: damaged JPEG: {}", name_, state_.message.data());
    }
  }
  ~Decoder() { jpeg_destroy_decompress(&state_.decoder); }
  Decoder(const Decoder&) = delete;
  Decoder& operator=(const Decoder&) = delete;

  State& state() { return state_; }

 private:
  const std::string& name_;
  State state_;
};

}  // namespace

bool is_jpeg(Bytes file) {
  return file.size() >= 3 && file[0] == std::byte{0xff} && file[1] == std::byte{0xd8} &&
         file[2] == std::byte{0xff};
}

ImageInfo jpeg_info(Bytes file, const std::string& name) {
  Decoder decoder(file, name);
  const jpeg_decompress_struct& header = decoder.state().decoder;
  if (header.num_components != 1 && header.num_components != 3) {
    fail_input("{}: a JPEG of {} channels is not read, only of 1 or 3", name,
               header.num_components);
  }
  ImageInfo info;
  info.width = header.image_width;
  info.height = header.image_height;
  info.channels = static_cast<std::size_t>(header.num_components);
  check_size(name, info.width, info.height, info.channels, file.size(), max_ratio);
  return info;
}

void read_jpeg(Bytes file, const std::string& name, const ImageInfo& info,
               std::span<std::byte> out) {
  Decoder decoder(file, name);
  State& state = decoder.state();
  state.decoder.out_color_space = info.channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
  if (!decode(state, out.data(), info.width * info.channels)) {
    fail_input("{}: damaged JPEG: {}", name, state.message.data());
  }
}

}  // namespace weft::formats
