// What a subcommand has to say: an ordered set of fields, printed as an aligned table for people or
// as one JSON object. A field has one name, `psnr_peak` in JSON and `psnr peak` in the table.
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "common.hpp"

namespace weft {

struct KernelTime;

// A value in both of its forms.
struct Cell {
  std::string text;
  std::string json;
  bool is_number = false;  // numbers are aligned to the right in tables
};

Cell text_cell(std::string_view value);
Cell count_cell(std::uint64_t value, std::string_view unit = "");
// `digits` significant digits in the table, all of them in JSON; infinities and NaN are JSON
// strings, as in to_json(ErrorReport).
Cell number_cell(double value, std::string_view unit = "", int digits = 4);
Cell flag_cell(bool value);
// "615.1 MiB (644972544 bytes)"; the number of bytes in JSON.
Cell bytes_cell(std::uint64_t bytes);
// A JSON value as it is; the same text stands in the table.
Cell json_cell(std::string_view json);

class Report {
 public:
  Report() = default;
  // Fields point to their sections, which a move leaves where they are and a copy would not.
  Report(Report&&) = default;
  Report& operator=(Report&&) = default;

  Report& add(std::string_view name, Cell value);
  Report& add(std::string_view name, std::string_view value) { return add(name, text_cell(value)); }
  Report& add(std::string_view name, const char* value) { return add(name, text_cell(value)); }
  Report& add(std::string_view name, bool value) { return add(name, flag_cell(value)); }
  template <std::integral T>
  requires(!std::same_as<T, bool>) Report& add(std::string_view name, T value,
                                               std::string_view unit = "") {
    return add(name, count_cell(static_cast<std::uint64_t>(value), unit));
  }
  Report& add(std::string_view name, double value, std::string_view unit = "") {
    return add(name, number_cell(value, unit));
  }

  // Fields under a heading: an object in JSON. The reference stays valid.
  Report& section(std::string_view name);

  // One more object of an array in JSON; in the table the objects of `name` follow each other,
  // without heading, after an empty line. The reference stays valid.
  Report& item(std::string_view name);

  // Rows under a heading: an array of objects in JSON. Every row has as many cells as columns.
  void table(std::string_view name, std::vector<std::string> columns,
             std::vector<std::vector<Cell>> rows);

  std::string to_json() const;
  std::string to_text() const;

  // One of the two on standard output; no text under --quiet. Throws a run-time error if it can't
  // be written.
  void print(const OutputOptions& options) const;

 private:
  struct Field {
    std::string name;
    Cell value;
    const Report* section = nullptr;
    std::vector<const Report*> items;
    std::vector<std::string> columns;
    std::vector<std::vector<Cell>> rows;
    bool is_table = false;
  };
  void append_text(std::string& out, std::size_t indent) const;

  std::vector<Field> fields_;
  std::deque<Report> sections_;
};

// The time spent in each kernel, for --profile.
void add_profile_table(Report& report, const std::map<std::string, KernelTime>& profile);

// "615.1 MiB", "12.0 KiB", "37 bytes".
std::string format_bytes(std::uint64_t bytes);
// "1.25 s", "3 min 20 s", "12.5 ms".
std::string format_seconds(double seconds);

}  // namespace weft
