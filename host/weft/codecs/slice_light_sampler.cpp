#include "weft/codecs/slice_light_sampler.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "weft/btf/hemisphere.hpp"
#include "weft/error.hpp"
#include "weft/ops/light_slices.hpp"
#include "weft/ops/shade.hpp"

namespace weft {
namespace {

using Float4 = std::array<float, 4>;
constexpr LookupShape lookup{1, 3, 1};

// Device memory that the slices of one batch take, and the queries that are answered from them.
constexpr std::size_t batch_bytes = std::size_t{16} << 20;
constexpr std::size_t batch_queries = std::size_t{1} << 18;

class SliceLightSampler final : public LightSampler {
 public:
  SliceLightSampler(Device& device, const BtfInfo& info, std::unique_ptr<DeviceSampler> sampler)
      : device_(device),
        shape_(info.shape),
        sampler_(std::move(sampler)),
        views_(device, Hemisphere(info.view_directions)),
        nodes_(device, info, LightNodes(info.light_directions, info.quantity)) {
    if (info.layout != Layout::grid) {
      fail_input("layout 'paired': drawing lights needs every view with every light");
    }
    const std::size_t per_light =
        (lookup.words() + shape_.channels + 1) * shape_.lights * sizeof(float);
    slice_bytes_ = per_light + (nodes_.cells() + nodes_.side() + 16) * sizeof(float);
  }

  void sample(std::span<const LightQuery> queries, std::span<const std::array<float, 2>> numbers,
              std::span<DrawnLight> out) override {
    static_assert(sizeof(DrawnLight) == sizeof(Float4));
    validate_light_numbers(numbers);
    for_each_batch(queries, [&](std::size_t first, std::size_t count) {
      make_densities();
      write(asked_, numbers.subspan(first, count), "numbers");
      reserve(answers_, count * sizeof(DrawnLight), "directions drawn");
      nodes_.draw(device_, count, slice_of_, asked_, densities_, row_sums_, answers_);
      device_.read(answers_, out.subspan(first, count));
    });
  }

  void densities(std::span<const LightQuery> queries, std::span<const std::array<float, 3>> lights,
                 std::span<float> out) override {
    for_each_batch(queries, [&](std::size_t first, std::size_t count) {
      make_densities();
      std::vector<Float4> directions;
      for (const auto& d : lights.subspan(first, count))
        directions.push_back({d[0], d[1], d[2], 0});
      write(asked_, std::span<const Float4>(directions), "directions");
      reserve(answers_, count * sizeof(float), "densities");
      nodes_.densities(device_, count, slice_of_, asked_, densities_, answers_);
      device_.read(answers_, out.subspan(first, count));
    });
  }

  void albedos(std::span<const LightQuery> queries, std::span<float> out) override {
    const std::size_t channels = shape_.channels;
    for_each_batch(queries, [&](std::size_t first, std::size_t count) {
      look_up();
      std::vector<float> found(slices_.size() * channels);
      reserve(answers_, found.size() * sizeof(float), "albedos");
      nodes_.albedos(device_, slices_.size(), values_, answers_);
      device_.read(answers_, std::span<float>(found));
      for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t c = 0; c < channels; ++c) {
          out[(first + i) * channels + c] = found[index_[i] * channels + c];
        }
      }
    });
  }

 private:
  // Calls work(first, count) for runs of queries whose distinct slices fit a batch; slices_,
  // index_ and slice_of_ are then those of the run.
  template <typename Work>
  void for_each_batch(std::span<const LightQuery> queries, const Work& work) {
    validate_light_queries(shape_, queries);
    const std::size_t most = std::max<std::size_t>(batch_bytes / slice_bytes_, 1);
    for (std::size_t first = 0; first < queries.size();) {
      check_interrupt();
      slices_.clear();
      index_.clear();
      std::size_t end = first;
      for (; end < queries.size() && end - first < batch_queries; ++end) {
        const bool same = !slices_.empty() && queries[end] == slices_.back();
        if (!same && slices_.size() == most) break;
        if (!same) slices_.push_back(queries[end]);
        index_.push_back(static_cast<std::uint32_t>(slices_.size() - 1));
      }
      write(slice_of_, std::span<const std::uint32_t>(index_), "slices of queries");
      work(first, end - first);
      first = end;
    }
  }

  // values_: what is stored of the slices, [slices][L][C].
  void look_up() {
    const std::size_t count = slices_.size(), records = count * shape_.lights;
    std::vector<Float4> directions;
    std::vector<std::uint32_t> texels;
    for (const auto& [view, texel] : slices_) {
      directions.push_back({view[0], view[1], view[2], 0});
      texels.push_back(texel);
    }
    write(directions_, std::span<const Float4>(directions), "views of slices");
    write(texels_, std::span<const std::uint32_t>(texels), "texels of slices");
    reserve(weighed_, count * ops::direction_words * sizeof(std::uint32_t), "weights of views");
    reserve(lookups_, records * lookup.words() * sizeof(std::uint32_t), "look-ups");
    reserve(values_, records * shape_.channels * sizeof(float), "values looked up");
    views_.weigh(device_, count, directions_, weighed_);
    nodes_.write_lookups(device_, count, texels_, weighed_, lookups_);
    sampler_->look_up(lookup, records, lookups_, values_);
  }

  void make_densities() {
    look_up();
    const std::size_t count = slices_.size();
    reserve(luminances_, count * shape_.lights * sizeof(float), "luminances of slices");
    reserve(densities_, count * nodes_.cells() * sizeof(float), "nodes of slices");
    reserve(row_sums_, count * nodes_.side() * sizeof(float), "rows of slices");
    nodes_.make_densities(device_, count, values_, luminances_, densities_, row_sums_);
  }

  // Grows a buffer that is too small; its contents are lost.
  void reserve(Buffer& buffer, std::size_t bytes, const char* what) {
    if (buffer && buffer.size() >= bytes) return;
    buffer = Buffer();
    buffer = Buffer(device_, bytes, what);
  }
  template <typename T>
  void write(Buffer& buffer, std::span<const T> values, const char* what) {
    reserve(buffer, values.size_bytes(), what);
    device_.write(buffer, values);
  }

  Device& device_;
  BtfShape shape_;
  std::unique_ptr<DeviceSampler> sampler_;
  ops::DeviceHemisphere views_;
  ops::DeviceLightNodes nodes_;
  std::size_t slice_bytes_ = 0;
  std::vector<LightQuery> slices_;    // of a run, each once where equal ones follow each other
  std::vector<std::uint32_t> index_;  // of each query
  Buffer directions_, texels_, weighed_, lookups_, values_, luminances_, densities_, row_sums_;
  Buffer slice_of_, asked_, answers_;
};

}  // namespace

std::unique_ptr<LightSampler> slice_light_sampler(Device& device, const BtfInfo& info,
                                                  std::unique_ptr<DeviceSampler> sampler) {
  return std::make_unique<SliceLightSampler>(device, info, std::move(sampler));
}

}  // namespace weft
