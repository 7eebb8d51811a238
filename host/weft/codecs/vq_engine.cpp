#include "weft/codecs/vq_engine.hpp"

#include <algorithm>
#include <optional>
#include <vector>

#include "weft/btf/resampling.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/ops/nearest_code_vector.hpp"
#include "weft/ops/similar_code_vector.hpp"

namespace weft {
namespace {

std::vector<float> in_float(const std::vector<double>& values) {
  return {values.begin(), values.end()};
}

Buffer upload(Device& device, const std::vector<float>& values, const char* what) {
  Buffer buffer(device, std::max<std::size_t>(values.size(), 1) * sizeof(float), what);
  if (!values.empty()) device.write(buffer, std::span<const float>(values));
  return buffer;
}

// Values [images][count][C] of blocks of texels at the nodes of onion slices, by products with the
// matrices of a resampling: the lights of each frame, then the views.
class DeviceResampling {
 public:
  DeviceResampling(Device& device, const BtfInfo& source, const OnionSizes& sizes)
      : device_(device),
        channels_(source.shape.channels),
        resampling_(resample_to(source, sizes)),
        lights_(upload(device, in_float(resampling_.lights), "weights of lights")),
        views_(upload(device, in_float(resampling_.views), "weights of views")),
        zenith_(upload(device, in_float(resampling_.zenith), "weights of the zenith")) {}

  // Of one texel.
  double flops() const { return static_cast<double>(channels_) * resampling_flops(resampling_); }

  void resample(std::span<const float> values, std::size_t count, std::span<float> rows) {
    using ops::Transpose;
    const Resampling& r = resampling_;
    const std::size_t columns = count * channels_;
    const std::size_t view = r.measured_lights * columns;
    const std::size_t lit_frame = r.new_lights * columns;
    const std::size_t nodes = r.new_views * r.new_lights;
    make_room(columns);
    device_.write(values_, values);
    if (!r.zenith.empty()) {
      ops::gemm(device_, Transpose::no, Transpose::no, 1, view, r.measured_views, 1,
                {zenith_, r.measured_views}, {values_, view}, 0,
                {values_, view, r.measured_views * view});
    }
    for (std::size_t f = 0; f < r.frames.size(); ++f) {
      const Resampling::Frame& frame = r.frames[f];
      ops::gemm(device_, Transpose::no, Transpose::no, r.new_lights, columns, r.measured_lights, 1,
                {lights_, r.measured_lights, frame.lights * r.new_lights * r.measured_lights},
                {values_, columns, frame.view * view}, 0, {lit_, columns, f * lit_frame});
    }
    ops::gemm(device_, Transpose::no, Transpose::no, r.new_views, lit_frame, r.frames.size(), 1,
              {views_, r.frames.size()}, {lit_, lit_frame}, 0, {resampled_, lit_frame});
    resampled_values_.resize(nodes * columns);
    device_.read(resampled_, std::span<float>(resampled_values_));
    // some nodes of all texels after each other: what is read stays in a cache for all of them
    constexpr std::size_t together = 32;
    for (std::size_t first = 0; first < nodes; first += together) {
      const std::size_t end = std::min(first + together, nodes);
      for (std::size_t p = 0; p < count; ++p) {
        float* luminance = rows.data() + p * nodes * channels_;
        float* chromaticity = luminance + nodes + first * (channels_ - 1);
        for (std::size_t node = first; node < end; ++node) {
          const float* value = resampled_values_.data() + node * columns + p * channels_;
          luminance[node] = std::max(value[0], 0.0f);
          for (std::size_t c = 1; c < channels_; ++c) *chromaticity++ = value[c];
        }
      }
    }
  }

 private:
  void make_room(std::size_t columns) {
    if (columns <= columns_) return;
    const Resampling& r = resampling_;
    columns_ = columns;
    for (Buffer* buffer : {&values_, &lit_, &resampled_}) *buffer = Buffer();
    const auto floats = [&](std::size_t rows, const char* what) {
      return Buffer(device_, rows * columns * sizeof(float), what);
    };
    values_ = floats((r.measured_views + 1) * r.measured_lights, "values of texels");
    lit_ = floats(r.frames.size() * r.new_lights, "values in new lights");
    resampled_ = floats(r.new_views * r.new_lights, "resampled values");
  }

  Device& device_;
  std::size_t channels_;
  Resampling resampling_;
  Buffer lights_, views_, zenith_;
  std::size_t columns_ = 0;
  Buffer values_, lit_, resampled_;
  std::vector<float> resampled_values_;
};

std::unique_ptr<NearestSearch> search_on(Device& device, VqSimilarity similarity) {
  if (similarity == VqSimilarity::ssim) return std::make_unique<ops::DeviceSimilarSearch>(device);
  return std::make_unique<ops::DeviceNearestSearch>(device);
}

class DeviceEngine final : public VqEngine {
 public:
  DeviceEngine(Device& device, const BtfInfo& source, const VqRequest& request)
      : shape_(source.shape), search_(search_on(device, request.similarity)) {
    if (request.grid.kind == VqGrid::Kind::onion) {
      resampling_.emplace(device, source, request.grid.sizes);
    }
  }

  NearestSearch& search() override { return *search_; }
  double resampling_flops() const override { return resampling_ ? resampling_->flops() : 0; }

  void resample(std::span<const float> values, std::size_t count, std::span<float> rows) override {
    if (resampling_) {
      resampling_->resample(values, count, rows);
    } else {
      measured_rows(shape_, values, count, rows);
    }
  }

 private:
  BtfShape shape_;
  std::unique_ptr<NearestSearch> search_;
  std::optional<DeviceResampling> resampling_;
};

// Floats of the buffers of a resampling beside its matrices, for each column; and of these.
std::size_t resampling_bytes(const BtfInfo& source, const VqRequest& request, std::size_t count) {
  const BtfShape& shape = source.shape;
  const OnionSizes& n = request.grid.sizes;
  const std::size_t frames = shape.views + n.phi;
  const std::size_t column =
      (shape.views + 1) * shape.lights + frames * n.lights() + 2 * request.grid.nodes();
  const std::size_t matrices =
      frames * n.lights() * shape.lights + n.views() * frames + shape.views;
  return (count * shape.channels * column + 4 * matrices) * sizeof(float);
}

}  // namespace

MemoryPlan plan_device_vq(Device& device, const BtfInfo& source, const VqRequest& request,
                          std::size_t trained, const Job& job) {
  MemoryPlan plan = plan_vq(source, request, trained, job);
  const VectorShape vector = texel_vector(request.grid, source.shape.channels);
  const std::size_t block = vq_block(source, request);
  const std::size_t most = std::min(trained, job.memory / 4 / (vector.values() * sizeof(float)));
  plan.add("nearest code-vectors",
           request.similarity == VqSimilarity::ssim
               ? ops::DeviceSimilarSearch::bytes(device, vector, most, block)
               : ops::DeviceNearestSearch::bytes(device, vector, most, block));
  if (request.grid.kind == VqGrid::Kind::onion) {
    plan.add("resampling", resampling_bytes(source, request, block));
  }
  return plan;
}

std::unique_ptr<VqEngine> device_vq_engine(Device& device, const BtfInfo& source,
                                           const VqRequest& request) {
  return std::make_unique<DeviceEngine>(device, source, request);
}

}  // namespace weft
