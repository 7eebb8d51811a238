#include "weft/codecs/tucker_decoder.hpp"

#include <algorithm>
#include <vector>

#include "weft/device/tile_stream.hpp"
#include "weft/ops/look_up_tucker.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/ops/mode_product.hpp"
#include "weft/ops/turn_channels.hpp"
#include "weft/reference/mode_product.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

// How a core lies for decoding: [views][lights][texels ...], where views that are merged with
// lights are lights.
struct CoreShape {
  bool views_alone = false;
  std::size_t views = 1;           // R of the views' mode
  std::size_t lights = 1;          // R of the lights' mode
  std::size_t light_group = 0;     // its number
  std::size_t light_channels = 1;  // channels that are in it
  std::size_t first_texels = 0;    // number of the first group of texels or channels alone
  std::size_t texels = 1;          // product of the ranks from there on

  explicit CoreShape(const TuckerModel& model) {
    const std::vector<ModeGroup>& groups = model.groups.groups();
    views_alone = groups[0].modes.size() == 1;
    light_group = views_alone ? 1 : 0;
    if (views_alone) views = model.ranks[0];
    lights = model.ranks[light_group];
    if (groups[light_group].has(Mode::channel)) light_channels = model.info.btf.shape.channels;
    first_texels = light_group + 1;
    texels = product(std::span(model.ranks).subspan(first_texels));
  }
};

// Views that share a multiplication of the core: few enough that their products stay small.
std::size_t views_at_once(const TuckerModel& model, const CoreShape& core) {
  constexpr std::size_t most_values = std::size_t{16} << 20;
  return std::clamp<std::size_t>(most_values / (core.lights * core.texels), 1,
                                 std::min<std::size_t>(16, model.info.btf.shape.views));
}

Buffer factor_buffer(Device& device, const std::vector<float>& values) {
  if (values.empty()) return {};
  Buffer buffer(device, values.size() * sizeof(float), "factor");
  device.write(buffer, std::span<const float>(values));
  return buffer;
}

