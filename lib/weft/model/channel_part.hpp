// Some channels of a model whose colour transform mixes them: the whole is kept, all channels are
// decoded, and those of the list are given. It decodes as any model and can't be written: there is
// no part of the tensors that it takes.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "weft/model/model.hpp"

namespace weft {

class ChannelPart final : public Model {
 public:
  // Throws an input error for indices that `whole` does not have.
  ChannelPart(std::shared_ptr<const Model> whole, std::vector<std::size_t> channels);

  const Model& whole() const { return *whole_; }
  std::span<const std::size_t> channels() const { return channels_; }

  std::vector<ModelTensor> tensors() const override { return whole_->tensors(); }
  // None: it decodes what the whole holds.
  std::vector<std::span<float>> real_values() override { return {}; }
  void divide(const Weights&) override {}
  std::size_t view_grid() const override { return whole_->view_grid(); }
  bool takes_directions() const override { return whole_->takes_directions(); }
  // The transform is inverted here: info.colour_transform is none.
  void fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                    std::span<double> out) const override;
  void fitted_texel_at(const Direction& view, const Direction& light, std::size_t y, std::size_t x,
                       std::span<double> out) const override;

 private:
  std::shared_ptr<const Model> whole_;
  std::vector<std::size_t> channels_;
};

}  // namespace weft
