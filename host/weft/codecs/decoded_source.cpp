#include "weft/codecs/decoded_source.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "weft/device/tile_stream.hpp"

namespace weft {
namespace {

BtfInfo decoded_info(const Model& model) {
  BtfInfo info = model.info.btf;
  info.dtype = DType::f32;
  return info;
}

class DeviceDecodedSource final : public TileSource {
 public:
  DeviceDecodedSource(Device& device, std::shared_ptr<const Model> model)
      : device_(device),
        model_(std::move(model)),
        info_(decoded_info(*model_)),
        decoder_(find_codec(model_->info.codec).decoder(device, *model_)),
        run_(image_granule(info_.shape)),
        decoded_(device, run_ * info_.image_bytes(), "decoded images") {}

  const BtfInfo& info() const override { return info_; }

  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    for (std::size_t done = 0; done < count; done += run_) {
      const std::size_t images = std::min(run_, count - done);
      decoder_->decode(first + done, images, decoded_);
      device_.read(decoded_, 0,
                   out.subspan(done * info_.image_bytes(), images * info_.image_bytes()));
    }
  }

 private:
  Device& device_;
  std::shared_ptr<const Model> model_;
  BtfInfo info_;
  std::unique_ptr<DeviceDecoder> decoder_;
  std::size_t run_;
  Buffer decoded_;
};

class ReferenceDecodedSource final : public TileSource {
 public:
  explicit ReferenceDecodedSource(std::shared_ptr<const Model> model)
      : model_(std::move(model)),
        info_(decoded_info(*model_)),
        decoder_(find_codec(model_->info.codec).reference_decoder(*model_)),
        image_(info_.shape.image_values()) {}

  const BtfInfo& info() const override { return info_; }

  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    std::vector<float> values(image_.size());
    for (std::size_t i = 0; i < count; ++i) {
      decoder_->decode(first + i, 1, image_);
      std::transform(image_.begin(), image_.end(), values.begin(),
                     [](double value) { return static_cast<float>(value); });
      std::memcpy(out.data() + i * info_.image_bytes(), values.data(), info_.image_bytes());
    }
  }

 private:
  std::shared_ptr<const Model> model_;
  BtfInfo info_;
  std::unique_ptr<ReferenceDecoder> decoder_;
  std::vector<double> image_;
};

}  // namespace

std::shared_ptr<TileSource> decoded_source(Device* device, std::shared_ptr<const Model> model) {
  if (device) return std::make_shared<DeviceDecodedSource>(*device, std::move(model));
  return std::make_shared<ReferenceDecodedSource>(std::move(model));
}

}  // namespace weft
