#include "weft/codecs/kcta_decoder.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "weft/codecs/slice_rows.hpp"
#include "weft/codecs/tucker_decoder.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

// Cores larger than this are held in files on their way to the device.
constexpr std::size_t most_held_bytes = std::size_t{1} << 30;

// The rows of the stacked core, without the mixing matrices.
std::size_t stacked_rows(const KctaModel& model) {
  return model.clusters * model.ranks[model.mode];
}

bool mixes_slices(const KctaModel& model) {
  return stacked_rows(model) < model.slices();
}

std::size_t core_values(const TuckerModel& whole) {
  return product(whole.ranks);
}

class KctaDeviceDecoder final : public DeviceDecoder {
 public:
  KctaDeviceDecoder(Device& device, const KctaModel& model)
      : model_(stacked(device, model)), decoder_(tucker_decoder(device, *model_)) {
    device.finish();
    model_->core = FloatStore();  // the decoder has its own
  }
  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    decoder_->decode(first, count, out);
  }
  double image_flops() const override { return decoder_->image_flops(); }

 private:
  std::unique_ptr<TuckerModel> model_;
  std::unique_ptr<DeviceDecoder> decoder_;
};

}  // namespace

std::unique_ptr<TuckerModel> stacked_outline(const KctaModel& model) {
  auto whole = std::make_unique<TuckerModel>();
  whole->info = model.info;
  whole->set_groups(model.groups);
  for (std::size_t n = 0; n < model.groups.count(); ++n) {
    if (n == model.mode || !model.local[n].empty()) continue;
    whole->ranks[n] = model.ranks[n];
    whole->factors[n] = model.global[n];
  }
  if (!mixes_slices(model)) return whole;
  const std::size_t rank = model.ranks[model.mode];
  const std::size_t rows = stacked_rows(model);
  whole->ranks[model.mode] = rows;
  std::vector<float>& U = whole->factors[model.mode];
  U.assign(model.slices() * rows, 0.0f);
  for (std::size_t i = 0; i < model.members.size(); ++i) {
    const std::size_t slice = i / model.mixtures;
    const std::span<const float> row = model.mixing_row(slice, i % model.mixtures);
    std::copy(row.begin(), row.end(),
              U.begin() + static_cast<std::ptrdiff_t>(slice * rows + model.members[i] * rank));
  }
  return whole;
}

std::unique_ptr<TuckerModel> stacked(Device& device, const KctaModel& model) {
  std::unique_ptr<TuckerModel> whole = stacked_outline(model);
  // rows of all clusters with their own factors multiplied out, the clustered mode first
  std::vector<std::size_t> sizes = model.other_ranks();
  std::size_t length = 1;
  std::size_t axis = 0;
  std::vector<std::pair<std::size_t, std::size_t>> local;  // axis of a row, group
  for (std::size_t n = 0; n < model.groups.count(); ++n) {
    if (n == model.mode) continue;
    length *= whole->ranks[n];
    if (!model.local[n].empty()) local.emplace_back(axis, n);
    ++axis;
  }
  const std::size_t rank = model.ranks[model.mode];
  const std::size_t rows = stacked_rows(model);
  const auto place = [](std::size_t values) {
    return values * sizeof(float) > most_held_bytes ? FloatStore::Place::file
                                                    : FloatStore::Place::memory;
  };
  FloatStore stack(rows * length, place(rows * length));
  for (std::size_t c = 0; c < model.clusters; ++c) {
    std::vector<std::vector<float>> factors;
    for (const auto& [at, n] : local) {
      const std::span<const float> U = model.factor(n, c);
      factors.emplace_back(U.begin(), U.end());
    }
    std::vector<RowProduct> steps;
    for (std::size_t s = local.size(); s-- > 0;) {
      const auto& [at, n] = local[s];
      steps.push_back({at, ops::ModeProduct::expand, model.groups.groups()[n].size, factors[s]});
    }
    const std::size_t core = rank * model.core_row();
    multiply_modes(device, sizes,
                   row_list(std::span(model.cores).subspan(c * core, core), rank, model.core_row()),
                   steps, stack.data() + c * rank * length);
  }
  std::size_t count = rows;
  if (!mixes_slices(model)) {
    count = model.slices();
    FloatStore slices(count * length, place(count * length));
    std::vector<float> M(count * rows, 0.0f);
    for (std::size_t i = 0; i < model.members.size(); ++i) {
      const std::size_t slice = i / model.mixtures;
      const std::span<const float> row = model.mixing_row(slice, i % model.mixtures);
      std::copy(row.begin(), row.end(),
                M.begin() + static_cast<std::ptrdiff_t>(slice * rows + model.members[i] * rank));
    }
    combine_rows(device, length, {}, M, row_list(stack, rows, length), slices.data());
    stack = std::move(slices);
  }
  if (model.mode == 0) {
    whole->core = std::move(stack);
    return whole;
  }
  // [m][outer][inner] -> [outer][m][inner]
  const std::size_t outer = product(std::span(whole->ranks).first(model.mode));
  const std::size_t inner = length / outer;
  whole->core = FloatStore(stack.size(), stack.place());
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t o = 0; o < outer; ++o) {
      std::copy_n(stack.data() + (i * outer + o) * inner, inner,
                  whole->core.data() + (o * count + i) * inner);
    }
  }
  return whole;
}

std::unique_ptr<DeviceDecoder> kcta_decoder(Device& device, const KctaModel& model) {
  return std::make_unique<KctaDeviceDecoder>(device, model);
}

std::size_t stacking_bytes(const KctaModel& model) {
  const std::unique_ptr<TuckerModel> whole = stacked_outline(model);
  const std::size_t core = core_values(*whole) * sizeof(float);
  const std::size_t rows = stacked_rows(model) * (core / whole->ranks[model.mode]);
  return std::min(core, most_held_bytes) + std::min(std::max(core, rows), most_held_bytes);
}

std::size_t kcta_decoder_bytes(const KctaModel& model) {
  const std::unique_ptr<TuckerModel> whole = stacked_outline(model);
  const std::size_t core = core_values(*whole) * sizeof(float);
  const bool in_file = core > most_held_bytes;
  return tucker_decoder_bytes(*whole) + (in_file ? 0 : core) + stacking_bytes(model);
}

}  // namespace weft
