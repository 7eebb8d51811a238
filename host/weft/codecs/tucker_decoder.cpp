#include "weft/codecs/tucker_decoder.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "weft/codecs/texel_factors.hpp"
#include "weft/device/tile_stream.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/turn_channels.hpp"

namespace weft {
namespace {

constexpr std::size_t widest_panel = 48;
constexpr std::size_t nowhere = std::numeric_limits<std::size_t>::max();

// What a decoder does in which order, by the model alone.
struct Order {
  TuckerCore core;
  BtfShape shape;
  bool views_factor = false;
  bool lights_factor = false;
  bool texels_factor = false;
  // The texels' factors before the rows of lights, for as many slices as the lights have ranks, and
  // not after them, for every image.
  bool texels_first = false;
  // What the rows of lights are multiplied with is the core, or its product with a view's row, as
  // it is, and not what the texels' factors made of it.
  bool plain_lights = false;
  std::size_t views_at_once = 1;  // views that share a pass over the core

  explicit Order(const TuckerModel& model)
      : core(model),
        shape(model.info.btf.shape),
        views_factor(core.views_alone && model.has_factor(0)),
        lights_factor(model.has_factor(core.light_group)),
        texels_factor(core.of_rows || core.of_columns) {
    texels_first = lights_factor && (!texels_factor || (fits() && late_cost() < early_cost()));
    plain_lights = lights_factor && !(texels_first && (texels_factor || core.channels_alone));
    constexpr std::size_t most_values = std::size_t{32} << 20;
    constexpr std::size_t most_views = 24;  // three micro-tiles of 8 rows
    const std::size_t most = std::min(most_views, shape.views);
    views_at_once = std::clamp<std::size_t>(most_values / view_values(), 1, most);
    // blocks of equal size
    const std::size_t blocks = ops::ceil_div(shape.views, views_at_once);
    views_at_once = std::min(views_at_once, ops::round_up(ops::ceil_div(shape.views, blocks), 8));
  }

  // Images that share a view's slices.
  std::size_t lights() const { return core.views_alone ? shape.lights : shape.images(); }
  // What a row of lights gives: values before and after the texels' factors.
  std::size_t row_values() const {
    return texels_first ? shape.image_values() / core.light_channels : core.slice();
  }
  // Values of one view's product with the core, as it is stored.
  std::size_t view_values() const {
    return plain_lights ? core.lights * ops::round_up(core.slice(), widest_panel)
                        : core.lights * core.slice();
  }
  // Slices of lights that go through the texels' factors at a time.
  std::size_t images_at_once() const {
    constexpr std::size_t most_values = std::size_t{1} << 20;
    return std::max<std::size_t>(
        1, most_values / (core.light_channels * std::max(core.slice(), core.expanded())));
  }
  double mixing_flops() const {
    return core.of_channels ? 2.0 * static_cast<double>(shape.image_values() * core.channels) : 0;
  }

  // Flops of an image.
  double flops() const {
    const double rows = static_cast<double>(core.light_channels);
    double flops = 0;
    if (views_factor) {
      flops += 2.0 * static_cast<double>(core.views * core.lights * core.slice()) /
               static_cast<double>(shape.lights);
    }
    if (lights_factor) flops += 2.0 * rows * static_cast<double>(core.lights * row_values());
    const double slices = texels_first ? static_cast<double>(core.lights) / images_of_view() : rows;
    return flops + slices * TexelFactors::flops(core) +
           (texels_first ? slices : 1.0) * mixing_flops();
  }