class TuckerDeviceDecoder final : public DeviceDecoder {
 public:
  TuckerDeviceDecoder(Device& device, const TuckerModel& model)
      : device_(device),
        shape_(model.info.btf.shape),
        core_shape_(model),
        sizes_(model.ranks),
        channels_first_(model.groups.channels_first()),
        at_once_(views_at_once(model, core_shape_)),
        core_(factor_buffer(device, model.core)) {
    for (const std::vector<float>& factor : model.factors) {
      factors_.push_back(factor_buffer(device, factor));
    }
    const std::vector<std::size_t> whole = model.groups.sizes();
    for (std::size_t n = core_shape_.first_texels; n < whole.size(); ++n) {
      if (!factors_[n]) continue;
      expanded_.push_back(n);
    }
    // the modes that grow least come first
    std::sort(expanded_.begin(), expanded_.end(), [&](std::size_t a, std::size_t b) {
      return whole[a] * sizes_[b] < whole[b] * sizes_[a];
    });
    whole_ = whole;
    if (core_shape_.views_alone && factors_[0]) {
      of_views_ = Buffer(device, at_once_ * core_shape_.lights * core_shape_.texels * sizeof(float),
                         "core of some views");
    }
  }

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    const std::size_t steps = expanded_.size() + (channels_first_ ? 1 : 0);
    reserve(count, steps);
    Buffer& lit = steps == 0 ? out : scratch_[0];
    light(first, count, lit);
    // texels and channels
    std::vector<std::size_t> sizes{count * core_shape_.light_channels};
    sizes.insert(sizes.end(),
                 sizes_.begin() + static_cast<std::ptrdiff_t>(core_shape_.first_texels),
                 sizes_.end());
    std::size_t step = 0;
    for (const std::size_t n : expanded_) {
      const std::size_t at = n - core_shape_.first_texels + 1;
      Buffer& to = step + 1 == steps ? out : scratch_[(step + 1) % 2];
      ops::mode_product(device_, ops::mode_view(sizes, at), scratch_[step % 2],
                        ops::ModeProduct::expand, factors_[n], whole_[n], to);
      sizes[at] = whole_[n];
      ++step;
    }
    if (channels_first_) {
      ops::turn_channels(device_, count, shape_.channels, shape_.texels(), scratch_[step % 2], out);
    }
  }

  double image_flops() const override {
    const double light_rows = static_cast<double>(core_shape_.light_channels);
    double flops = 0;
    if (of_views_) {
      flops += 2.0 *
               static_cast<double>(core_shape_.views * core_shape_.lights * core_shape_.texels) /
               static_cast<double>(shape_.lights);
    }
    if (factors_[core_shape_.light_group]) {
      flops += 2.0 * light_rows * static_cast<double>(core_shape_.lights * core_shape_.texels);
    }
    std::vector<std::size_t> sizes = sizes_;
    for (const std::size_t n : expanded_) {
      const double values =
          static_cast<double>(product(std::span(sizes).subspan(core_shape_.first_texels)));
      flops += 2.0 * light_rows * values * static_cast<double>(whole_[n]);
      sizes[n] = whole_[n];
    }
    return flops;
  }

 private:
  void reserve(std::size_t count, std::size_t steps) {
    const std::size_t values =
        std::max(core_shape_.texels * core_shape_.light_channels, shape_.image_values());
    for (std::size_t i = 0; i < std::min<std::size_t>(steps, 2); ++i) {
      if (scratch_[i].size() >= count * values * sizeof(float)) continue;
      device_.finish();
      scratch_[i] = Buffer();
      scratch_[i] = Buffer(device_, count * values * sizeof(float), "images on the way");
    }
  }

  // Images [first, first + count) as they are before the factors of texels.
  void light(std::size_t first, std::size_t count, Buffer& out) {
    const std::size_t image = core_shape_.texels * core_shape_.light_channels;
    if (!core_shape_.views_alone) {
      light_rows(core_, 0, first, count, out, 0);
      return;
    }
    for (std::size_t i = first; i < first + count;) {
      const std::size_t view = i / shape_.lights;
      const std::size_t light = i % shape_.lights;
      const std::size_t run = std::min(first + count - i, shape_.lights - light);
      const std::size_t slice = core_shape_.lights * core_shape_.texels;
      if (of_views_) {
        multiply_views(view / at_once_);
        light_rows(of_views_, view % at_once_ * slice, light, run, out, (i - first) * image);
      } else {
        light_rows(core_, view * slice, light, run, out, (i - first) * image);
      }
      i += run;
    }
  }

  // The core times the rows of a block of views, unless it is what was made last.
  void multiply_views(std::size_t block) {
    if (block == block_) return;
    const std::size_t begin = block * at_once_;
    const std::size_t rows = std::min(at_once_, shape_.views - begin);
    const std::size_t slice = core_shape_.lights * core_shape_.texels;
    ops::gemm(device_, ops::Transpose::no, ops::Transpose::no, rows, slice, core_shape_.views, 1.0,
              {factors_[0], core_shape_.views, begin * core_shape_.views}, {core_, slice}, 0.0,
              {of_views_, slice});
    block_ = block;
  }

  // Rows [light, light + count) of the lights' factor times the slice at `offset`.
  void light_rows(const Buffer& from, std::size_t offset, std::size_t light, std::size_t count,
                  Buffer& out, std::size_t to) {
    const std::size_t rank = core_shape_.lights;
    const std::size_t rows = count * core_shape_.light_channels;
    const std::size_t row = light * core_shape_.light_channels;
    const Buffer& factor = factors_[core_shape_.light_group];
    if (!factor) {
      const std::size_t begin = offset + row * core_shape_.texels;
      check_cl(clEnqueueCopyBuffer(device_.queue(), from.get(), out.get(), begin * sizeof(float),
                                   to * sizeof(float), rows * core_shape_.texels * sizeof(float), 0,
                                   nullptr, nullptr),
               "clEnqueueCopyBuffer");
      return;
    }
    ops::gemm(device_, ops::Transpose::no, ops::Transpose::no, rows, core_shape_.texels, rank, 1.0,
              {factor, rank, row * rank}, {from, core_shape_.texels, offset}, 0.0,
              {out, core_shape_.texels, to});
  }

  Device& device_;
  BtfShape shape_;
  CoreShape core_shape_;
  std::vector<std::size_t> sizes_;     // of the core
  std::vector<std::size_t> whole_;     // of the tensor
  std::vector<std::size_t> expanded_;  // modes of texels and channels with factors
  bool channels_first_;
  std::size_t at_once_;
  Buffer core_;
  std::vector<Buffer> factors_;
  Buffer of_views_;  // [at_once][R_light][texels]
  std::size_t block_ = static_cast<std::size_t>(-1);
  Buffer scratch_[2];
};

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
      : device_(device), shape_(model.info.btf.shape), core_(model) {
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
          model.ranks.begin() + static_cast<std::ptrdiff_t>(core_.first_texels), model.ranks.end());
      const auto begin = model.core.begin() + static_cast<std::ptrdiff_t>(s * core_.texels);
      std::vector<double> T(begin, begin + static_cast<std::ptrdiff_t>(core_.texels));
      for (std::size_t n = 0; n < sizes.size(); ++n) {
        const std::size_t group = core_.first_texels + n;
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
    ops::look_up_tucker(device_, {lookup, shape_, count, lookups, out},
                        {core_.views, core_.lights, !core_.views_alone, core_.light_channels > 1},
                        views_, lights_, table_);
  }

  double lookup_flops(const LookupShape& lookup) const override {
    return 2.0 * static_cast<double>(lookup.texels * shape_.channels) *
           static_cast<double>(core_.views * core_.lights);
  }

  static std::size_t bytes(const TuckerModel& model) {
    const CoreShape core(model);
    const BtfShape& shape = model.info.btf.shape;
    const std::size_t image = shape.image_values() / core.light_channels;
    const std::size_t light_rows = model.groups.groups()[core.light_group].size;
    const std::size_t table = ops::row_floats(image * core.views, core.lights, "core by texels");
    return (ops::row_floats(shape.views, core.views, "rows of views") +
            ops::row_floats(light_rows, core.lights, "rows of lights") + 2 * table) *
           sizeof(float);
  }

 private:
  Device& device_;
  BtfShape shape_;
  CoreShape core_;
  Buffer views_;   // [V][R_view], padded rows
  Buffer lights_;  // [L or V L][channels][R_light], padded rows
  Buffer table_;   // [P][C][R_view][R_light], padded rows
};

}  // namespace

std::unique_ptr<DeviceDecoder> tucker_decoder(Device& device, const TuckerModel& model) {
  return std::make_unique<TuckerDeviceDecoder>(device, model);
}

std::size_t tucker_decoder_bytes(const TuckerModel& model) {
  const CoreShape core(model);
  const BtfShape& shape = model.info.btf.shape;
  std::size_t values = model.coefficients();
  if (core.views_alone && model.has_factor(0)) {
    values += views_at_once(model, core) * core.lights * core.texels;
  }
  const std::size_t image = std::max(core.texels * core.light_channels, shape.image_values());
  // two runs on the way, and what a product packs
  return (values + 2 * image_granule(shape) * image) * sizeof(float) + (std::size_t{16} << 20);
}

std::unique_ptr<DeviceSampler> tucker_sampler(Device& device, const TuckerModel& model) {
  return std::make_unique<TuckerDeviceSampler>(device, model);
}

std::size_t tucker_sampler_bytes(const TuckerModel& model) {
  return TuckerDeviceSampler::bytes(model);
}

}  // namespace weft
