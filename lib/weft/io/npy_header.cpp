// The header of .npy files: "\x93NUMPY", version, length, and a Python dict such as
//   {'descr': '<f2', 'fortran_order': False, 'shape': (37, 21, 64, 64, 3), }
#include <algorithm>
#include <cstdint>
#include <optional>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/mapped_file.hpp"
#include "weft/io/npy.hpp"

namespace weft {
namespace {

constexpr std::string_view npy_magic("\x93NUMPY", 6);

// Reads the few forms of Python literals that NumPy writes.
class DictParser {
 public:
  DictParser(std::string_view text, std::string_view where) : text_(text), where_(where) {}

  void parse() {
    expect('{');
    while (!accept('}')) {
      const std::string_view key = quoted("a key");
      expect(':');
      if (key == "descr" && !descr) {
        descr = std::string(quoted("'descr'"));
      } else if (key == "fortran_order" && !fortran_order) {
        fortran_order = truth_value();
      } else if (key == "shape" && !shape) {
        shape = tuple();
      } else {
        fail_input("{}: NPY header: key '{}' is unknown or given twice", where_, shown(key));
      }
      if (!accept(',')) {
        expect('}');
        break;
      }
    }
    skip_space();
    if (position_ != text_.size()) {
      fail_input("{}: NPY header: text after the closing brace", where_);
    }
    if (!descr || !fortran_order || !shape) {
      fail_input("{}: NPY header: 'descr', 'fortran_order' or 'shape' is missing", where_);
    }
  }

  std::optional<std::string> descr;
  std::optional<bool> fortran_order;
  std::optional<std::vector<std::size_t>> shape;

 private:
  [[noreturn]] void unexpected(std::string_view wanted) const {
    fail_input("{}: NPY header: {} expected at byte {}, found \"{}\"", where_, wanted, position_,
               shown(text_.substr(position_, 16)));
  }

  void skip_space() {
    constexpr std::string_view space = " \t\r\n";
    while (position_ < text_.size() && space.find(text_[position_]) != std::string_view::npos) {
      ++position_;
    }
  }

  bool accept(char c) {
    skip_space();
    if (position_ >= text_.size() || text_[position_] != c) return false;
    ++position_;
    return true;
  }

  void expect(char c) {
    if (!accept(c)) unexpected(std::string{'\'', c, '\''});
  }

  std::string_view quoted(std::string_view what) {
    skip_space();
    const char quote = position_ < text_.size() ? text_[position_] : '\0';
    if (quote != '\'' && quote != '"') unexpected(fmt::format("{} in quotes", what));
    const std::size_t begin = position_ + 1;
    const std::size_t end = text_.find(quote, begin);
    if (end == std::string_view::npos) unexpected("a closing quote");
    position_ = end + 1;
    return text_.substr(begin, end - begin);
  }

  bool truth_value() {
    skip_space();
    for (const auto& [word, value] :
         {std::pair{std::string_view("False"), false}, std::pair{std::string_view("True"), true}}) {
      if (text_.substr(position_, word.size()) == word) {
        position_ += word.size();
        return value;
      }
    }
    unexpected("True or False");
  }

  std::vector<std::size_t> tuple() {
    std::vector<std::size_t> sizes;
    expect('(');
    while (!accept(')')) {
      sizes.push_back(integer());
      if (!accept(',')) {
        expect(')');
        break;
      }
    }
    return sizes;
  }

  std::size_t integer() {
    skip_space();
    const std::size_t begin = position_;
    std::size_t value = 0;
    for (; position_ < text_.size(); ++position_) {
      const char c = text_[position_];
      if (c < '0' || c > '9') break;
      if (__builtin_mul_overflow(value, std::size_t{10}, &value) ||
          __builtin_add_overflow(value, static_cast<std::size_t>(c - '0'), &value)) {
        fail_input("{}: NPY header: a size in 'shape' overflows", where_);
      }
    }
    if (position_ == begin) unexpected("a size");
    // Python 2 wrote long integers as 37L.
    if (position_ < text_.size() && text_[position_] == 'L') ++position_;
    return value;
  }

