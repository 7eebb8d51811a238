#include "weft/io/raw_btf.hpp"

#include <array>
#include <fstream>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/btf_tensors.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/mapped_btf.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/safetensors.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

constexpr std::string_view btf_modes = "v,l,y,x,c";

bool begins_like_npy(const std::filesystem::path& path) {
  std::array<char, 6> first{};
  std::ifstream stream(path, std::ios::binary);
  stream.read(first.data(), first.size());
  return stream && std::string_view(first.data(), first.size()) == "\x93NUMPY";
}

BtfInfo read_info(const SafetensorsFile& file) {
  const std::string where = file.path().string();
  if (file.find("btf") == nullptr && !file.value("codec").empty()) {
    fail_input("{}: a model, not a raw BTF (no tensor \"btf\")", where);
  }
  check_format_version(file, file_format_version);
  const TensorInfo& btf = file.get("btf");
  const std::string_view modes = file.value("modes");
  if (!modes.empty() && modes != btf_modes) {
    fail_input("{}: metadata \"modes\": \"{}\" instead of \"{}\"", where, shown(modes), btf_modes);
  }
  if (btf.shape.size() != 5) {
    fail_input("{}: tensor \"btf\": {} modes instead of the 5 of [V, L, Y, X, C]", where,
               btf.shape.size());
  }
  BtfInfo info;
  info.shape = {btf.shape[0], btf.shape[1], btf.shape[2], btf.shape[3], btf.shape[4]};
  info.dtype = btf.dtype;
  get_btf_metadata(file, info);
  get_btf_side_tensors(file, info);
  get_mask_distance(file, info);
  return info;
}

class RawBtfSink final : public TileSink {
 public:
  RawBtfSink(const std::filesystem::path& path, const BtfInfo& info)
      : info_((validate(info, path.string()), info)),
        where_(path.string()),
        writer_(path, tensors(info), metadata(info)) {
    for (const TensorInfo& tensor : btf_side_tensors(info_)) {
      writer_.write(tensor.name, 0, btf_side_values(info_, tensor.name));
    }
    if (!info_.mask_distance.empty()) {
      writer_.write(mask_distance_tensor(info_).name, 0,
                    std::as_bytes(std::span(info_.mask_distance)));
    }
  }

  const BtfInfo& info() const override { return info_; }

  void write(std::size_t first, std::size_t count, std::span<const std::byte> values) override {
    check_next_images(info_, first, count, values.size(), written_, where_);
    writer_.write("btf", first * info_.image_bytes(), values);
  }

  void finish() override {
    check_all_images(info_, written_, where_);
    writer_.finish();
  }

 private:
  static std::vector<TensorInfo> tensors(const BtfInfo& info) {
    const BtfShape& shape = info.shape;
    std::vector<TensorInfo> result{
        {"btf",
         info.dtype,
         {shape.views, shape.lights, shape.height, shape.width, shape.channels}}};
    for (TensorInfo& tensor : btf_side_tensors(info)) result.push_back(std::move(tensor));
    if (!info.mask_distance.empty()) result.push_back(mask_distance_tensor(info));
    return result;
  }

  static Metadata metadata(const BtfInfo& info) {
    Metadata result{{"weft.format", file_format_version},
                    {"weft.version", version()},
                    {"modes", std::string(btf_modes)}};
    put_btf_metadata(info, result);
    return result;
  }

  BtfInfo info_;
  std::string where_;
  SafetensorsWriter writer_;
  std::size_t written_ = 0;
};

}  // namespace

std::shared_ptr<TileSource> open_raw_btf(const std::filesystem::path& path) {
  if (path.extension() == ".npy" || begins_like_npy(path)) return open_npy_btf(path);
  const auto file = std::make_shared<const SafetensorsFile>(path);
  BtfInfo info = read_info(*file);
  const std::size_t offset = file->offset(file->get("btf"));
  return std::make_shared<MappedBtfSource>(std::shared_ptr<const MappedFile>(file, &file->file()),
                                           offset, std::move(info));
}

std::unique_ptr<TileSink> create_raw_btf(const std::filesystem::path& path, const BtfInfo& info) {
  return std::make_unique<RawBtfSink>(path, info);
}

}  // namespace weft
