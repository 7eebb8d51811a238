#include "report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

#include "weft/device/device.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

// Text from files may hold any bytes: what is not UTF-8 is replaced, so that JSON stays valid.
std::string json_string(std::string_view text) {
  return nlohmann::json(std::string(text))
      .dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string with_unit(std::string text, std::string_view unit) {
  if (!unit.empty()) text.append(" ").append(unit);
  return text;
}

std::string label(std::string_view name) {
  std::string words(name);
  std::replace(words.begin(), words.end(), '_', ' ');
  return words;
}

// Characters as a terminal counts them: continuation bytes of UTF-8 take no column.
std::size_t display_width(std::string_view text) {
  return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U;
  }));
}

std::string padded(std::string_view text, std::size_t width, bool right) {
  const std::size_t used = display_width(text);
  const std::string space(used < width ? width - used : 0, ' ');
  return right ? space + std::string(text) : std::string(text) + space;
}

std::string trimmed(std::string line) {
  line.erase(line.find_last_not_of(' ') + 1);
  return line;
}

}  // namespace

Cell text_cell(std::string_view value) {
  // Text from a file must not steer the terminal.
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; };
  std::string text(value);
  std::replace_if(text.begin(), text.end(), is_control, '?');
  return {std::move(text), json_string(value)};
}

Cell count_cell(std::uint64_t value, std::string_view unit) {
  return {with_unit(fmt::format("{}", value), unit), fmt::format("{}", value), true};
}

Cell number_cell(double value, std::string_view unit, int digits) {
  const std::string text = with_unit(fmt::format("{:.{}g}", value, digits), unit);
  if (std::isfinite(value)) return {text, fmt::format("{}", value), true};
  return {text, std::isnan(value) ? "\"nan\"" : value > 0 ? "\"inf\"" : "\"-inf\"", true};
}

Cell flag_cell(bool value) {
  return {value ? "yes" : "no", value ? "true" : "false"};
}

Cell bytes_cell(std::uint64_t bytes) {
  std::string text = format_bytes(bytes);
  if (bytes >= 1024) text += fmt::format(" ({} bytes)", bytes);
  return {text, fmt::format("{}", bytes), true};
}

Cell json_cell(std::string_view json) {
  return {std::string(json), std::string(json)};
}

Report& Report::add(std::string_view name, Cell value) {
  Field field;
  field.name = name;
  field.value = std::move(value);
  fields_.push_back(std::move(field));
  return *this;
}

Report& Report::section(std::string_view name) {
  Field field;
  field.name = name;
  field.section = &sections_.emplace_back();
  fields_.push_back(std::move(field));
  return sections_.back();
}

Report& Report::item(std::string_view name) {
  auto field = std::find_if(fields_.begin(), fields_.end(),
                            [name](const Field& known) { return known.name == name; });
  if (field == fields_.end()) {
    fields_.emplace_back().name = name;
    field = std::prev(fields_.end());
  }
  field->items.push_back(&sections_.emplace_back());
  return sections_.back();
}

void Report::table(std::string_view name, std::vector<std::string> columns,
                   std::vector<std::vector<Cell>> rows) {
  Field field;
  field.name = name;
  field.columns = std::move(columns);
  field.rows = std::move(rows);
  field.is_table = true;
  fields_.push_back(std::move(field));
}

std::string Report::to_json() const {
  std::string out = "{";
  for (const Field& field : fields_) {
    if (&field != &fields_.front()) out += ",";
    out += json_string(field.name) + ":";
    if (field.section) {
      out += field.section->to_json();
    } else if (!field.items.empty()) {
      for (std::size_t i = 0; i < field.items.size(); ++i) {
        out += (i == 0 ? "[" : ",") + field.items[i]->to_json();
      }
      out += "]";
    } else if (field.is_table) {
      out += "[";
      for (std::size_t r = 0; r < field.rows.size(); ++r) {
        out += r == 0 ? "{" : ",{";
        for (std::size_t c = 0; c < field.columns.size(); ++c) {
          if (c > 0) out += ",";
          out += json_string(field.columns[c]) + ":" + field.rows[r][c].json;
        }
        out += "}";
      }
      out += "]";
    } else {
      out += field.value.json;
    }
  }
  return out + "}";
}