 private:
  double images_of_view() const { return static_cast<double>(lights()); }
  // Either order's flops for an image, and what it moves, which takes as long as so many flops.
  static constexpr double moved = 8;
  double late_cost() const {
    const double slices = static_cast<double>(core.lights) / images_of_view();
    const double image = static_cast<double>(shape.image_values());
    return slices * (TexelFactors::flops(core) + mixing_flops() +
                     moved * (TexelFactors::traffic(core) + 2 * image)) +
           image * (2 * static_cast<double>(core.lights) + moved);
  }
  double early_cost() const {
    const double rows = static_cast<double>(core.light_channels);
    return rows * (2 * static_cast<double>(core.lights * core.slice()) + TexelFactors::flops(core) +
                   moved * TexelFactors::traffic(core)) +
           mixing_flops() + 2 * moved * static_cast<double>(shape.image_values());
  }
  // Whether what the lights share is not much larger than the model.
  bool fits() const {
    constexpr std::size_t most_values = std::size_t{32} << 20;
    return core.lights * (core.expanded() + shape.image_values() / core.light_channels) <=
           std::max(most_values, core.views * core.lights * core.slice());
  }
};

Buffer plain_buffer(Device& device, std::span<const float> values, const char* what) {
  Buffer buffer(device, values.size_bytes(), what);
  device.write(buffer, values);
  return buffer;
}

// The matrix [rows][groups columns] in panels of rows, the columns of each group in panels too, so
// that a row of a product with it is `groups` rows in panels:
//
//   [ceil(columns / NR)][groups][rows][NR]
//
// With one group these are the panels of gemm.cl. Of a core in a file they are `held` in another.
Buffer packed_core(Device& device, const FloatStore& core, std::size_t rows, std::size_t groups,
                   std::size_t columns, FloatStore& held) {
  const std::size_t width = ops::panel_width(device);
  const std::size_t panels = ops::ceil_div(columns, width);
  const std::size_t panel_values = groups * rows * width;
  const bool in_file = core.place() == FloatStore::Place::file && device.limits().unified_memory;
  Buffer packed;
  if (in_file) {
    held = FloatStore(panels * panel_values, FloatStore::Place::file);
    packed = Buffer::wrap(device, std::as_bytes(std::span<const float>(held)), "core");
  } else {
    packed = Buffer(device, panels * panel_values * sizeof(float), "core");
  }
  constexpr std::size_t most_values = std::size_t{2} << 20;
  const std::size_t at_once = std::clamp<std::size_t>(most_values / panel_values, 1, panels);
  std::vector<float> part(at_once * panel_values);
  for (std::size_t first = 0; first < panels; first += at_once) {
    const std::size_t count = std::min(at_once, panels - first);
    float* to = part.data();
    for (std::size_t panel = first; panel < first + count; ++panel) {
      const std::size_t begin = panel * width;
      const std::size_t whole = std::min(width, columns - begin);
      for (std::size_t group = 0; group < groups; ++group) {
        for (std::size_t row = 0; row < rows; ++row, to += width) {
          const float* from = core.data() + (row * groups + group) * columns + begin;
          std::copy_n(from, whole, to);
          std::fill(to + whole, to + width, 0.0f);
        }
      }
    }
    if (in_file) {
      std::copy_n(part.begin(), count * panel_values, held.begin() + first * panel_values);
      core.release();
      held.release();
      continue;
    }
    device.write(packed, std::span<const float>(part).first(count * panel_values),
                 first * panel_values);
  }
  return packed;
}

class TuckerDeviceDecoder final : public DeviceDecoder {
 public:
  TuckerDeviceDecoder(Device& device, const TuckerModel& model)
      : device_(device), order_(model), texels_(device, order_.core) {
    const TuckerCore& core = order_.core;
    if (order_.views_factor) {
      // the core's product with a view is slices, or a matrix of lights in panels
      core_ =
          order_.plain_lights
              ? packed_core(device, model.core, core.views, core.lights, core.slice(), held_)
              : packed_core(device, model.core, core.views, 1, core.lights * core.slice(), held_);
      views_ = plain_buffer(device, model.factors[0], "factor of views");
      view_values_ = order_.plain_lights ? ops::packed_elements(device, core.lights, core.slice())
                                         : core.lights * core.slice();
      of_views_ =
          Buffer(device, order_.views_at_once * view_values_ * sizeof(float), "core of some views");
    } else {
      core_ = plain_buffer(device, model.core, "core");
      view_values_ = core.lights * core.slice();
    }
    if (order_.lights_factor) {
      lights_ = plain_buffer(device, model.factors[core.light_group], "factor of lights");
      if (!(order_.plain_lights && order_.views_factor)) {
        packed_ = Buffer(
            device, ops::packed_elements(device, core.lights, order_.row_values()) * sizeof(float),
            "slices of lights");
      }
    }
    if (core.of_channels) channels_ = plain_buffer(device, *core.of_channels, "factor of channels");
    if (texels_.any() && order_.texels_first) {
      slices_ = Buffer(device, core.lights * core.expanded() * sizeof(float), "expanded slices");
    }
    const std::size_t rows = order_.images_at_once() * core.light_channels;
    if (order_.lights_factor && (!order_.texels_first || core.light_channels > 1)) {
      const std::size_t values = rows * order_.row_values();
      lit_ = Buffer(device, values * sizeof(float), "images of the core");
    }
    if (texels_.any() && !order_.texels_first && turns()) {
      images_ = Buffer(device, rows * core.expanded() * sizeof(float), "images on the way");
    }
  }

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    const std::size_t lights = order_.lights();
    const std::size_t image = order_.shape.image_values();
    for (std::size_t i = first; i < first + count;) {
      const std::size_t run = std::min(first + count - i, lights - i % lights);
      light(i / lights, i % lights, run, out, (i - first) * image);
      i += run;
    }
  }

