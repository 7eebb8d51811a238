#include "weft/reference/lookup.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "weft/reference/tile.hpp"

namespace weft::reference {
namespace {

class TexelSampler final : public ReferenceSampler {
 public:
  explicit TexelSampler(const Model& model) : model_(model) {}

  void look_up(const LookupShape& lookup, std::span<const std::uint32_t> lookups,
               std::span<double> out) override {
    const BtfShape& shape = model_.info.btf.shape;
    std::vector<double> texel(shape.channels);
    std::fill(out.begin(), out.end(), 0.0);
    for (std::size_t i = 0; i * lookup.words() < lookups.size(); ++i) {
      const Lookup taps(lookup, lookups.subspan(i * lookup.words(), lookup.words()));
      for (std::size_t a = 0; a < lookup.views; ++a) {
        for (std::size_t b = 0; b < lookup.lights; ++b) {
          for (std::size_t t = 0; t < lookup.texels; ++t) {
            const double weight = taps.texel_weight(t) * taps.view_weight(a) * taps.light_weight(b);
            if (weight == 0) continue;
            const std::size_t y = taps.texels[t] / shape.width;
            const std::size_t x = taps.texels[t] % shape.width;
            if (lookup.directions) {
              model_.fitted_texel_at(taps.view(), taps.light(), y, x, texel);
            } else {
              model_.fitted_texel(taps.views[a], taps.lights[b], y, x, texel);
            }
            for (std::size_t c = 0; c < shape.channels; ++c) {
              out[i * shape.channels + c] += weight * texel[c];
            }
          }
        }
      }
    }
  }

 private:
  const Model& model_;
};

class TileSampler final : public ReferenceSampler {
 public:
  explicit TileSampler(TileSource& source) : source_(source) {}

  void look_up(const LookupShape& lookup, std::span<const std::uint32_t> lookups,
               std::span<double> out) override {
    const BtfInfo& info = source_.info();
    const std::size_t channels = info.shape.channels;
    // One entry for each image that a look-up needs.
    struct Need {
      std::size_t image;
      std::size_t lookup;
      double weight;
    };
    std::vector<Need> needs;
    for (std::size_t i = 0; i * lookup.words() < lookups.size(); ++i) {
      const Lookup taps(lookup, lookups.subspan(i * lookup.words(), lookup.words()));
      for (std::size_t a = 0; a < lookup.views; ++a) {
        for (std::size_t b = 0; b < lookup.lights; ++b) {
          const double weight = taps.view_weight(a) * taps.light_weight(b);
          if (weight == 0) continue;
          needs.push_back({taps.views[a] * info.shape.lights + taps.lights[b], i, weight});
        }
      }
    }
    std::stable_sort(needs.begin(), needs.end(),
                     [](const Need& one, const Need& other) { return one.image < other.image; });
    std::fill(out.begin(), out.end(), 0.0);
    std::vector<std::byte> whole;
    std::vector<double> texel(channels);
    const std::size_t texel_bytes = channels * size_of(info.dtype);
    for (auto need = needs.begin(); need != needs.end();) {
      const std::size_t image = need->image;
      std::span<const std::byte> values = source_.mapped(image, 1);
      if (values.empty()) {
        whole.resize(info.image_bytes());
        source_.read(image, 1, whole);
        values = whole;
      }
      for (; need != needs.end() && need->image == image; ++need) {
        const Lookup taps(lookup, lookups.subspan(need->lookup * lookup.words(), lookup.words()));
        for (std::size_t t = 0; t < lookup.texels; ++t) {
          const double weight = need->weight * taps.texel_weight(t);
          if (weight == 0) continue;
          to_double(info.dtype, values.subspan(taps.texels[t] * texel_bytes, texel_bytes), true,
                    texel);
          for (std::size_t c = 0; c < channels; ++c) {
            out[need->lookup * channels + c] += weight * texel[c];
          }
        }
      }
    }
  }

 private:
  TileSource& source_;
};

}  // namespace

std::unique_ptr<ReferenceSampler> texel_sampler(const Model& model) {
  return std::make_unique<TexelSampler>(model);
}

std::unique_ptr<ReferenceSampler> tile_sampler(TileSource& source) {
  return std::make_unique<TileSampler>(source);
}

std::vector<std::uint32_t> expand_taps(const LookupShape& lookup,
                                       std::span<const std::uint32_t> lookups) {
  std::vector<std::uint32_t> records;
  for (std::size_t i = 0; i * lookup.words() < lookups.size(); ++i) {
    const Lookup taps(lookup, lookups.subspan(i * lookup.words(), lookup.words()));
    if (lookup.directions) {
      for (const std::uint32_t texel : taps.texels) {
        records.push_back(texel);
        records.insert(records.end(), taps.views.begin(), taps.views.end());
        records.insert(records.end(), taps.lights.begin(), taps.lights.end());
      }
      continue;
    }
    for (const std::uint32_t view : taps.views) {
      for (const std::uint32_t light : taps.lights) {
        for (const std::uint32_t texel : taps.texels) {
          records.insert(records.end(), {texel, view, light});
        }
      }
    }
  }
  return records;
}

void sum_taps(const LookupShape& lookup, std::span<const std::uint32_t> lookups,
              std::size_t channels, std::span<const double> values, std::span<double> out) {
  std::fill(out.begin(), out.end(), 0.0);
  std::size_t tap = 0;
  for (std::size_t i = 0; i * lookup.words() < lookups.size(); ++i) {
    const Lookup taps(lookup, lookups.subspan(i * lookup.words(), lookup.words()));
    for (std::size_t a = 0; a < lookup.views; ++a) {
      for (std::size_t b = 0; b < lookup.lights; ++b) {
        for (std::size_t t = 0; t < lookup.texels; ++t, ++tap) {
          const double weight = taps.texel_weight(t) * taps.view_weight(a) * taps.light_weight(b);
          if (weight == 0) continue;
          for (std::size_t c = 0; c < channels; ++c) {
            out[i * channels + c] += weight * values[tap * channels + c];
          }
        }
      }
    }
  }
}

}  // namespace weft::reference
