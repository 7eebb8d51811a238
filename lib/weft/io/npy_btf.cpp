// NAME.npy with NAME.json beside it. Example of the JSON:
//   {"axes": ["view", "light", "y", "x", "channel"], "views": [{"theta": 0, "phi": 0}, ...],
//    "lights": [{"dir": [0, 0, 1]}, ...], "encoding": "linear"}
// A mask is stored there as the lengths of its runs, beginning with a run of zeros (`mask_runs`).
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/atomic_file.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/mapped_btf.hpp"
#include "weft/io/npy.hpp"

namespace weft {
namespace {

using nlohmann::json;

std::filesystem::path json_beside(std::filesystem::path path) {
  return path.replace_extension(".json");
}

double number(const json& value, const std::string& where) {
  if (!value.is_number()) fail_input("{}: not a number", where);
  return value.get<double>();
}

// {"dir": [x, y, z]}, {"theta": t, "phi": p}, [x, y, z] or [t, p].
Direction read_direction(const json& value, const std::string& where) {
  if (value.is_object() && value.contains("dir")) return read_direction(value["dir"], where);
  if (value.is_object() && value.contains("theta") && value.contains("phi")) {
    return direction_from_degrees(number(value["theta"], where), number(value["phi"], where));
  }
  if (value.is_array() && value.size() == 2) {
    return direction_from_degrees(number(value[0], where), number(value[1], where));
  }
  if (value.is_array() && value.size() == 3) {
    return {static_cast<float>(number(value[0], where)),
            static_cast<float>(number(value[1], where)),
            static_cast<float>(number(value[2], where))};
  }
  fail_input("{}: neither [x, y, z] nor theta and phi in degrees", where);
}

std::vector<Direction> read_directions(const json& root, const char* key,
                                       const std::string& where) {
  const auto list = root.find(key);
  if (list == root.end() || !list->is_array()) fail_input("{}: no list \"{}\"", where, key);
  std::vector<Direction> directions;
  for (std::size_t i = 0; i < list->size(); ++i) {
    directions.push_back(read_direction((*list)[i], fmt::format("{}: {}[{}]", where, key, i)));
  }
  return directions;
}

// A string; `absent` where there is none.
std::string read_string(const json& root, const char* key, const std::string& absent,
                        const std::string& where) {
  const auto value = root.find(key);
  if (value == root.end()) return absent;
  if (!value->is_string()) fail_input("{}: \"{}\" is not a string", where, key);
  return value->get<std::string>();
}

void check_axes(const json& root, const std::string& where) {
  const auto axes = root.find("axes");
  if (axes == root.end()) return;
  if (*axes != json{"view", "light", "y", "x", "channel"} &&
      *axes != json{"v", "l", "y", "x", "c"}) {
    fail_input("{}: \"axes\" are not view, light, y, x, channel", where);
  }
}

std::vector<std::string> read_channel_names(const json& root, const std::string& where) {
  std::vector<std::string> names;
  const auto list = root.find("channel_names");
  if (list == root.end()) return names;
  if (!list->is_array()) fail_input("{}: \"channel_names\" is no list", where);
  for (const json& name : *list) {
    if (!name.is_string()) fail_input("{}: \"channel_names\" holds more than strings", where);
    names.push_back(name.get<std::string>());
  }
  return names;
}

json mask_runs(const std::vector<std::uint8_t>& mask) {
  json runs = json::array();
  std::size_t length = 0;
  std::uint8_t current = 0;
  for (const std::uint8_t value : mask) {
    if (value != current) {
      runs.push_back(std::exchange(length, 0));
      current = value;
    }
    ++length;
  }
  runs.push_back(length);
  return runs;
}

// `size` is no mere claim: the values of as many texels are in the file.
std::vector<std::uint8_t> read_mask(const json& root, std::size_t size, const std::string& where) {
  std::vector<std::uint8_t> mask;
  const auto runs = root.find("mask_runs");
  if (runs == root.end()) return mask;
  if (!runs->is_array()) fail_input("{}: \"mask_runs\" is no list", where);
  std::uint8_t current = 0;
  for (const json& run : *runs) {
    if (!run.is_number_unsigned() || run.get<std::size_t>() > size - mask.size()) {
      fail_input("{}: \"mask_runs\" do not add up to the {} texels of all views", where, size);
    }
    mask.insert(mask.end(), run.get<std::size_t>(), current);
    current ^= 1;
  }
  if (mask.size() != size) {
    fail_input("{}: \"mask_runs\" add up to {} of the {} texels of all views", where, mask.size(),
               size);
  }
  return mask;
}

json directions_json(const std::vector<Direction>& directions) {
  json list = json::array();
  for (const Direction& direction : directions) {
    list.push_back(
        {{"dir", direction}, {"theta", theta_degrees(direction)}, {"phi", phi_degrees(direction)}});
  }
  return list;
}

std::string describe(const BtfInfo& info, const std::string& where) {
  const BtfShape& shape = info.shape;
  nlohmann::ordered_json root;
  root["axes"] = {"view", "light", "y", "x", "channel"};
  root["shape"] = {shape.views, shape.lights, shape.height, shape.width, shape.channels};
  root["encoding"] = name_of(info.encoding);
  root["quantity"] = name_of(info.quantity);
  root["layout"] = name_of(info.layout);
  root["source"] = info.source;
  if (!info.channel_names.empty()) root["channel_names"] = info.channel_names;
  root["views"] = directions_json(info.view_directions);
  root["lights"] = directions_json(info.light_directions);
  if (!info.mask.empty()) root["mask_runs"] = mask_runs(info.mask);
  try {
    return root.dump(1) + "\n";
  } catch (const json::exception&) {
    fail_input("{}: source or a channel name is not valid UTF-8", where);
  }
}

class NpyBtfSink final : public TileSink {
 public:
  NpyBtfSink(const std::filesystem::path& path, const BtfInfo& info)
      : info_((validate(info, path.string()), info)),
        values_(path),
        description_(json_beside(path)) {
    const BtfShape& shape = info_.shape;
    const std::string header = make_npy_header(
        info_.dtype, {shape.views, shape.lights, shape.height, shape.width, shape.channels});
    values_.write(std::as_bytes(std::span(header)));
    const std::string text = describe(info_, path.string());
    description_.write(std::as_bytes(std::span(text)));
  }

