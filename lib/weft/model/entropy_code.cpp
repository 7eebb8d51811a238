#include "weft/model/entropy_code.hpp"

#include <zstd.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <memory>
#include <utility>

#include "weft/error.hpp"

namespace weft {
namespace {

// Of 1 to 19: beyond 9 files of models get smaller by less than a hundredth, at a tenth of the
// speed.
constexpr int level = 9;
constexpr int most_window_log = 23;
constexpr unsigned most_length = 16;  // of a signed number of two bytes

std::uint32_t mask_of(NumberType type) {
  return type.bytes == 4 ? std::numeric_limits<std::uint32_t>::max() : (1u << (8 * type.bytes)) - 1;
}

bool has_neighbour(std::size_t i, Neighbours neighbours) {
  return (i / neighbours.stride) % neighbours.size != 0;
}

// The number that two bytes in two's complement are.
std::int32_t sign_extended(std::uint32_t word) {
  return static_cast<std::int16_t>(static_cast<std::uint16_t>(word));
}

std::uint32_t zigzag(std::uint32_t word) {
  const std::int32_t n = sign_extended(word);
  return n >= 0 ? static_cast<std::uint32_t>(n) << 1
                : (static_cast<std::uint32_t>(-(n + 1)) << 1) + 1;
}

std::uint32_t from_zigzag(std::uint32_t word) {
  return (word >> 1) ^ (0u - (word & 1));
}

// How a frame is made. Where bytes repeat, as those of grey channels do, a search for matches pays;
// where they are noise it finds short ones, which take more than the prefix code of the bytes
// alone.
enum class Search : std::uint8_t { matches, none };

std::vector<std::byte> frame_of(std::span<const std::byte> bytes, Search search) {
  const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                     &ZSTD_freeCCtx);
  if (!context) fail_runtime("zstd: no room for a compression context");
  const auto set = [&](ZSTD_cParameter parameter, int value) {
    ZSTD_CCtx_setParameter(context.get(), parameter, value);
  };
  set(ZSTD_c_contentSizeFlag, 0);  // the tensor's shape says it
  set(ZSTD_c_compressionLevel, search == Search::none ? 1 : level);
  if (search == Search::none) {
    constexpr int least_log = 6;
    constexpr int longest_least_match = 7;
    set(ZSTD_c_strategy, ZSTD_fast);
    set(ZSTD_c_minMatch, longest_least_match);
    set(ZSTD_c_hashLog, least_log);
    set(ZSTD_c_chainLog, least_log);
    set(ZSTD_c_searchLog, 1);
  }
  std::vector<std::byte> frame(ZSTD_compressBound(bytes.size()));
  const std::size_t size =
      ZSTD_compress2(context.get(), frame.data(), frame.size(), bytes.data(), bytes.size());
  if (ZSTD_isError(size) != 0) fail_runtime("zstd: {}", ZSTD_getErrorName(size));
  frame.resize(size);
  return frame;
}

void append_frame(std::span<const std::byte> bytes, std::vector<std::byte>& blob) {
  std::vector<std::byte> frame = frame_of(bytes, Search::matches);
  std::vector<std::byte> other = frame_of(bytes, Search::none);
  if (other.size() < frame.size()) frame = std::move(other);
  blob.insert(blob.end(), frame.begin(), frame.end());
}

// Reads frames one after the other.
class FrameReader {
 public:
  FrameReader(std::span<const std::byte> blob, std::string_view where)
      : rest_(blob), where_(where), context_(ZSTD_createDCtx(), &ZSTD_freeDCtx) {
    if (!context_) fail_runtime("zstd: no room for a decompression context");
    ZSTD_DCtx_setParameter(context_.get(), ZSTD_d_windowLogMax, most_window_log);
  }

  std::span<const std::byte> rest() const { return rest_; }

