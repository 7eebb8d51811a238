#include "weft/codecs/colour_decoders.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "weft/device/tile_stream.hpp"
#include "weft/ops/invert_colour.hpp"
#include "weft/ops/look_up_raw.hpp"
#include "weft/reference/lookup.hpp"

namespace weft {
namespace {

class InvertingDecoder final : public DeviceDecoder {
 public:
  InvertingDecoder(Device& device, const Model& model, std::unique_ptr<DeviceDecoder> fitted)
      : device_(device),
        fitted_(std::move(fitted)),
        texels_(model.info.btf.shape.texels()),
        inverse_(device, model.info.colour_transform, model.info.btf.shape.channels) {}

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    fitted_->decode(first, count, out);
    inverse_.invert(device_, count * texels_, out);
  }
  double image_flops() const override {
    return fitted_->image_flops() + static_cast<double>(texels_) * inverse_.texel_flops();
  }

 private:
  Device& device_;
  std::unique_ptr<DeviceDecoder> fitted_;
  std::size_t texels_;
  ops::InverseColour inverse_;
};

// Linear transforms are inverted on what is interpolated.
class InvertingSampler final : public DeviceSampler {
 public:
  InvertingSampler(Device& device, const Model& model, std::unique_ptr<DeviceSampler> fitted)
      : device_(device),
        fitted_(std::move(fitted)),
        inverse_(device, model.info.colour_transform, model.info.btf.shape.channels) {}

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    fitted_->look_up(lookup, count, lookups, out);
    inverse_.invert(device_, count, out);
  }
  double lookup_flops(const LookupShape& lookup) const override {
    return fitted_->lookup_flops(lookup) + inverse_.texel_flops();
  }

 private:
  Device& device_;
  std::unique_ptr<DeviceSampler> fitted_;
  ops::InverseColour inverse_;
};

// Of what look-ups of that shape look at.
constexpr LookupShape one_tap(const LookupShape& lookup) {
  return {1, 1, 1, lookup.directions};
}
constexpr std::size_t tap_words = LookupShape{1, 1, 1, true}.words();  // at most
constexpr std::size_t tap_bytes = std::size_t{1} << 22;  // of taps and their values at a time

// Taps that are looked up at a time: those of one look-up at least.
std::size_t tap_room(std::size_t channels) {
  const std::size_t each = tap_words * sizeof(std::uint32_t) + channels * sizeof(float);
  return std::max(tap_bytes / each, ops::taps_of({4, 3, 3}));
}

// Sums of decoded texels, where they are not what sums of fitted ones decode to.
class TapSampler final : public DeviceSampler {
 public:
  TapSampler(Device& device, const Model& model, std::unique_ptr<DeviceSampler> fitted)
      : device_(device),
        fitted_(std::move(fitted)),
        channels_(model.info.btf.shape.channels),
        inverse_(device, model.info.colour_transform, channels_),
        room_(tap_room(channels_)),
        taps_(device, room_ * tap_words * sizeof(std::uint32_t), "taps of look-ups"),
        values_(device, room_ * channels_ * sizeof(float), "values of taps") {}

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    const std::size_t taps = ops::taps_of(lookup);
    if (taps == 1) {
      fitted_->look_up(lookup, count, lookups, out);
      inverse_.invert(device_, count, out);
      return;
    }
    const std::size_t run = room_ / taps;
    for (std::size_t first = 0; first < count; first += run) {
      const std::size_t n = std::min(run, count - first);
      ops::expand_taps(device_, lookup, first, n, lookups, taps_);
      fitted_->look_up(one_tap(lookup), n * taps, taps_, values_);
      inverse_.invert(device_, n * taps, values_);
      ops::sum_taps(device_, lookup, channels_, first, n, lookups, values_, out);
    }
  }
  double lookup_flops(const LookupShape& lookup) const override {
    return static_cast<double>(ops::taps_of(lookup)) *
           (fitted_->lookup_flops(one_tap(lookup)) + inverse_.texel_flops() +
            2 * static_cast<double>(channels_));
  }

  static std::size_t bytes(std::size_t channels) {
    return tap_room(channels) * (tap_words * sizeof(std::uint32_t) + channels * sizeof(float));
  }

 private:
  Device& device_;
  std::unique_ptr<DeviceSampler> fitted_;
  std::size_t channels_;
  ops::InverseColour inverse_;
  std::size_t room_;
  Buffer taps_, values_;
};

class InvertingReferenceDecoder final : public ReferenceDecoder {
 public:
  InvertingReferenceDecoder(const Model& model, std::unique_ptr<ReferenceDecoder> fitted)
      : model_(model), fitted_(std::move(fitted)) {}

  void decode(std::size_t first, std::size_t count, std::span<double> out) override {
    fitted_->decode(first, count, out);
    const BtfShape& shape = model_.info.btf.shape;
    model_.info.colour_transform.invert_all(shape.channels,
                                            out.first(count * shape.image_values()));
  }