  double image_flops() const override { return order_.flops(); }

 private:
  // Whether images come with their channels first.
  bool turns() const { return order_.core.channels_alone || order_.core.light_channels > 1; }

  // Images of lights [light, light + count) of a view to an offset of `out`.
  void light(std::size_t view, std::size_t light, std::size_t count, Buffer& out,
             std::size_t offset) {
    const TuckerCore& core = order_.core;
    const std::size_t image = order_.shape.image_values();
    if (order_.lights_factor) prepare(view);
    if (order_.texels_first && core.light_channels == 1) {
      multiply_lights(view, light, count, out, offset);
      return;
    }
    const std::size_t at_once = order_.images_at_once();
    for (std::size_t i = 0; i < count; i += at_once) {
      const std::size_t images = std::min(at_once, count - i);
      const std::size_t rows = images * core.light_channels;
      const std::size_t to = offset + i * image;
      // the core's slice of each row
      const Buffer* from = &lit_;
      std::size_t at = 0;
      if (order_.lights_factor) {
        multiply_lights(view, light + i, images, lit_, 0);
      } else {
        from = &slices_of(view, at);
        at += (light + i) * core.light_channels * core.slice();
      }
      if (texels_.any() && !order_.texels_first) {
        texels_.expand(*from, at, rows, turns() ? images_ : out, turns() ? 0 : to);
        from = &images_;
        at = 0;
      } else if (!turns()) {
        check_cl(clEnqueueCopyBuffer(device_.queue(), from->get(), out.get(), at * sizeof(float),
                                     to * sizeof(float), images * image * sizeof(float), 0, nullptr,
                                     nullptr),
                 "clEnqueueCopyBuffer");
      }
      if (turns()) ops::turn_channels(device_, channels_first(*from, at, images), out, to);
    }
  }

  // Rows of lights times what prepare() made.
  void multiply_lights(std::size_t view, std::size_t light, std::size_t count, Buffer& out,
                       std::size_t offset) {
    const std::size_t rank = order_.core.lights;
    const std::size_t rows = order_.core.light_channels;
    const std::size_t values = order_.row_values();
    const bool of_views = order_.plain_lights && order_.views_factor;
    const ops::Packed slices(of_views ? of_views_ : packed_,
                             of_views ? view % order_.views_at_once * view_values_ : 0);
    ops::gemm_packed(device_, count * rows, values, rank, 1,
                     ops::row_major(device_, lights_, rank, light * rows * rank), slices, 0,
                     ops::to_row_major(device_, out, values, offset));
  }