  // The next frame, which must hold `count` bytes.
  std::vector<std::byte> next(std::size_t count) {
    constexpr std::size_t first_room = std::size_t{1} << 16;
    std::vector<std::byte> bytes;
    ZSTD_DCtx_reset(context_.get(), ZSTD_reset_session_only);
    ZSTD_inBuffer in{rest_.data(), rest_.size(), 0};
    std::size_t filled = 0;
    for (std::size_t left = 1; left != 0;) {
      // room grows as bytes come, since the count may be a lie; a last byte shows what is too much
      const std::size_t wanted = std::min(std::max(first_room, 2 * filled), count + 1);
      if (bytes.size() < wanted) bytes.resize(wanted);
      ZSTD_outBuffer out{bytes.data(), bytes.size(), filled};
      const std::size_t read = in.pos;
      left = ZSTD_decompressStream(context_.get(), &out, &in);
      if (ZSTD_isError(left) != 0) fail_input("{}: {}", where_, ZSTD_getErrorName(left));
      if (out.pos > count) fail_input("{}: holds more than {} values", where_, count);
      const bool advanced = out.pos > filled || in.pos > read;
      filled = out.pos;
      if (left != 0 && !advanced) fail_input("{}: ends within a frame", where_);
    }
    if (filled != count) fail_input("{}: holds {} values instead of {}", where_, filled, count);
    bytes.resize(count);
    rest_ = rest_.subspan(in.pos);
    return bytes;
  }

 private:
  std::span<const std::byte> rest_;
  std::string_view where_;
  std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context_;
};

// planes

void put_planes(std::span<const std::uint32_t> words, NumberType type,
                std::vector<std::byte>& blob) {
  std::uint32_t used = 0;
  for (const std::uint32_t word : words) used |= word;
  std::vector<std::byte> plane(words.size());
  for (std::size_t p = 0; p < type.bytes; ++p) {
    if (p > 0 && used >> (8 * p) == 0) break;
    for (std::size_t i = 0; i < words.size(); ++i) {
      plane[i] = static_cast<std::byte>(words[i] >> (8 * p) & 0xff);
    }
    append_frame(plane, blob);
  }
}

std::vector<std::uint32_t> get_planes(std::span<const std::byte> blob, std::size_t count,
                                      NumberType type, std::string_view where) {
  FrameReader reader(blob, where);
  std::vector<std::uint32_t> words;
  for (std::size_t p = 0; p == 0 || !reader.rest().empty(); ++p) {
    if (p == type.bytes) fail_input("{}: {} bytes too many", where, reader.rest().size());
    const std::vector<std::byte> plane = reader.next(count);
    words.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      words[i] |= std::to_integer<std::uint32_t>(plane[i]) << (8 * p);
    }
  }
  return words;
}

// classes

void put_classes(std::span<const std::uint32_t> words, std::vector<std::byte>& blob) {
  std::vector<std::byte> lengths(words.size());
  std::vector<std::byte> packed;
  std::uint64_t bits = 0;
  unsigned filled = 0;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::int32_t n = sign_extended(words[i]);
    const auto magnitude = static_cast<std::uint32_t>(n < 0 ? -n : n);
    const auto length = static_cast<unsigned>(std::bit_width(magnitude));
    lengths[i] = static_cast<std::byte>(length);
    if (length == 0) continue;
    const std::uint32_t below = magnitude - (1u << (length - 1));
    bits |= std::uint64_t{below << 1 | (n < 0 ? 1u : 0u)} << filled;
    for (filled += length; filled >= 8; filled -= 8, bits >>= 8) {
      packed.push_back(static_cast<std::byte>(bits & 0xff));
    }
  }
  if (filled > 0) packed.push_back(static_cast<std::byte>(bits));
  append_frame(lengths, blob);
  blob.insert(blob.end(), packed.begin(), packed.end());
}

std::vector<std::uint32_t> get_classes(std::span<const std::byte> blob, std::size_t count,
                                       std::string_view where) {
  FrameReader reader(blob, where);
  const std::vector<std::byte> lengths = reader.next(count);
  const std::span<const std::byte> packed = reader.rest();
  std::size_t total = 0;
  for (const std::byte length : lengths) {
    const auto bits = std::to_integer<unsigned>(length);
    if (bits > most_length) fail_input("{}: a number of {} bits", where, bits);
    total += bits;
  }
  if (packed.size() != (total + 7) / 8) {
    fail_input("{}: {} bytes behind the lengths instead of {}", where, packed.size(),
               (total + 7) / 8);
  }
  std::vector<std::uint32_t> words(count);
  std::uint64_t bits = 0;
  unsigned filled = 0;
  std::size_t at = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto length = std::to_integer<unsigned>(lengths[i]);
    if (length == 0) continue;
    for (; filled < length; filled += 8) {
      bits |= std::to_integer<std::uint64_t>(packed[at++]) << filled;
    }
    const auto below = static_cast<std::uint32_t>(bits & ((1u << length) - 1));
    bits >>= length;
    filled -= length;
    const std::uint32_t magnitude = (1u << (length - 1)) + (below >> 1);
    words[i] = (below & 1) != 0 ? 0u - magnitude : magnitude;
  }
  return words;
}

