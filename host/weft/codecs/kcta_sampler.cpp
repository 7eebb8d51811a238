#include "weft/codecs/kcta_sampler.hpp"

#include <algorithm>
#include <span>
#include <utility>
#include <vector>

#include "weft/codecs/kcta_decoder.hpp"
#include "weft/codecs/slice_rows.hpp"
#include "weft/codecs/tucker_sampler.hpp"
#include "weft/ops/look_up_kcta.hpp"
#include "weft/ops/order_lookups.hpp"

namespace weft {
namespace {

constexpr std::size_t light_group = 1;  // behind views that stand alone

ops::KctaRows rows_of(const KctaModel& model) {
  ops::KctaRows rows;
  rows.clusters = model.clusters;
  rows.mixtures = model.mixtures;
  rows.views = model.ranks[0];
  rows.lights = model.ranks[light_group];
  rows.light_channels = model.groups.groups()[light_group].has(Mode::channel);
  rows.local_lights = !model.local[light_group].empty();
  return rows;
}

// Values of one view and light of the cores with the factors of texels multiplied out.
std::size_t image_of(const KctaModel& model) {
  const BtfShape& shape = model.info.btf.shape;
  return rows_of(model).light_channels ? shape.texels() : shape.image_values();
}

std::size_t table_floats(const KctaModel& model) {
  const ops::KctaRows rows = rows_of(model);
  return ops::row_floats(image_of(model) * rows.clusters * rows.views, rows.lights,
                         "cores by texels");
}

// Rows of lights: of a factor for all clusters or each of them, or of an identity.
std::size_t light_rows(const KctaModel& model) {
  return (rows_of(model).local_lights ? model.clusters : 1) *
         model.groups.groups()[light_group].size;
}

class ViewClusterSampler final : public DeviceSampler {
 public:
  ViewClusterSampler(Device& device, const KctaModel& model)
      : device_(device),
        shape_(model.info.btf.shape),
        rows_(rows_of(model)),
        order_(device, shape_.texels()) {
    std::vector<std::uint32_t> members;
    std::vector<float> mixing = model.mixing;
    mixing.insert(mixing.end(), model.grid_mixing.begin(), model.grid_mixing.end());
    for (std::size_t i = 0; i < model.all_slices(); ++i) {
      for (std::size_t k = 0; k < model.mixtures; ++k) {
        members.push_back(static_cast<std::uint32_t>(model.member(i, k)));
      }
    }
    clusters_ = Buffer(device, members.size() * sizeof(std::uint32_t), "clusters of views");
    device.write(clusters_, std::span<const std::uint32_t>(members));
    mixing_ = Buffer(device, mixing.size() * sizeof(float), "mixing coefficients");
    device.write(mixing_, std::span<const float>(mixing));
    const std::vector<float>& factor =
        rows_.local_lights ? model.local[light_group] : model.global[light_group];
    const std::size_t lit = light_rows(model);
    lights_ = Buffer(device, ops::row_floats(lit, rows_.lights, "rows of lights") * sizeof(float),
                     "rows of lights");
    ops::write_rows(
        device, lit, rows_.lights,
        [&](std::size_t row, std::size_t j) {
          return factor.empty() ? (row == j ? 1.0f : 0.0f) : factor[row * rows_.lights + j];
        },
        lights_);
    write_table(model);
  }

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    validate(lookup, shape_);
    order_.for_each({lookup, shape_, count, lookups, out}, [&](const ops::LookupBatch& batch) {
      ops::look_up_kcta(device_, batch, rows_, clusters_, mixing_, lights_, table_);
    });
  }

  // Views that are neighbours share most of their clusters: those of one and a half are counted.
  double lookup_flops(const LookupShape& lookup) const override {
    const double mixed = lookup.views > 1 ? 1.5 : 1.0;
    const double rows =
        std::min(static_cast<double>(rows_.clusters), mixed * static_cast<double>(rows_.mixtures)) *
        static_cast<double>(rows_.views);
    return 2.0 * static_cast<double>(lookup.texels * shape_.channels * rows_.lights) * rows;
  }

