// Radiance pictures (.hdr): a text header, a line with the size, and pixels of three mantissas with
// a common exponent, plain or run-length encoded in one of two ways. The format is that of Ward,
// Real Pixels, Graphics Gems II, and of the file formats document of Radiance.
//
//   value = (mantissa + 1/2) 2^(exponent - 136) / exposure,    0 where the exponent is 0
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <string_view>

#include "weft/error.hpp"
#include "weft/io/image_formats.hpp"
#include "weft/io/json_text.hpp"

namespace weft::formats {
namespace {

// Runs of 127 equal bytes make 190 bytes of a byte; the old runs, longer ones, 765.
constexpr std::size_t max_ratio = 2048;
constexpr std::size_t longest_line = 4096;
constexpr std::size_t most_lines = 1000;
// Widths that the new encoding of lines is defined for.
constexpr std::size_t least_width = 8, largest_width = 32767;

using Pixel = std::array<std::uint8_t, 4>;  // three mantissas, exponent

// Walks the file; whatever is missing is an error.
class Reader {
 public:
  Reader(Bytes file, const std::string& name) : file_(file), name_(name) {}

  std::uint8_t byte() {
    if (position_ == file_.size()) fail_input("{}: damaged HDR: ends at byte {}", name_, position_);
    return std::to_integer<std::uint8_t>(file_[position_++]);
  }

  Pixel pixel() { return {byte(), byte(), byte(), byte()}; }

  std::string_view line() {
    const std::size_t begin = position_;
    while (byte() != '\n') {
      if (position_ - begin > longest_line) fail_input("{}: damaged HDR: endless line", name_);
    }
    const char* const text = reinterpret_cast<const char*>(file_.data()) + begin;
    std::string_view line(text, position_ - begin - 1);
    if (line.ends_with('\r')) line.remove_suffix(1);
    return line;
  }

  std::size_t position() const { return position_; }