// bits

void put_bits(std::span<const std::uint32_t> words, std::vector<std::byte>& blob) {
  std::vector<std::byte> packed((words.size() + 7) / 8);
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i] > 1) fail_runtime("a number of {} is no bit", words[i]);
    packed[i / 8] |= static_cast<std::byte>(words[i] << (i % 8));
  }
  append_frame(packed, blob);
}

std::vector<std::uint32_t> get_bits(std::span<const std::byte> blob, std::size_t count,
                                    std::string_view where) {
  FrameReader reader(blob, where);
  const std::vector<std::byte> packed = reader.next((count + 7) / 8);
  if (!reader.rest().empty()) fail_input("{}: {} bytes too many", where, reader.rest().size());
  if (count % 8 != 0 && std::to_integer<unsigned>(packed.back()) >> (count % 8) != 0) {
    fail_input("{}: bits behind the last of {}", where, count);
  }
  std::vector<std::uint32_t> words(count);
  for (std::size_t i = 0; i < count; ++i) {
    words[i] = std::to_integer<std::uint32_t>(packed[i / 8]) >> (i % 8) & 1;
  }
  return words;
}

std::vector<std::uint32_t> get_words(std::span<const std::byte> blob, std::size_t count,
                                     NumberType type, CodeLayout layout, std::string_view where) {
  switch (layout) {
    case CodeLayout::planes:
      return get_planes(blob, count, type, where);
    case CodeLayout::classes:
      return get_classes(blob, count, where);
    case CodeLayout::bits:
      return get_bits(blob, count, where);
  }
  return {};
}

}  // namespace

std::string_view name_of(CodeLayout layout) {
  switch (layout) {
    case CodeLayout::planes:
      return "planes";
    case CodeLayout::classes:
      return "classes";
    case CodeLayout::bits:
      return "bits";
  }
  return "";
}

std::optional<CodeLayout> code_layout_from_name(std::string_view name) {
  if (name == "planes") return CodeLayout::planes;
  if (name == "classes") return CodeLayout::classes;
  if (name == "bits") return CodeLayout::bits;
  return std::nullopt;
}

std::vector<std::byte> entropy_code(std::span<const std::int32_t> numbers, NumberType type,
                                    CodeLayout layout, Neighbours neighbours) {
  const std::uint32_t mask = mask_of(type);
  std::vector<std::uint32_t> words(numbers.size());
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    auto word = static_cast<std::uint32_t>(numbers[i]);
    if (has_neighbour(i, neighbours)) {
      word -= static_cast<std::uint32_t>(numbers[i - neighbours.stride]);
    }
    word &= mask;
    words[i] = type.is_signed && layout == CodeLayout::planes ? zigzag(word) : word;
  }
  std::vector<std::byte> blob;
  switch (layout) {
    case CodeLayout::planes:
      put_planes(words, type, blob);
      break;
    case CodeLayout::classes:
      put_classes(words, blob);
      break;
    case CodeLayout::bits:
      put_bits(words, blob);
      break;
  }
  return blob;
}

std::vector<std::int32_t> entropy_decode(std::span<const std::byte> blob, std::size_t count,
                                         NumberType type, CodeLayout layout, Neighbours neighbours,
                                         std::string_view where) {
  const std::uint32_t mask = mask_of(type);
  std::vector<std::uint32_t> words = get_words(blob, count, type, layout, where);
  std::vector<std::int32_t> numbers(count);
  for (std::size_t i = 0; i < count; ++i) {
    std::uint32_t& word = words[i];
    if (type.is_signed && layout == CodeLayout::planes) word = from_zigzag(word);
    if (has_neighbour(i, neighbours)) word += words[i - neighbours.stride];
    word &= mask;
    numbers[i] = type.is_signed ? sign_extended(word) : static_cast<std::int32_t>(word);
  }
  return numbers;
}

}  // namespace weft
