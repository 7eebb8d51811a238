// The header is parsed as a stream of events, never as a tree: what a hostile file can make us hold
// is bounded by its own bytes, and nesting by the three levels that the format has.
#include "weft/io/safetensors_header.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"

namespace weft {
namespace {

using nlohmann::json;

constexpr std::string_view metadata_key = "__metadata__";

// One tensor's entry as it was read.
struct Entry {
  TensorInfo info;
  std::size_t begin = 0;
  std::size_t end = 0;
};

// Receives the parser's events:
//   { "__metadata__": { key: string }, NAME: { "dtype": string, "shape": [n], "data_offsets": [b,
//   e] } }
class HeaderEvents final : public json::json_sax_t {
 public:
  explicit HeaderEvents(std::string_view where) : where_(where) {}

  Metadata metadata;
  std::vector<Entry> entries;

  bool start_object(std::size_t) override {
    if (level_ == Level::outside) {
      level_ = Level::header;
    } else if (level_ == Level::header && !in_object_) {
      in_object_ = true;
    } else {
      fail_input("{}: {}: an object where none belongs", where_, place());
    }
    return true;
  }

  bool end_object() override {
    if (in_object_) {
      if (!in_metadata_) complete_entry();
      in_object_ = false;
      in_metadata_ = false;
      name_.clear();
      field_.clear();
    } else {
      level_ = Level::outside;
    }
    return true;
  }

  bool key(std::string& text) override {
    if (!in_object_) {
      name_ = text;
      field_.clear();
      in_metadata_ = text == metadata_key;
      if (!names_.insert(text).second) {
        fail_input("{}: header: \"{}\" appears twice", where_, shown(text));
      }
      if (!in_metadata_) {
        entry_ = Entry{};
        entry_.info.name = text;
        offsets_.clear();
        seen_.clear();
      }
      return true;
    }
    field_ = text;
    if (in_metadata_) {
      if (metadata.count(text) != 0) fail_input("{}: {} appears twice", where_, place());
      return true;
    }
    if (text != "dtype" && text != "shape" && text != "data_offsets") {
      fail_input("{}: {}: unknown field", where_, place());
    }
    if (!seen_.insert(text).second) fail_input("{}: {} appears twice", where_, place());
    return true;
  }

  bool string(std::string& text) override {
    if (in_object_ && in_metadata_) {
      metadata[field_] = text;
      return true;
    }
    if (!in_object_ || in_list_ || field_ != "dtype") unexpected("a string");
    const std::optional<DType> dtype = dtype_from_name(text);
    if (!dtype) {
      fail_input("{}: {}: \"{}\" is none of U8, U16, U32, F16, F32, F64", where_, place(),
                 shown(text));
    }
    entry_.info.dtype = *dtype;
    return true;
  }

  bool start_array(std::size_t) override {
    if (!in_object_ || in_metadata_ || in_list_ || field_ == "dtype") unexpected("a list");
    in_list_ = true;
    return true;
  }

  bool end_array() override {
    in_list_ = false;
    return true;
  }

  bool number_unsigned(json::number_unsigned_t value) override {
    if (!in_list_) unexpected("a number");
    (field_ == "shape" ? entry_.info.shape : offsets_).push_back(value);
    return true;
  }

  bool number_integer(json::number_integer_t value) override {
    if (!in_list_) unexpected("a number");
    fail_input("{}: {}: negative number {}", where_, place(), value);
  }
  bool number_float(json::number_float_t, const std::string& text) override {
    if (!in_list_) unexpected("a number");
    fail_input("{}: {}: {} is not an integer of 64 bits", where_, place(), shown(text));
  }
  bool null() override { unexpected("null"); }
  bool boolean(bool) override { unexpected("a truth value"); }
  bool binary(json::binary_t&) override { unexpected("binary data"); }

  bool parse_error(std::size_t, const std::string&, const json::exception& error) override {
    fail_input("{}: header is not valid JSON: {}", where_, shown(error.what()));
  }

 private:
  enum class Level { outside, header };

  std::string place() const {
    if (in_metadata_ && in_object_) return fmt::format("metadata \"{}\"", shown(field_));
    if (name_.empty() && !in_object_) return "header";
    if (field_.empty()) return fmt::format("tensor \"{}\"", shown(name_));
    return fmt::format("tensor \"{}\", field \"{}\"", shown(name_), shown(field_));
  }

  [[noreturn]] void unexpected(std::string_view what) const {
    if (in_metadata_ && in_object_) {
      fail_input("{}: {}: {} where only strings are allowed", where_, place(), what);
    }
    fail_input("{}: {}: {} where none belongs", where_, place(), what);
  }

  void complete_entry() {
    field_.clear();
    for (const char* field : {"dtype", "shape", "data_offsets"}) {
      if (seen_.count(field) == 0) fail_input("{}: {} has no {}", where_, place(), field);
    }
    if (offsets_.size() != 2) {
      fail_input("{}: {}: data_offsets holds {} numbers instead of 2", where_, place(),
                 offsets_.size());
    }
    entry_.begin = offsets_[0];
    entry_.end = offsets_[1];
    entries.push_back(std::move(entry_));
  }

