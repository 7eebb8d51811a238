// A model whose tensors can be made to disagree: the writer trusts shapes, a hostile file does not
// keep to them.
#pragma once

#include <vector>

#include "weft/model/model.hpp"

namespace weft::test {

class LyingModel final : public Model {
 public:
  // Begins as a copy of what `honest` stores; `honest` must outlive it.
  explicit LyingModel(const Model& honest) : list(honest.tensors()) { info = honest.info; }

  std::vector<ModelTensor> list;

  std::vector<ModelTensor> tensors() const override { return list; }
  std::vector<std::span<float>> real_values() override { return {}; }
  void divide(const Weights&) override {}
  void fitted_texel(std::size_t, std::size_t, std::size_t, std::size_t,
                    std::span<double>) const override {}
};

}  // namespace weft::test
