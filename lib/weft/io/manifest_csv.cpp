#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>

#include "weft/error.hpp"
#include "weft/io/fixed_view.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/manifest_table.hpp"

namespace weft {
namespace {

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view blanks = " \t\r";
  const std::size_t first = text.find_first_not_of(blanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(blanks) - first + 1);
}

// The fields of one line; a field in double quotes may hold commas, and "" for a quote.
std::vector<std::string> split(std::string_view line, const std::string& where) {
  std::vector<std::string> fields;
  while (true) {
    line = trimmed(line);
    std::string field;
    if (line.starts_with('"')) {
      std::size_t at = 1;
      while (true) {
        if (at >= line.size()) fail_input("{}: a quote is not closed", where);
        if (line[at] != '"') {
          field += line[at++];
        } else if (at + 1 < line.size() && line[at + 1] == '"') {
          field += '"';
          at += 2;
        } else {
          break;
        }
      }
      line = trimmed(line.substr(at + 1));
      if (!line.empty() && line.front() != ',') fail_input("{}: text behind a quote", where);
      fields.push_back(field);
      if (line.empty()) return fields;
      line.remove_prefix(1);
      continue;
    }
    const std::size_t comma = line.find(',');
    fields.emplace_back(trimmed(line.substr(0, comma)));
    if (comma == std::string_view::npos) return fields;
    line.remove_prefix(comma + 1);
  }
}

double number(const std::string& text, const std::string& where) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) {
    fail_input("{}: '{}' is not a number", where, shown(text));
  }
  return value;
}

std::size_t index(const std::string& text, const std::string& where) {
  std::size_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    fail_input("{}: '{}' is not an index", where, shown(text));
  }
  return value;
}

using Columns = std::map<std::string, std::size_t>;

// How the view or the light of a row is given.
class DirectionColumns {
 public:
  // `side` is "view" or "light".
  DirectionColumns(const Columns& columns, const std::string& side, const std::string& where) {
    const auto find = [&](const std::string& name) -> std::optional<std::size_t> {
      const auto found = columns.find(side + name);
      if (found == columns.end()) return std::nullopt;
      return found->second;
    };
    index_ = find("");
    const std::array angles{find("_theta"), find("_phi")};
    const std::array axes{find("_x"), find("_y"), find("_z")};
    const auto given = [](const auto& column) { return column.has_value(); };
    const auto count = [&](const auto& all) {
      return std::count_if(all.begin(), all.end(), given);
    };
    const int forms = (index_ ? 1 : 0) + (count(angles) > 0 ? 1 : 0) + (count(axes) > 0 ? 1 : 0);
    if (forms > 1) fail_input("{}: the {} is given in more than one form", where, side);
    if (count(angles) == 1 || count(axes) == 1 || count(axes) == 2) {
      fail_input("{}: columns of the {} are missing: {}_theta,{}_phi or {}_x,{}_y,{}_z", where,
                 side, side, side, side, side, side);
    }
    if (count(angles) == 2) angles_ = {*angles[0], *angles[1]};
    if (count(axes) == 3) axes_ = {*axes[0], *axes[1], *axes[2]};
    given_ = forms == 1;
  }

  bool given() const { return given_; }
  bool is_index() const { return index_.has_value(); }

  DirectionOrIndex read(const std::vector<std::string>& fields, const std::string& where) const {
    if (index_) return index(fields[*index_], where);
    if (angles_) {
      return direction_from_degrees(number(fields[(*angles_)[0]], where),
                                    number(fields[(*angles_)[1]], where));
    }
    if (axes_) {
      return unit_direction({number(fields[(*axes_)[0]], where), number(fields[(*axes_)[1]], where),
                             number(fields[(*axes_)[2]], where)},
                            1e-3, where);
    }
    return Direction{0, 0, 1};
  }

 private:
  bool given_ = false;
  std::optional<std::size_t> index_;
  std::optional<std::array<std::size_t, 2>> angles_;
  std::optional<std::array<std::size_t, 3>> axes_;
};

Columns read_columns(const std::vector<std::string>& names, const std::string& where) {
  constexpr std::array<std::string_view, 13> known{
      "file",  "view",        "view_theta", "view_phi", "view_x",  "view_y", "view_z",
      "light", "light_theta", "light_phi",  "light_x",  "light_y", "light_z"};
  Columns columns;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (std::find(known.begin(), known.end(), names[i]) == known.end()) {
      fail_input("{}: column '{}' is none of {}", where, shown(names[i]), fmt::join(known, ", "));
    }
    if (!columns.emplace(names[i], i).second) {
      fail_input("{}: column '{}' comes twice", where, names[i]);
    }
  }
  if (!columns.contains("file")) fail_input("{}: no column 'file'", where);
  return columns;
}

std::vector<Direction> directions_beside(const TextBeside& beside, const std::string& name,
                                         const std::string& where) {
  const std::optional<std::string> text = beside(name);
  if (!text) fail_input("{}: indices need a {} beside the manifest", where, name);
  return parse_directions(*text, name + " beside " + where);
}

}  // namespace

ManifestTable parse_csv_manifest(std::string_view text, const std::string& where,
                                 const TextBeside& beside) {
  ManifestTable table;
  Columns columns;
  std::optional<DirectionColumns> view, light;
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);  // a byte order mark
  for (std::size_t line_number = 1; !text.empty(); ++line_number) {
    const std::size_t end = text.find('\n');
    const std::string_view line = trimmed(text.substr(0, end));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (line.empty() || line.starts_with('#')) continue;
    const std::string line_name = fmt::format("{}:{}", where, line_number);
    const std::vector<std::string> fields = split(line, line_name);
    if (columns.empty()) {
      columns = read_columns(fields, line_name);
      view.emplace(columns, "view", line_name);
      light.emplace(columns, "light", line_name);
      if (!light->given()) fail_input("{}: no columns for the light", line_name);
      if (view->is_index()) table.views = directions_beside(beside, "views.txt", where);
      if (light->is_index()) table.lights = directions_beside(beside, "lights.txt", where);
      continue;
    }
    if (fields.size() != columns.size()) {
      fail_input("{}: {} fields for {} columns", line_name, fields.size(), columns.size());
    }
    table.rows.push_back({fields[columns.at("file")], view->read(fields, line_name),
                          light->read(fields, line_name), line_name});
  }
  if (columns.empty()) fail_input("{}: no header line", where);
  return table;
}

}  // namespace weft