std::string Report::to_text() const {
  std::string out;
  append_text(out, 0);
  return out;
}

void Report::append_text(std::string& out, std::size_t indent) const {
  std::size_t width = 0;
  for (const Field& field : fields_) {
    const bool is_value = !field.section && field.items.empty() && !field.is_table;
    if (is_value) width = std::max(width, display_width(field.name));
  }
  const std::string margin(indent, ' ');
  for (const Field& field : fields_) {
    if (field.section) {
      out += margin + label(field.name) + "\n";
      field.section->append_text(out, indent + 2);
    } else if (!field.items.empty()) {
      for (const Report* item : field.items) {
        if (!out.empty()) out += "\n";
        item->append_text(out, indent);
      }
    } else if (field.is_table) {
      // A column is as wide as its widest cell, its heading included.
      std::vector<std::size_t> widths;
      for (std::size_t c = 0; c < field.columns.size(); ++c) {
        widths.push_back(display_width(field.columns[c]));
        for (const auto& row : field.rows) {
          widths[c] = std::max(widths[c], display_width(row[c].text));
        }
      }
      if (!field.name.empty()) out += margin + label(field.name) + "\n";
      std::string line = margin + (indent == 0 && field.name.empty() ? "" : "  ");
      const std::string start = line;
      for (std::size_t c = 0; c < field.columns.size(); ++c) {
        const bool right = !field.rows.empty() && field.rows.front()[c].is_number;
        line += padded(label(field.columns[c]), widths[c] + (right ? 0 : 2), right);
        if (right) line += "  ";
      }
      out += trimmed(line) + "\n";
      for (const auto& row : field.rows) {
        line = start;
        for (std::size_t c = 0; c < field.columns.size(); ++c) {
          line += padded(row[c].text, widths[c], field.rows.front()[c].is_number) + "  ";
        }
        out += trimmed(line) + "\n";
      }
    } else {
      out +=
          trimmed(margin + padded(label(field.name), width + 2, false) + field.value.text) + "\n";
    }
  }
}

void Report::print(const OutputOptions& options) const {
  if (options.quiet && !options.json) return;
  const std::string text = options.json ? to_json() + "\n" : to_text();
  const bool written = std::fwrite(text.data(), 1, text.size(), stdout) == text.size();
  if (!written || std::fflush(stdout) != 0) fail_runtime("standard output can't be written");
}

void add_profile_table(Report& report, const std::map<std::string, KernelTime>& profile) {
  std::vector<std::vector<Cell>> rows;
  for (const auto& [kernel, time] : profile) {
    rows.push_back({text_cell(kernel), count_cell(time.launches), number_cell(time.seconds, "s")});
  }
  report.table("kernels", {"kernel", "launches", "time"}, std::move(rows));
}

std::string format_bytes(std::uint64_t bytes) {
  constexpr const char* names[] = {"KiB", "MiB", "GiB", "TiB", "PiB"};
  if (bytes < 1024) return fmt::format("{} bytes", bytes);
  double value = static_cast<double>(bytes) / 1024.0;
  std::size_t unit = 0;
  while (value >= 1024.0 && unit + 1 < std::size(names)) {
    value /= 1024.0;
    ++unit;
  }
  return fmt::format("{:.1f} {}", value, names[unit]);
}

std::string format_seconds(double seconds) {
  if (seconds < 1.0) return fmt::format("{:.3g} ms", seconds * 1e3);
  if (seconds < 59.95) return fmt::format("{:.3g} s", seconds);
  const double whole = std::round(seconds);
  const double minutes = std::floor(whole / 60.0);
  if (minutes < 60.0) return fmt::format("{:.0f} min {:.0f} s", minutes, whole - 60.0 * minutes);
  const double hours = std::floor(minutes / 60.0);
  return fmt::format("{:.0f} h {:.0f} min", hours, minutes - 60.0 * hours);
}

}  // namespace weft
