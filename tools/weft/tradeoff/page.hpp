// index.html of a trade-off: one file that needs no other and asks no network.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "tradeoff/results.hpp"

namespace weft {

// Pictures take at most so many bytes of a page, which stays below 20 MB: where they would take
// more, they are embedded smaller, and at last the points' that come last are left out.
constexpr std::size_t page_picture_bytes = 17'000'000;

// The page, with the pictures that are in the folder.
std::string make_page(const std::filesystem::path& folder, const TradeoffResults& results,
                      std::size_t picture_bytes = page_picture_bytes);

}  // namespace weft
