// Damage to valid files, for tests that nothing but an Error may come out of reading them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>

#include "support/generators.hpp"

namespace weft::test {

// One to four random edits within the first `extent` bytes: bits flipped, bytes replaced by bytes
// that mean something in JSON or in a length, pieces cut out, doubled or overwritten by zeros; one
// time in eight the file is truncated besides.
inline std::string mutate(std::string bytes, std::size_t extent, Random& random) {
  constexpr char tokens[] = "{}[]\",:0123456789-.eE\\ \xff\x80\x7f\x01NaUF";
  const std::size_t edits = 1 + random.index(4);
  for (std::size_t edit = 0; edit < edits && !bytes.empty(); ++edit) {
    const std::size_t position = random.index(std::min(extent, bytes.size()));
    const std::size_t length = std::min(1 + random.index(12), bytes.size() - position);
    switch (random.index(5)) {
      case 0:
        bytes[position] = static_cast<char>(bytes[position] ^ (1 << random.index(8)));
        break;
      case 1:
        bytes[position] = tokens[random.index(sizeof(tokens) - 1)];
        break;
      case 2:
        bytes.erase(position, length);
        break;
      case 3:
        bytes.insert(position, bytes.substr(position, length));
        break;
      default:
        std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(position), length, '\0');
    }
  }
  if (random.index(8) == 0) bytes.resize(random.index(bytes.size() + 1));
  return bytes;
}

// The same edits inside the JSON header of a safetensors file, whose length is set right again, so
// that what lies behind the first check is reached.
inline std::string mutate_header(const std::string& bytes, Random& random) {
  std::size_t length = 0;
  for (std::size_t i = 8; i-- > 0;) length = length << 8 | static_cast<unsigned char>(bytes[i]);
  const std::string header = mutate(bytes.substr(8, length), length, random);
  std::string result;
  for (int i = 0; i < 8; ++i) result += static_cast<char>(header.size() >> (8 * i) & 0xff);
  return result + header + bytes.substr(8 + length);
}

}  // namespace weft::test
