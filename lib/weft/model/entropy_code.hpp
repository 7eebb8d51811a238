// Whole numbers as an entropy-coded blob: differences along one axis where these are smaller, laid
// out as bytes of which each kind has its own zstd frame.
//
//   planes:  a frame of all numbers' lowest bytes, then one of the bytes above, ...; upper frames
//   of
//            nothing but zeros are left out. Signed numbers are 2 n for n >= 0, else -2 n - 1.
//   classes: a frame of the bit lengths of |n|, a byte each; then, packed from the lowest bit on,
//   the
//            sign and the bits below the highest of each n that is not 0. What is packed has next
//            to no redundancy, and the lengths, whose statistics zstd then meets alone, have the
//            rest.
//   bits:    a frame of unsigned numbers of 0 and 1, eight in a byte from its lowest bit on, with
//            zeros behind the last; without differences.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

namespace weft {

enum class CodeLayout : std::uint8_t { planes, classes, bits };

// "planes" "classes" "bits"; the inverse is empty for another name.
std::string_view name_of(CodeLayout layout);
std::optional<CodeLayout> code_layout_from_name(std::string_view name);

// Numbers of so many bytes: two's complement of 2 bytes if signed, else unsigned of 1, 2 or 4.
struct NumberType {
  std::size_t bytes = 2;
  bool is_signed = true;
};

// Where a number's neighbour along an axis is: `stride` before it, unless it is the first of
// `size`. size 1: no differences.
struct Neighbours {
  std::size_t stride = 1;
  std::size_t size = 1;
};

// The numbers mod 2^(8 bytes).
std::vector<std::byte> entropy_code(std::span<const std::int32_t> numbers, NumberType type,
                                    CodeLayout layout, Neighbours neighbours);

// The inverse, `count` numbers. Throws an input error that begins with `where` for a blob that
// holds anything else. Allocates no more than twice what the blob has shown to hold.
std::vector<std::int32_t> entropy_decode(std::span<const std::byte> blob, std::size_t count,
                                         NumberType type, CodeLayout layout, Neighbours neighbours,
                                         std::string_view where);

}  // namespace weft