 private:
  const Model& model_;
  std::unique_ptr<ReferenceDecoder> fitted_;
};

class InvertingReferenceSampler final : public ReferenceSampler {
 public:
  InvertingReferenceSampler(const Model& model, std::unique_ptr<ReferenceSampler> fitted)
      : model_(model), fitted_(std::move(fitted)) {}

  void look_up(const LookupShape& lookup, std::span<const std::uint32_t> lookups,
               std::span<double> out) override {
    fitted_->look_up(lookup, lookups, out);
    model_.info.colour_transform.invert_all(model_.info.btf.shape.channels, out);
  }

 private:
  const Model& model_;
  std::unique_ptr<ReferenceSampler> fitted_;
};

class TapReferenceSampler final : public ReferenceSampler {
 public:
  TapReferenceSampler(const Model& model, std::unique_ptr<ReferenceSampler> fitted)
      : model_(model), fitted_(std::move(fitted)) {}

  void look_up(const LookupShape& lookup, std::span<const std::uint32_t> lookups,
               std::span<double> out) override {
    const std::size_t channels = model_.info.btf.shape.channels;
    const std::size_t words = lookup.words(), count = lookups.size() / words;
    constexpr std::size_t run = 256;
    std::vector<double> values;
    for (std::size_t first = 0; first < count; first += run) {
      const std::size_t n = std::min(run, count - first);
      const auto records = lookups.subspan(first * words, n * words);
      values.resize(n * ops::taps_of(lookup) * channels);
      fitted_->look_up(one_tap(lookup), reference::expand_taps(lookup, records), values);
      model_.info.colour_transform.invert_all(channels, values);
      reference::sum_taps(lookup, records, channels, values,
                          out.subspan(first * channels, n * channels));
    }
  }

 private:
  const Model& model_;
  std::unique_ptr<ReferenceSampler> fitted_;
};

// The list of channels on the device.
class ChannelList {
 public:
  ChannelList(Device& device, std::size_t channels, std::span<const std::size_t> kept)
      : device_(device),
        channels_(channels),
        kept_(kept.size()),
        list_(device, kept.size() * sizeof(std::uint32_t), "channels") {
    std::vector<std::uint32_t> words;
    for (const std::size_t channel : kept) words.push_back(static_cast<std::uint32_t>(channel));
    device.write(list_, std::span<const std::uint32_t>(words));
  }

  void pick(std::size_t count, const Buffer& in, std::size_t first, Buffer& out) const {
    ops::pick_channels(device_, count, channels_, in, kept_, list_, first, out);
  }

 private:
  Device& device_;
  std::size_t channels_;
  std::size_t kept_;
  Buffer list_;
};

class ChannelDecoder final : public DeviceDecoder {
 public:
  ChannelDecoder(Device& device, const BtfShape& whole, std::span<const std::size_t> channels,
                 std::unique_ptr<DeviceDecoder> all)
      : all_(std::move(all)),
        shape_(whole),
        run_(image_granule(whole)),
        list_(device, whole.channels, channels),
        images_(device, run_ * whole.image_values() * sizeof(float), "images of all channels") {}

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    for (std::size_t done = 0; done < count; done += run_) {
      const std::size_t images = std::min(run_, count - done);
      all_->decode(first + done, images, images_);
      list_.pick(images * shape_.texels(), images_, done * shape_.texels(), out);
    }
  }
  double image_flops() const override { return all_->image_flops(); }

 private:
  std::unique_ptr<DeviceDecoder> all_;
  BtfShape shape_;
  std::size_t run_;
  ChannelList list_;
  Buffer images_;
};

class ChannelSampler final : public DeviceSampler {
 public:
  ChannelSampler(Device& device, const BtfShape& whole, std::span<const std::size_t> channels,
                 std::unique_ptr<DeviceSampler> all)
      : device_(device),
        channels_(whole.channels),
        all_(std::move(all)),
        list_(device, whole.channels, channels) {}

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    if (count > room_) {
      found_ = Buffer(device_, count * channels_ * sizeof(float), "values of all channels");
      room_ = count;
    }
    all_->look_up(lookup, count, lookups, found_);
    list_.pick(count, found_, 0, out);
  }
  double lookup_flops(const LookupShape& lookup) const override {
    return all_->lookup_flops(lookup);
  }

 private:
  Device& device_;
  std::size_t channels_;
  std::unique_ptr<DeviceSampler> all_;
  ChannelList list_;
  std::size_t room_ = 0;  // look-ups that `found_` holds
  Buffer found_;
};

void pick(std::size_t channels, std::span<const std::size_t> kept, std::span<const double> all,
          std::span<double> out) {
  for (std::size_t i = 0; i * channels < all.size(); ++i) {
    for (std::size_t k = 0; k < kept.size(); ++k) {
      out[i * kept.size() + k] = all[i * channels + kept[k]];
    }
  }
}