 private:
  Bytes file_;
  const std::string& name_;
  std::size_t position_ = 0;
};

struct Header {
  ImageInfo info;
  std::array<double, 3> exposure{1, 1, 1};
  bool bottom_up = false, right_to_left = false;
  std::size_t data_offset = 0;
};

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

// The number at the front of `text`, which it is taken from.
double take_number(std::string_view& text, std::string_view field, const std::string& name) {
  const std::string_view whole = text;
  text = trimmed(text);
  double value = 0;
  const auto [stop, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (status != std::errc{} || !(value > 0) || !std::isfinite(value)) {
    fail_input("{}: HDR header: {} '{}' is no positive number", name, field, shown(whole));
  }
  text.remove_prefix(static_cast<std::size_t>(stop - text.data()));
  return value;
}

void read_field(std::string_view line, Header& header, const std::string& name) {
  const std::size_t equals = line.find('=');
  if (equals == std::string_view::npos || line.starts_with('#')) return;
  const std::string_view key = trimmed(line.substr(0, equals));
  std::string_view value = trimmed(line.substr(equals + 1));
  if (key == "FORMAT" && value != "32-bit_rle_rgbe") {
    fail_input("{}: HDR header: FORMAT '{}' is not read; 32-bit_rle_rgbe is", name, shown(value));
  }
  if (key == "EXPOSURE") {
    const double factor = take_number(value, key, name);
    for (double& exposure : header.exposure) exposure *= factor;
  } else if (key == "COLORCORR") {
    for (double& exposure : header.exposure) exposure *= take_number(value, key, name);
  } else if (key == "GAMMA" && take_number(value, key, name) != 1) {
    fail_input("{}: HDR header: {}: linear light is read only", name, shown(line));
  }
}

// "-Y 512 +X 1024": rows from the top, columns from the left.
void read_size(std::string_view line, Header& header, const std::string& name) {
  const auto unreadable = [&] {
    fail_input("{}: HDR size '{}' is none like -Y 512 +X 1024", name, shown(line));
  };
  const auto axis = [&](std::string_view& rest, char letter, std::size_t& size) {
    if (rest.size() < 4 || (rest[0] != '-' && rest[0] != '+') || rest[1] != letter ||
        rest[2] != ' ') {
      unreadable();
    }
    const bool plus = rest[0] == '+';
    const char* const begin = rest.data() + 3;
    const auto [stop, status] = std::from_chars(begin, rest.data() + rest.size(), size);
    if (status != std::errc{}) unreadable();
    rest.remove_prefix(static_cast<std::size_t>(stop - rest.data()));
    return plus;
  };
  std::string_view rest = line;
  header.bottom_up = axis(rest, 'Y', header.info.height);
  if (!rest.starts_with(' ')) unreadable();
  rest.remove_prefix(1);
  header.right_to_left = !axis(rest, 'X', header.info.width);
  if (!rest.empty()) unreadable();
}

Header read_header(Bytes file, const std::string& name) {
  Reader reader(file, name);
  reader.line();  // the magic bytes, and a program's name
  Header header;
  std::size_t lines = 0;
  for (std::string_view line = reader.line(); !line.empty(); line = reader.line()) {
    if (++lines > most_lines) fail_input("{}: damaged HDR: endless header", name);
    read_field(line, header, name);
  }
  read_size(reader.line(), header, name);
  header.info.channels = 3;
  header.info.dtype = DType::f32;
  header.data_offset = reader.position();
  check_size(name, header.info.width, header.info.height, 3 * sizeof(float), file.size(),
             max_ratio);
  return header;
}

// Each of the four bytes of the pixels in runs of their own.
void read_new_line(Reader& reader, std::vector<Pixel>& line, const std::string& name) {
  for (std::size_t k = 0; k < 4; ++k) {
    for (std::size_t x = 0; x < line.size();) {
      const std::uint8_t code = reader.byte();
      const bool run = code > 128;
      const std::size_t count = run ? code - 128u : code;
      if (count == 0 || count > line.size() - x) {
        fail_input("{}: damaged HDR: a run of {} at column {} of {}, before byte {}", name, count,
                   x, line.size(), reader.position());
      }
      const std::uint8_t repeated = run ? reader.byte() : std::uint8_t{0};
      for (std::size_t i = 0; i < count; ++i) line[x++][k] = run ? repeated : reader.byte();
    }
  }
}

// Whole pixels; 1, 1, 1, n stands for n more of the last one, and one right after it for n 2^8
// more.
void read_old_line(Reader& reader, Pixel first, std::vector<Pixel>& line, const std::string& name) {
  unsigned shift = 0;
  for (std::size_t x = 0; x < line.size();) {
    const Pixel pixel = x == 0 && shift == 0 ? first : reader.pixel();
    if (pixel[0] != 1 || pixel[1] != 1 || pixel[2] != 1) {
      line[x++] = pixel;
      shift = 0;
      continue;
    }
    const std::size_t count = shift < 24 ? std::size_t{pixel[3]} << shift : line.size() + 1;
    if (x == 0 || count > line.size() - x) {
      fail_input("{}: damaged HDR: a run of {} at column {} of {}, before byte {}", name, count, x,
                 line.size(), reader.position());
    }
    for (std::size_t i = 0; i < count; ++i, ++x) line[x] = line[x - 1];
    shift += 8;
  }
}

void read_line(Reader& reader, std::vector<Pixel>& line, const std::string& name) {
  const Pixel first = reader.pixel();
  const bool may_be_new = line.size() >= least_width && line.size() <= largest_width;
  if (!may_be_new || first[0] != 2 || first[1] != 2 || first[2] > 127) {
    read_old_line(reader, first, line, name);
    return;
  }
  const std::size_t width = std::size_t{first[2]} << 8 | first[3];
  if (width != line.size()) {
    fail_input("{}: damaged HDR: a line of {} pixels where {} were expected, before byte {}", name,
               width, line.size(), reader.position());
  }
  read_new_line(reader, line, name);
}

}  // namespace

bool is_hdr(Bytes file) {
  constexpr std::string_view magic = "#?R";
  return file.size() >= magic.size() && std::memcmp(file.data(), magic.data(), magic.size()) == 0;
}

ImageInfo hdr_info(Bytes file, const std::string& name) {
  return read_header(file, name).info;
}

void read_hdr(Bytes file, const std::string& name, const ImageInfo& info,
              std::span<std::byte> out) {
  const Header header = read_header(file, name);
  Reader reader(file.subspan(header.data_offset), name);
  std::vector<Pixel> line(info.width);
  std::vector<float> values(3 * info.width);
  for (std::size_t i = 0; i < info.height; ++i) {
    const std::size_t row = header.bottom_up ? info.height - 1 - i : i;
    read_line(reader, line, name);
    for (std::size_t x = 0; x < info.width; ++x) {
      const Pixel& pixel = line[header.right_to_left ? info.width - 1 - x : x];
      for (std::size_t c = 0; c < 3; ++c) {
        const double value =
            pixel[3] == 0 ? 0
                          : std::ldexp(pixel[c] + 0.5, int{pixel[3]} - 136) / header.exposure[c];
        values[3 * x + c] = static_cast<float>(value);
        if (!std::isfinite(values[3 * x + c])) {
          fail_input("{}: HDR: pixel ({}, {}) is {}, more than a float holds", name, x, row, value);
        }
      }
    }
    std::memcpy(out.data() + row * values.size() * sizeof(float), values.data(),
                values.size() * sizeof(float));
  }
}

}  // namespace weft::formats
