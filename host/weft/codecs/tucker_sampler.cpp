#include "weft/codecs/tucker_sampler.hpp"

#include <vector>

#include "weft/codecs/texel_factors.hpp"
#include "weft/ops/look_up_tucker.hpp"
#include "weft/ops/order_lookups.hpp"
#include "weft/reference/mode_product.hpp"

namespace weft {
namespace {

// Rows of a factor or of an identity, padded to whole vectors.
Buffer row_buffer(Device& device, const std::vector<float>& factor, std::size_t rows,
                  std::size_t rank, const char* what) {
  Buffer buffer(device, ops::row_floats(rows, rank, what) * sizeof(float), what);
  ops::write_rows(
      device, rows, rank,
      [&](std::size_t row, std::size_t j) {
        return factor.empty() ? (row == j ? 1.0f : 0.0f) : factor[row * rank + j];
      },
      buffer);
  return buffer;
}

class TuckerDeviceSampler final : public DeviceSampler {
 public:
  TuckerDeviceSampler(Device& device, const TuckerModel& model)
      : device_(device),
        shape_(model.info.btf.shape),
        core_(model),
        order_(device, shape_.texels()) {
    const std::vector<ModeGroup>& groups = model.groups.groups();
    if (core_.views_alone) {
      views_ = row_buffer(device, model.factors[0], shape_.views, core_.views, "rows of views");
    } else {
      views_ = row_buffer(device, {1.0f}, 1, 1, "rows of views");
    }
    lights_ = row_buffer(device, model.factors[core_.light_group], groups[core_.light_group].size,
                         core_.lights, "rows of lights");
    // the texels' core of each light and view rank, expanded: [views][lights][image]
    const std::size_t image = shape_.image_values() / core_.light_channels;
    const std::size_t slices = core_.views * core_.lights;
    std::vector<float> expanded;
    expanded.reserve(slices * image);
    for (std::size_t s = 0; s < slices; ++s) {
      std::vector<std::size_t> sizes(
          model.ranks.begin() + static_cast<std::ptrdiff_t>(core_.light_group + 1),
          model.ranks.end());
      const auto begin = model.core.begin() + static_cast<std::ptrdiff_t>(s * core_.slice());
      std::vector<double> T(begin, begin + static_cast<std::ptrdiff_t>(core_.slice()));
      for (std::size_t n = 0; n < sizes.size(); ++n) {
        const std::size_t group = core_.light_group + 1 + n;
        if (!model.has_factor(group)) continue;
        const std::vector<double> U(model.factors[group].begin(), model.factors[group].end());
        T = reference::mode_product(sizes, n, T, groups[group].size, U);
        sizes[n] = groups[group].size;
      }
      expanded.insert(expanded.end(), T.begin(), T.end());
    }
    // rows [texel][channel][view] of lights
    const std::size_t channels = shape_.channels / core_.light_channels;
    const bool channels_first = model.groups.channels_first();
    const std::size_t rows = image * core_.views;
    table_ = Buffer(device, ops::row_floats(rows, core_.lights, "core by texels") * sizeof(float),
                    "core by texels");
    ops::write_rows(
        device, rows, core_.lights,
        [&](std::size_t row, std::size_t j) {
          const std::size_t view = row % core_.views;
          const std::size_t c = row / core_.views % channels;
          const std::size_t p = row / core_.views / channels;
          const std::size_t at = channels_first ? c * shape_.texels() + p : p * channels + c;
          return expanded[(view * core_.lights + j) * image + at];
        },
        table_);
  }

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    validate(lookup, shape_);
    order_.for_each({lookup, shape_, count, lookups, out}, [&](const ops::LookupBatch& batch) {
      ops::look_up_tucker(device_, batch,
                          {core_.views, core_.lights, !core_.views_alone, core_.light_channels > 1},
                          views_, lights_, table_);
    });
  }

  double lookup_flops(const LookupShape& lookup) const override {
    return 2.0 * static_cast<double>(lookup.texels * shape_.channels) *
           static_cast<double>(core_.views * core_.lights);
  }

  static std::size_t bytes(const TuckerModel& model) {
    const TuckerCore core(model);
    const BtfShape& shape = model.info.btf.shape;
    const std::size_t image = shape.image_values() / core.light_channels;
    const std::size_t light_rows = model.groups.groups()[core.light_group].size;
    const std::size_t table = ops::row_floats(image * core.views, core.lights, "core by texels");
    return (ops::row_floats(shape.views, core.views, "rows of views") +
            ops::row_floats(light_rows, core.lights, "rows of lights") + 2 * table) *
               sizeof(float) +
           ops::TexelOrder::most_bytes(shape.texels());
  }

 private:
  Device& device_;
  BtfShape shape_;
  TuckerCore core_;
  ops::TexelOrder order_;
  Buffer views_;   // [V][R_view], padded rows
  Buffer lights_;  // [L or V L][channels][R_light], padded rows
  Buffer table_;   // [P][C][R_view][R_light], padded rows
};

}  // namespace

std::unique_ptr<DeviceSampler> tucker_sampler(Device& device, const TuckerModel& model) {
  return std::make_unique<TuckerDeviceSampler>(device, model);
}

std::size_t tucker_sampler_bytes(const TuckerModel& model) {
  return TuckerDeviceSampler::bytes(model);
}

}  // namespace weft