class ChannelReferenceDecoder final : public ReferenceDecoder {
 public:
  ChannelReferenceDecoder(const BtfShape& whole, std::span<const std::size_t> channels,
                          std::unique_ptr<ReferenceDecoder> all)
      : all_(std::move(all)),
        shape_(whole),
        channels_(channels.begin(), channels.end()),
        image_(whole.image_values()) {}

  void decode(std::size_t first, std::size_t count, std::span<double> out) override {
    const std::size_t values = shape_.texels() * channels_.size();
    for (std::size_t i = 0; i < count; ++i) {
      all_->decode(first + i, 1, image_);
      pick(shape_.channels, channels_, image_, out.subspan(i * values, values));
    }
  }

 private:
  std::unique_ptr<ReferenceDecoder> all_;
  BtfShape shape_;
  std::vector<std::size_t> channels_;
  std::vector<double> image_;
};

class ChannelReferenceSampler final : public ReferenceSampler {
 public:
  ChannelReferenceSampler(const BtfShape& whole, std::span<const std::size_t> channels,
                          std::unique_ptr<ReferenceSampler> all)
      : all_(std::move(all)), whole_(whole.channels), channels_(channels.begin(), channels.end()) {}

  void look_up(const LookupShape& lookup, std::span<const std::uint32_t> lookups,
               std::span<double> out) override {
    std::vector<double> found(out.size() / channels_.size() * whole_);
    all_->look_up(lookup, lookups, found);
    pick(whole_, channels_, found, out);
  }

 private:
  std::unique_ptr<ReferenceSampler> all_;
  std::size_t whole_;
  std::vector<std::size_t> channels_;
};

}  // namespace

std::unique_ptr<DeviceDecoder> with_inverse(Device& device, const Model& model,
                                            std::unique_ptr<DeviceDecoder> fitted) {
  if (model.info.colour_transform.is_identity()) return fitted;
  return std::make_unique<InvertingDecoder>(device, model, std::move(fitted));
}

std::unique_ptr<DeviceSampler> with_inverse(Device& device, const Model& model,
                                            std::unique_ptr<DeviceSampler> fitted) {
  if (model.info.colour_transform.is_identity()) return fitted;
  if (!model.info.colour_transform.is_linear()) {
    return std::make_unique<TapSampler>(device, model, std::move(fitted));
  }
  return std::make_unique<InvertingSampler>(device, model, std::move(fitted));
}

std::unique_ptr<ReferenceDecoder> with_inverse(const Model& model,
                                               std::unique_ptr<ReferenceDecoder> fitted) {
  if (model.info.colour_transform.is_identity()) return fitted;
  return std::make_unique<InvertingReferenceDecoder>(model, std::move(fitted));
}

std::unique_ptr<ReferenceSampler> with_inverse(const Model& model,
                                               std::unique_ptr<ReferenceSampler> fitted) {
  if (model.info.colour_transform.is_identity()) return fitted;
  if (!model.info.colour_transform.is_linear()) {
    return std::make_unique<TapReferenceSampler>(model, std::move(fitted));
  }
  return std::make_unique<InvertingReferenceSampler>(model, std::move(fitted));
}

std::size_t inverse_bytes(const Model& model) {
  const ModelInfo& info = model.info;
  if (info.colour_transform.is_identity()) return 0;
  return ops::InverseColour::bytes(info.colour_transform, info.btf.shape.channels);
}

std::size_t sampler_inverse_bytes(const Model& model) {
  const ModelInfo& info = model.info;
  const std::size_t taps =
      info.colour_transform.is_linear() ? 0 : TapSampler::bytes(info.btf.shape.channels);
  return inverse_bytes(model) + taps;
}

std::unique_ptr<DeviceDecoder> with_channels(Device& device, const BtfShape& whole,
                                             std::span<const std::size_t> channels,
                                             std::unique_ptr<DeviceDecoder> all) {
  return std::make_unique<ChannelDecoder>(device, whole, channels, std::move(all));
}

std::unique_ptr<DeviceSampler> with_channels(Device& device, const BtfShape& whole,
                                             std::span<const std::size_t> channels,
                                             std::unique_ptr<DeviceSampler> all) {
  return std::make_unique<ChannelSampler>(device, whole, channels, std::move(all));
}

std::unique_ptr<ReferenceDecoder> with_channels(const BtfShape& whole,
                                                std::span<const std::size_t> channels,
                                                std::unique_ptr<ReferenceDecoder> all) {
  return std::make_unique<ChannelReferenceDecoder>(whole, channels, std::move(all));
}

std::unique_ptr<ReferenceSampler> with_channels(const BtfShape& whole,
                                                std::span<const std::size_t> channels,
                                                std::unique_ptr<ReferenceSampler> all) {
  return std::make_unique<ChannelReferenceSampler>(whole, channels, std::move(all));
}

std::size_t channel_decoder_bytes(const BtfShape& whole, std::size_t kept) {
  return image_granule(whole) * whole.image_values() * sizeof(float) + kept * sizeof(std::uint32_t);
}

}  // namespace weft