  // What the lights of a view share, unless it is what was made last.
  void prepare(std::size_t view) {
    const TuckerCore& core = order_.core;
    std::size_t at = 0;
    const Buffer& slices = slices_of(view, at);
    if ((order_.plain_lights && order_.views_factor) || view == prepared_) return;
    const Buffer* from = &slices;
    if (slices_) {
      texels_.expand(slices, at, core.lights, slices_, 0);
      from = &slices_;
      at = 0;
    }
    if (core.channels_alone && order_.texels_first) {
      ops::pack_channels(device_, channels_first(*from, at, core.lights), packed_);
    } else {
      const std::size_t values = order_.row_values();
      ops::pack_panels(device_, ops::row_major(device_, *from, values, at), core.lights, values,
                       packed_);
    }
    prepared_ = view;
  }

  // The core times a row of views: slices [lights] at an offset of a buffer.
  const Buffer& slices_of(std::size_t view, std::size_t& at) {
    if (!order_.views_factor) {
      at = view * view_values_;
      return core_;
    }
    const std::size_t block = view / order_.views_at_once;
    if (block != block_) {
      const std::size_t rank = order_.core.views;
      const std::size_t begin = block * order_.views_at_once;
      const std::size_t rows = std::min(order_.views_at_once, order_.shape.views - begin);
      ops::gemm_packed(device_, rows, view_values_, rank, 1,
                       ops::row_major(device_, views_, rank, begin * rank), core_, 0,
                       ops::to_row_major(device_, of_views_, view_values_));
      block_ = block;
    }
    at = view % order_.views_at_once * view_values_;
    return of_views_;
  }

  ops::ChannelsFirst channels_first(const Buffer& buffer, std::size_t offset,
                                    std::size_t count) const {
    const std::size_t channels = order_.shape.channels;
    return {buffer,
            offset,
            count,
            order_.shape.texels(),
            channels,
            order_.core.channels_alone ? order_.core.channels : channels,
            channels_ ? &channels_ : nullptr};
  }

  Device& device_;
  Order order_;
  TexelFactors texels_;
  std::size_t view_values_ = 0;  // from one view's slices to the next
  FloatStore held_;              // the core in panels, where they are in a file
  Buffer core_;                  // [views][lights][slice], or in panels if views have a factor
  Buffer views_, lights_, channels_;
  Buffer of_views_;  // products with rows of views, of views_at_once
  std::size_t block_ = nowhere;
  Buffer slices_;  // of a view, expanded
  Buffer packed_;  // what its rows of lights are multiplied with
  std::size_t prepared_ = nowhere;
  Buffer lit_, images_;  // images on the way
};

}  // namespace

std::unique_ptr<DeviceDecoder> tucker_decoder(Device& device, const TuckerModel& model) {
  return std::make_unique<TuckerDeviceDecoder>(device, model);
}

std::size_t tucker_decoder_bytes(const TuckerModel& model) {
  const Order order(model);
  const TuckerCore& core = order.core;
  const std::size_t rows = order.images_at_once() * core.light_channels;
  std::size_t values = model.coefficients();
  if (model.core.place() == FloatStore::Place::file) values -= model.core.size();
  // the core in panels, and what of it lies on the host on the way
  if (order.views_factor) {
    values += core.views * (order.view_values() - core.lights * core.slice()) +
              order.views_at_once * order.view_values() + (std::size_t{2} << 20) +
              core.views * core.lights * widest_panel;
  }
  const std::size_t packed = core.lights * ops::round_up(order.row_values(), widest_panel);
  values += packed + core.lights * core.expanded() +
            rows * (std::max(order.row_values(), core.slice()) + core.expanded());
  return values * sizeof(float) + TexelFactors::bytes(core);
}

}  // namespace weft
