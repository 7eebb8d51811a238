// A BTF multiplied with the roots of its weights (see weights.hpp), computed as it is read.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/btf/weights.hpp"

namespace weft {

// Images of F32: s[v, l, p] T[v, l, p, c], or with `centred`
//
//   s[v, l, p] (T[v, l, p, c] - m[v, l, c])        m[v, l, c] = sum_p w_p T[v, l, p, c] / sum_p w_p
//
// 8-bit values count as [0, 1]. What s T comes to is what a plain source would say of T's range.
class WeightedSource final : public TileSource {
 public:
  // `source` must outlive it. `centred`: for codecs that take a mean from the texels; where all
  // texels weigh the same they do so themselves and nothing is taken here. `nan_zero`: NaN and
  // infinite values count as 0 in the means.
  WeightedSource(TileSource& source, const Weights& weights, bool centred, bool nan_zero);

  const BtfInfo& info() const override { return info_; }
  std::span<const float> texel_scale() const override {
    return means_.empty() ? std::span<const float>() : texels_;
  }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override;
  void prefetch(std::size_t first, std::size_t count) override { source_.prefetch(first, count); }
  void release(std::size_t first, std::size_t count) override { source_.release(first, count); }

  // m [V, L, C], of the images that were read; empty unless something is taken.
  std::span<const float> means() const { return means_; }
  // Bytes of host memory that it holds.
  std::size_t bytes() const;

 private:
  void to_floats(std::span<const std::byte> raw, std::span<float> out) const;
  void subtract_mean(std::size_t image, std::span<float> values);

  TileSource& source_;
  BtfInfo info_;
  bool nan_zero_;
  std::vector<float> images_;    // [N]: s_v s_l
  std::vector<float> texels_;    // [P]: s_p, or empty
  std::vector<double> weights_;  // [P]: w_p, where they make means
  std::vector<float> means_;
  std::vector<std::byte> raw_;
  std::vector<float> values_;
};

}  // namespace weft
