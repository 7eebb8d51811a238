#include "weft/codecs/rank_options.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>

#include "weft/error.hpp"

namespace weft {

std::string_view value_of(const Codec& codec, const Parameters& parameters, std::string_view name) {
  const auto given = parameters.find(name);
  if (given != parameters.end()) return given->second;
  for (const ParameterSpec& spec : codec.parameters()) {
    if (spec.name == name) return spec.default_value;
  }
  return {};
}

std::vector<std::size_t> named_ranks(const ModeGroups& groups, std::string_view text) {
  std::vector<std::size_t> ranks(groups.count(), 0);
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    const std::string_view part = text.substr(at, end - at);
    const std::size_t equals = part.find('=');
    const std::string_view digits =
        equals == std::string_view::npos ? std::string_view() : part.substr(equals + 1);
    std::size_t rank = 0;
    const auto [stop, status] = std::from_chars(digits.data(), digits.data() + digits.size(), rank);
    if (status != std::errc() || stop != digits.data() + digits.size() || rank == 0 ||
        end + 1 == text.size()) {
      fail_input("--ranks {}: '{}' is not MODE=RANK with a rank of at least 1", text, part);
    }
    const std::size_t n = groups.find(part.substr(0, equals), fmt::format("--ranks {}", text));
    const ModeGroup& group = groups.groups()[n];
    if (ranks[n] != 0) fail_input("--ranks {}: mode {} is named twice", text, group.name);
    if (rank > group.size) {
      fail_input("--ranks {}: rank {} is above the size {} of mode {}", text, rank, group.size,
                 group.name);
    }
    ranks[n] = rank;
    at = end + 1;
  }
  return ranks;
}

std::string ranks_json(const ModeGroups& groups, std::span<const std::size_t> ranks) {
  std::string text;
  for (std::size_t n = 0; n < groups.count(); ++n) {
    text += fmt::format("{}\"{}\":{}", text.empty() ? "" : ",", groups.groups()[n].name, ranks[n]);
  }
  return text;
}

}  // namespace weft