  const BtfInfo& info() const override { return info_; }

  void write(std::size_t first, std::size_t count, std::span<const std::byte> values) override {
    check_next_images(info_, first, count, values.size(), written_, values_.path().string());
    values_.write(values);
  }

  void finish() override {
    check_all_images(info_, written_, values_.path().string());
    AtomicFile::commit_both(description_, values_);
  }

 private:
  BtfInfo info_;
  AtomicFile values_;
  AtomicFile description_;
  std::size_t written_ = 0;
};

}  // namespace

std::unique_ptr<TileSink> create_npy_btf(const std::filesystem::path& path, const BtfInfo& info) {
  if (json_beside(path) == path) {
    fail_input("{}: a .json of directions goes beside it, name it .npy", path.string());
  }
  return std::make_unique<NpyBtfSink>(path, info);
}

std::shared_ptr<TileSource> open_npy_btf(const std::filesystem::path& path) {
  const NpyHeader header = read_npy_header(path);
  const auto file = std::make_shared<const MappedFile>(path);
  if (header.shape.size() != 5) {
    fail_input("{}: {} modes instead of the 5 of [V, L, Y, X, C]", path.string(),
               header.shape.size());
  }
  BtfInfo info;
  info.shape = {header.shape[0], header.shape[1], header.shape[2], header.shape[3],
                header.shape[4]};
  info.dtype = header.dtype;
  if (file->bytes().size() != header.data_offset + info.bytes()) {
    fail_input("{}: changed while it was opened", path.string());
  }

  const std::filesystem::path beside = json_beside(path);
  const std::string where = beside.string();
  const MappedFile description(beside);
  const std::string_view text(reinterpret_cast<const char*>(description.bytes().data()),
                              description.bytes().size());
  const json root = parse_json(text, where);
  if (!root.is_object()) fail_input("{}: not a JSON object", where);
  check_axes(root, where);
  info.encoding = encoding_from_name(
      read_string(root, "encoding", info.dtype == DType::u8 ? "srgb" : "linear", where),
      where + ": encoding");
  info.quantity =
      quantity_from_name(read_string(root, "quantity", "radiance", where), where + ": quantity");
  info.layout = layout_from_name(read_string(root, "layout", "grid", where), where + ": layout");
  info.source = read_string(root, "source", "", where);
  info.channel_names = read_channel_names(root, where);
  info.view_directions = read_directions(root, "views", where);
  info.light_directions = read_directions(root, "lights", where);
  info.mask = read_mask(root, info.shape.views * info.shape.texels(), where);
  validate(info, where);
  return std::make_shared<MappedBtfSource>(file, header.data_offset, std::move(info));
}

}  // namespace weft