  std::string_view text_;
  std::string_view where_;
  std::size_t position_ = 0;
};

DType dtype_of(std::string_view descr, std::string_view where) {
  if (descr == "|u1" || descr == "<u1" || descr == "u1") return DType::u8;
  if (descr == "<f2") return DType::f16;
  if (descr == "<f4") return DType::f32;
  if (descr == "<f8") return DType::f64;
  fail_input(
      "{}: NPY header: 'descr' '{}' is none of little-endian uint8, float16, float32, float64",
      where, shown(descr));
}

}  // namespace

NpyHeader read_npy_header(const std::filesystem::path& path) {
  const std::string where = path.string();
  const MappedFile file(path);
  const std::string_view bytes(reinterpret_cast<const char*>(file.bytes().data()),
                               file.bytes().size());
  // Magic, version, length of the dict in 2 bytes (version 1) or 4.
  if (bytes.size() < 10 || bytes.substr(0, npy_magic.size()) != npy_magic) {
    fail_input("{}: not an NPY file", where);
  }
  const auto byte_at = [&](std::size_t i) { return static_cast<std::uint8_t>(bytes[i]); };
  const int major = byte_at(6);
  const int minor = byte_at(7);
  if (major < 1 || major > 3 || minor != 0) {
    fail_input("{}: NPY version {}.{} is not read", where, major, minor);
  }
  const std::size_t begin = major == 1 ? 10 : 12;
  if (bytes.size() < begin) fail_input("{}: NPY header is truncated", where);
  std::size_t length = 0;
  for (std::size_t i = begin; i-- > 8;) length = length << 8 | byte_at(i);
  if (length > bytes.size() - begin) {
    fail_input("{}: NPY header of {} bytes passes the end of the file, {} bytes", where, length,
               bytes.size());
  }

  DictParser dict(bytes.substr(begin, length), where);
  dict.parse();
  if (*dict.fortran_order) fail_input("{}: NPY header: Fortran order is not read", where);
  NpyHeader header;
  header.dtype = dtype_of(*dict.descr, where);
  header.shape = *dict.shape;
  header.data_offset = begin + length;
  std::size_t size = size_of(header.dtype);
  for (const std::size_t n : header.shape) {
    if (__builtin_mul_overflow(size, n, &size)) {
      fail_input("{}: NPY header: 'shape' overflows", where);
    }
  }
  if (size != bytes.size() - header.data_offset) {
    fail_input("{}: 'shape' and 'descr' take {} bytes, the file holds {}", where, size,
               bytes.size() - header.data_offset);
  }
  return header;
}

std::string make_npy_header(DType dtype, const std::vector<std::size_t>& shape) {
  std::string descr;
  switch (dtype) {
    case DType::u8:
      descr = "|u1";
      break;
    case DType::f16:
      descr = "<f2";
      break;
    case DType::f32:
      descr = "<f4";
      break;
    default:
      fail_input("NPY: dtype {} is none of U8, F16, F32", name_of(dtype));
  }
  std::string dict = fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': (", descr);
  for (std::size_t i = 0; i < shape.size(); ++i) {
    dict += fmt::format("{}{}", i == 0 ? "" : ", ", shape[i]);
  }
  dict += shape.size() == 1 ? ",), }" : "), }";
  // Spaces up to the newline that ends the header.
  constexpr std::size_t alignment = 64;
  const std::size_t used = 10 + dict.size() + 1;
  dict.append((alignment - used % alignment) % alignment, ' ');
  dict += '\n';
  if (dict.size() > 0xffff) fail_input("NPY: {} modes are too many", shape.size());
  std::string header(npy_magic);
  header +=
      {'\x01', '\x00', static_cast<char>(dict.size() & 0xff), static_cast<char>(dict.size() >> 8)};
  return header + dict;
}

}  // namespace weft
