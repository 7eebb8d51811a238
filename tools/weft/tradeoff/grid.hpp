// The points that `weft tradeoff` measures: a codec with options of `weft compress`.
//
// A grid is a JSON array, or an object with one as `points`. An element is the text of one point,
// as "pca --rank 16 --storage f32", or an object of options without their dashes, which stands for
// all combinations of what its lists hold:
//
//   {"codec": ["pca", "view-pca"], "rank": [4, 8], "storage": ["f16", "f32"]}      8 points
//
// Values are texts or numbers; true is an option without value, and false or null one that is
// absent.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace weft {

struct TradeoffPoint {
  std::string codec;
  std::vector<std::string> options;  // words after --codec NAME, as {"--rank", "16"}

  bool operator==(const TradeoffPoint&) const = default;
};

// "pca --rank 16", with quotes where a shell needs them.
std::string text_of(const TradeoffPoint& point);

// Splits at blanks, but not inside single or double quotes. Throws an input error that names
// `where` for a quote that is not closed.
std::vector<std::string> split_words(std::string_view text, std::string_view where);
// Joins words so that a shell takes them apart again.
std::string join_words(const std::vector<std::string>& words);

// "CODEC [OPTION...]", also with --codec in front. Throws an input error that names `where`.
TradeoffPoint parse_point(std::string_view text, std::string_view where);

// All points of a grid in its order, each once. Throws an input error that names `where` and the
// element.
std::vector<TradeoffPoint> parse_grid(std::string_view text, std::string_view where);
std::vector<TradeoffPoint> read_grid(const std::filesystem::path& path);

// The grid that is measured where none is given, as JSON.
std::string_view default_grid_text();

// Throws an input error that names the point unless `weft compress` takes its options; those that a
// run itself gives (the output, --json, --ssim) are no options of a point.
void check_point(const TradeoffPoint& point);

}  // namespace weft
