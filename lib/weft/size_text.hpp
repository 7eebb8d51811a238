// Sizes in bytes as people write them.
#pragma once

#include <cstddef>
#include <string_view>

namespace weft {

// "1GiB", "1.5G", "512MiB", "64KiB", "4000000", "1GB": K, M, G, T with or without iB are powers of
// 1024; kB, MB, GB, TB powers of 1000; no unit means bytes. At least 1. Throws an input error that
// names `option` and the text.
std::size_t parse_size(std::string_view text, std::string_view option);

}  // namespace weft
