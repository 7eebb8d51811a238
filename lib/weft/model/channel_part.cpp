#include "weft/model/channel_part.hpp"

#include <utility>

#include "weft/btf/selection.hpp"

namespace weft {

ChannelPart::ChannelPart(std::shared_ptr<const Model> whole, std::vector<std::size_t> channels)
    : whole_(std::move(whole)), channels_(std::move(channels)) {
  info = whole_->info;
  Selection part;
  part.channels = channels_;
  info.btf = weft::select(info.btf, part);
  info.colour_transform = {};
  info.errors.reset();  // they were measured of the whole
}

void ChannelPart::fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                               std::span<double> out) const {
  std::vector<double> all(whole_->info.btf.shape.channels);
  whole_->decode_texel(view, light, y, x, all);
  for (std::size_t k = 0; k < channels_.size(); ++k) out[k] = all[channels_[k]];
}

}  // namespace weft
