#include "weft/reference/light_sampler.hpp"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "weft/btf/encoding.hpp"
#include "weft/btf/hemisphere.hpp"
#include "weft/error.hpp"
#include "weft/scene/light_nodes.hpp"

namespace weft::reference {
namespace {

constexpr LookupShape lookup{1, 3, 1};

std::array<double, 3> to_double(const std::array<float, 3>& v) {
  return {static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])};
}

class SliceLightSampler final : public LightSampler {
 public:
  SliceLightSampler(const BtfInfo& info, std::unique_ptr<ReferenceSampler> sampler)
      : shape_(info.shape),
        encoding_(info.encoding),
        sampler_(std::move(sampler)),
        views_(info.view_directions),
        nodes_(info.light_directions, info.quantity) {
    if (info.layout != Layout::grid) {
      fail_input("layout 'paired': drawing lights needs every view with every light");
    }
  }

  void sample(std::span<const LightQuery> queries, std::span<const std::array<float, 2>> numbers,
              std::span<DrawnLight> out) override {
    validate_light_queries(shape_, queries);
    validate_light_numbers(numbers);
    for (std::size_t i = 0; i < queries.size(); ++i) {
      const LightOfSlice drawn =
          draw_light(density_of(queries[i]),
                     {static_cast<double>(numbers[i][0]), static_cast<double>(numbers[i][1])});
      for (std::size_t c = 0; c < 3; ++c) {
        out[i].direction[c] = static_cast<float>(drawn.direction[c]);
      }
      out[i].density = static_cast<float>(drawn.density);
    }
  }

  void densities(std::span<const LightQuery> queries, std::span<const std::array<float, 3>> lights,
                 std::span<float> out) override {
    validate_light_queries(shape_, queries);
    for (std::size_t i = 0; i < queries.size(); ++i) {
      out[i] = static_cast<float>(light_density(density_of(queries[i]), to_double(lights[i])));
    }
  }

  void albedos(std::span<const LightQuery> queries, std::span<float> out) override {
    validate_light_queries(shape_, queries);
    const std::span<const double> weights = nodes_.albedo_weights();
    for (std::size_t i = 0; i < queries.size(); ++i) {
      look_up(queries[i]);
      for (std::size_t c = 0; c < shape_.channels; ++c) {
        double sum = 0;
        for (std::size_t l = 0; l < shape_.lights; ++l) {
          sum += weights[l] * std::max(values_[l * shape_.channels + c], 0.0);
        }
        out[i * shape_.channels + c] = static_cast<float>(sum);
      }
    }
  }

 private:
  // values_: linear light of the slice, [L][C].
  void look_up(const LightQuery& query) {
    const DirectionWeights view = views_.at(to_double(query.view));
    std::vector<std::uint32_t> records;
    for (std::size_t l = 0; l < shape_.lights; ++l) {
      records.push_back(query.texel);
      records.insert(records.end(), view.index.begin(), view.index.end());
      records.push_back(static_cast<std::uint32_t>(l));
      for (const double weight : view.weight) {
        records.push_back(std::bit_cast<std::uint32_t>(static_cast<float>(weight)));
      }
    }
    values_.resize(shape_.lights * shape_.channels);
    sampler_->look_up(lookup, records, values_);
    for (double& value : values_) value = decode_to_linear(encoding_, value);
  }

  const BilinearDensity& density_of(const LightQuery& query) {
    if (density_ && query == query_) return *density_;
    look_up(query);
    std::vector<double> luminances(shape_.lights), nodes(nodes_.count());
    for (std::size_t l = 0; l < shape_.lights; ++l) {
      luminances[l] =
          slice_luminance(std::span(values_).subspan(l * shape_.channels, shape_.channels));
    }
    nodes_.gather(luminances, nodes);
    density_ = nodes_.density(nodes);
    query_ = query;
    return *density_;
  }

  BtfShape shape_;
  Encoding encoding_;
  std::unique_ptr<ReferenceSampler> sampler_;
  Hemisphere views_;
  LightNodes nodes_;
  std::vector<double> values_;
  LightQuery query_;                        // of the density
  std::optional<BilinearDensity> density_;  // the last one
};

}  // namespace

std::unique_ptr<LightSampler> slice_light_sampler(const BtfInfo& info,
                                                  std::unique_ptr<ReferenceSampler> sampler) {
  return std::make_unique<SliceLightSampler>(info, std::move(sampler));
}

}  // namespace weft::reference
