// A manifest as it is read, whatever its form: the two parsers fill it, manifest.cpp uses it.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "weft/btf/btf.hpp"

namespace weft {

// An index into a list of directions, or a direction itself.
using DirectionOrIndex = std::variant<std::size_t, Direction>;

struct ManifestRow {
  std::string file;
  DirectionOrIndex view;
  DirectionOrIndex light;
  std::string where;  // the line or the entry, for messages
};

struct ManifestTable {
  std::vector<ManifestRow> rows;
  std::vector<Direction> views;  // what indices refer to; may be empty
  std::vector<Direction> lights;
  std::optional<Encoding> encoding;
  std::optional<Quantity> quantity;
  std::optional<Layout> layout;
  std::string source;
  std::vector<std::string> channel_names;
  std::string mask_file;                                       // or empty
  std::function<std::vector<std::uint8_t>(std::size_t)> mask;  // by size, or empty
};

// The text of a file beside the manifest; nothing if there is none.
using TextBeside = std::function<std::optional<std::string>(const std::string& name)>;

ManifestTable parse_csv_manifest(std::string_view text, const std::string& where,
                                 const TextBeside& beside);
ManifestTable parse_json_manifest(std::string_view text, const std::string& where);

}  // namespace weft