 private:
  // [P][C where not merged][clusters][views] rows of lights, from cores expanded to
  // [clusters][views][lights][image].
  void write_table(const KctaModel& model) {
    const std::size_t image = image_of(model);
    std::vector<std::size_t> sizes(model.ranks.begin() + 1, model.ranks.end());
    const std::size_t core = rows_.views * model.core_row();
    std::vector<float> expanded(rows_.clusters * rows_.views * rows_.lights * image);
    for (std::size_t c = 0; c < rows_.clusters; ++c) {
      std::vector<std::vector<float>> factors(model.groups.count());
      std::vector<RowProduct> steps;
      for (std::size_t n = model.groups.count(); n-- > light_group + 1;) {
        const std::span<const float> U = model.factor(n, c);
        if (U.empty()) continue;
        factors[n].assign(U.begin(), U.end());
        steps.push_back(
            {n - 1, ops::ModeProduct::expand, model.groups.groups()[n].size, factors[n]});
      }
      multiply_modes(
          device_, sizes,
          row_list(std::span(model.cores).subspan(c * core, core), rows_.views, model.core_row()),
          steps, expanded.data() + c * rows_.views * rows_.lights * image);
    }
    const std::size_t slices = rows_.clusters * rows_.views;
    const std::size_t channels = image / shape_.texels();
    const bool channels_first = model.groups.channels_first();
    table_ = Buffer(device_, table_floats(model) * sizeof(float), "cores by texels");
    ops::write_rows(
        device_, image * slices, rows_.lights,
        [&](std::size_t row, std::size_t j) {
          const std::size_t slice = row % slices;
          const std::size_t c = row / slices % channels;
          const std::size_t p = row / slices / channels;
          const std::size_t at = channels_first ? c * shape_.texels() + p : p * channels + c;
          return expanded[(slice * rows_.lights + j) * image + at];
        },
        table_);
  }

  Device& device_;
  BtfShape shape_;
  ops::KctaRows rows_;
  ops::TexelOrder order_;
  Buffer clusters_;  // of the measured views and those of a grid: [V + N N][K]
  Buffer mixing_;    // [V + N N][K][R_view]
  Buffer lights_;    // rows of lights, padded
  Buffer table_;     // cores by texels, padded rows of lights
};

// By the stacked model, for clusters of other modes.
class StackedSampler final : public DeviceSampler {
 public:
  StackedSampler(Device& device, const KctaModel& model)
      : model_(stacked(device, model)), sampler_(tucker_sampler(device, *model_)) {
    device.finish();
    model_->core = FloatStore();  // the sampler has its own
  }
  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    sampler_->look_up(lookup, count, lookups, out);
  }
  double lookup_flops(const LookupShape& lookup) const override {
    return sampler_->lookup_flops(lookup);
  }

 private:
  std::unique_ptr<TuckerModel> model_;
  std::unique_ptr<DeviceSampler> sampler_;
};

}  // namespace

std::unique_ptr<DeviceSampler> kcta_sampler(Device& device, const KctaModel& model) {
  if (model.clusters_views()) return std::make_unique<ViewClusterSampler>(device, model);
  return std::make_unique<StackedSampler>(device, model);
}

std::size_t kcta_sampler_bytes(const KctaModel& model) {
  if (!model.clusters_views()) {
    return tucker_sampler_bytes(*stacked_outline(model)) + stacking_bytes(model);
  }
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t floats =
      2 * table_floats(model) + model.mixing.size() + model.grid_mixing.size() +
      ops::row_floats(light_rows(model), model.ranks[light_group], "rows of lights");
  return floats * sizeof(float) +
         (model.members.size() + model.grid_members.size()) * sizeof(std::uint32_t) +
         ops::TexelOrder::most_bytes(shape.texels());
}

}  // namespace weft