  std::string where_;
  Level level_ = Level::outside;
  bool in_object_ = false;    // inside a tensor's entry or the metadata
  bool in_metadata_ = false;  // the current name is that of the metadata
  bool in_list_ = false;
  std::string name_;
  std::string field_;
  std::set<std::string> names_;
  std::set<std::string> seen_;  // fields of the current entry
  Entry entry_;
  std::vector<std::size_t> offsets_;
};

// Bytes of a tensor, or nothing if they do not fit a size_t.
std::optional<std::size_t> checked_bytes(const TensorInfo& tensor) {
  std::size_t bytes = size_of(tensor.dtype);
  for (const std::size_t size : tensor.shape) {
    if (__builtin_mul_overflow(bytes, size, &bytes)) return std::nullopt;
  }
  return bytes;
}

void check_extent(const Entry& entry, std::size_t data_size, std::string_view where) {
  const std::string name = shown(entry.info.name);
  if (entry.begin > entry.end) {
    fail_input("{}: tensor \"{}\": data_offsets [{}, {}] run backwards", where, name, entry.begin,
               entry.end);
  }
  if (entry.end > data_size) {
    fail_input("{}: tensor \"{}\": data_offsets [{}, {}] pass the end of the data, {} bytes", where,
               name, entry.begin, entry.end, data_size);
  }
  const std::optional<std::size_t> bytes = checked_bytes(entry.info);
  if (!bytes) {
    fail_input("{}: tensor \"{}\": shape {} of {} overflows", where, name,
               shape_text(entry.info.shape), name_of(entry.info.dtype));
  }
  if (*bytes != entry.end - entry.begin) {
    fail_input("{}: tensor \"{}\": shape {} of {} takes {} bytes, data_offsets [{}, {}] hold {}",
               where, name, shape_text(entry.info.shape), name_of(entry.info.dtype), *bytes,
               entry.begin, entry.end, entry.end - entry.begin);
  }
}

}  // namespace

SafetensorsHeader parse_safetensors_header(std::string_view text, std::size_t data_size,
                                           std::string_view where) {
  if (text.empty() || text.front() != '{') {
    fail_input("{}: header does not begin with '{{'", where);
  }
  // The parser takes a NUL for the end of the text.
  if (text.find('\0') != std::string_view::npos) fail_input("{}: NUL character in header", where);
  HeaderEvents events(where);
  json::sax_parse(text, &events);

  // In order of offsets, each must begin where the one before ends.
  std::vector<Entry>& entries = events.entries;
  for (const Entry& entry : entries) check_extent(entry, data_size, where);
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return a.begin != b.begin ? a.begin < b.begin : a.end < b.end;
  });
  std::size_t reached = 0;
  for (const Entry& entry : entries) {
    if (entry.begin != reached) {
      fail_input("{}: tensor \"{}\": begins at {}, {} the {} bytes before it", where,
                 shown(entry.info.name), entry.begin,
                 entry.begin < reached ? "overlapping" : "leaving a gap after", reached);
    }
    reached = entry.end;
  }
  if (reached != data_size) {
    fail_input("{}: {} bytes after the last tensor", where, data_size - reached);
  }

  SafetensorsHeader header;
  header.metadata = std::move(events.metadata);
  for (Entry& entry : entries) {
    header.tensors.push_back(std::move(entry.info));
    header.begins.push_back(entry.begin);
  }
  return header;
}

std::string format_safetensors_header(const SafetensorsHeader& header, std::string_view where) {
  nlohmann::ordered_json root = nlohmann::ordered_json::object();
  if (!header.metadata.empty()) root[std::string(metadata_key)] = header.metadata;
  for (std::size_t i = 0; i < header.tensors.size(); ++i) {
    const TensorInfo& tensor = header.tensors[i];
    nlohmann::ordered_json entry;
    entry["dtype"] = name_of(tensor.dtype);
    entry["shape"] = tensor.shape;
    entry["data_offsets"] = {header.begins[i], header.begins[i] + tensor.bytes()};
    root[tensor.name] = std::move(entry);
  }
  try {
    return root.dump();
  } catch (const nlohmann::json::exception& error) {
    fail_input("{}: header can't be written: {}", where, shown(error.what()));
  }
}

SafetensorsHeader plan_safetensors(std::vector<TensorInfo> tensors, Metadata metadata,
                                   std::string_view where) {
  SafetensorsHeader header;
  header.metadata = std::move(metadata);
  header.tensors = std::move(tensors);
  std::stable_sort(
      header.tensors.begin(), header.tensors.end(),
      [](const TensorInfo& a, const TensorInfo& b) { return size_of(a.dtype) > size_of(b.dtype); });
  std::set<std::string_view> names;
  std::size_t end = 0;
  for (const TensorInfo& tensor : header.tensors) {
    if (tensor.name.empty() || tensor.name == metadata_key || !names.insert(tensor.name).second) {
      fail_input("{}: tensor name \"{}\" is empty, reserved or given twice", where,
                 shown(tensor.name));
    }
    header.begins.push_back(end);
    const std::optional<std::size_t> bytes = checked_bytes(tensor);
    if (!bytes || __builtin_add_overflow(end, *bytes, &end)) {
      fail_input("{}: tensor \"{}\": shape {} is too large", where, shown(tensor.name),
                 shape_text(tensor.shape));
    }
  }
  return header;
}

std::size_t padded_header_size(std::size_t text_bytes, std::size_t reserve) {
  constexpr std::size_t alignment = 64;
  constexpr std::size_t length_bytes = 8;
  const std::size_t end = length_bytes + text_bytes + reserve;
  return (end + alignment - 1) / alignment * alignment - length_bytes;
}

}  // namespace weft
