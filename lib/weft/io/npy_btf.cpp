// NAME.npy with NAME.json beside it: the description of btf_json.hpp, and "axes".
#include <nlohmann/json.hpp>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/atomic_file.hpp"
#include "weft/io/btf_json.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/mapped_btf.hpp"
#include "weft/io/npy.hpp"

namespace weft {
namespace {

using nlohmann::json;

std::filesystem::path json_beside(std::filesystem::path path) {
  return path.replace_extension(".json");
}

void check_axes(const json& root, const std::string& where) {
  const auto axes = root.find("axes");
  if (axes == root.end()) return;
  if (*axes != json{"view", "light", "y", "x", "channel"} &&
      *axes != json{"v", "l", "y", "x", "c"}) {
    fail_input("{}: \"axes\" are not view, light, y, x, channel", where);
  }
}

std::string description(const BtfInfo& info, const std::string& where) {
  const BtfShape& shape = info.shape;
  nlohmann::ordered_json root;
  root["axes"] = {"view", "light", "y", "x", "channel"};
  root["shape"] = {shape.views, shape.lights, shape.height, shape.width, shape.channels};
  describe(info, root);
  return dump(root, where);
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
    const std::string text = description(info_, path.string());
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
  if (header.dtype == DType::f64) {
    fail_input("{}: NPY header: a BTF of '<f8' (float64) is not read: float32 is", path.string());
  }
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
