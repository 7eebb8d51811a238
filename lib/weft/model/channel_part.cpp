#include "weft/model/channel_part.hpp"

#include <utility>

#include "weft/btf/selection.hpp"
#include "weft/model/selected_indices.hpp"

namespace weft {

ChannelPart::ChannelPart(std::shared_ptr<const Model> whole, std::vector<std::size_t> channels)
    : whole_(std::move(whole)), channels_(std::move(channels)) {
  Selection part;
  part.channels = channels_;
  info = selected_info(whole_->info, part);
  info.colour_transform = {};
}

void ChannelPart::fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                               std::span<double> out) const {
  std::vector<double> all(whole_->info.btf.shape.channels);
  whole_->decode_texel(view, light, y, x, all);
  for (std::size_t k = 0; k < channels_.size(); ++k) out[k] = all[channels_[k]];
}

void ChannelPart::fitted_texel_at(const Direction& view, const Direction& light, std::size_t y,
                                  std::size_t x, std::span<double> out) const {
  std::vector<double> all(whole_->info.btf.shape.channels);
  whole_->fitted_texel_at(view, light, y, x, all);
  whole_->info.colour_transform.invert(all);
  for (std::size_t k = 0; k < channels_.size(); ++k) out[k] = all[channels_[k]];
}

}  // namespace weft
