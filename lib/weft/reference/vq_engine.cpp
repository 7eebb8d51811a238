// What the steps of vector quantisation are made of, by the reference: resampling and search.
#include <algorithm>
#include <memory>
#include <optional>
#include <vector>

#include "weft/btf/resampling.hpp"
#include "weft/reference/similar_code_vector.hpp"
#include "weft/reference/vq.hpp"

namespace weft {

void measured_rows(const BtfShape& shape, std::span<const float> values, std::size_t count,
                   std::span<float> rows) {
  const std::size_t C = shape.channels;
  const std::size_t images = shape.images();
  for (std::size_t p = 0; p < count; ++p) {
    float* luminance = rows.data() + p * images * C;
    float* chromaticity = luminance + images;
    for (std::size_t image = 0; image < images; ++image) {
      const float* value = values.data() + (image * count + p) * C;
      *luminance++ = value[0];
      chromaticity = std::copy(value + 1, value + C, chromaticity);
    }
  }
}

double resampling_flops(const Resampling& r) {
  const std::size_t lit = r.frames.size() * r.new_lights * r.measured_lights;
  const std::size_t seen = r.new_views * r.frames.size() * r.new_lights;
  return 2.0 * static_cast<double>(lit + seen + r.zenith.size() * r.measured_lights);
}

namespace reference {
namespace {

class PlainEngine final : public VqEngine {
 public:
  PlainEngine(const BtfInfo& source, const VqRequest& request) : shape_(source.shape) {
    if (request.grid.kind == VqGrid::Kind::onion) {
      resampling_ = resample_to(source, request.grid.sizes);
    }
    if (request.similarity == VqSimilarity::ssim) {
      search_ = std::make_unique<PlainSimilarSearch>();
    } else {
      search_ = std::make_unique<PlainSearch>();
    }
  }

  NearestSearch& search() override { return *search_; }

  double resampling_flops() const override {
    return resampling_ ? static_cast<double>(shape_.channels) * weft::resampling_flops(*resampling_)
                       : 0;
  }

  void resample(std::span<const float> values, std::size_t count, std::span<float> rows) override {
    if (!resampling_) {
      measured_rows(shape_, values, count, rows);
      return;
    }
    const Resampling& r = *resampling_;
    const std::size_t columns = count * shape_.channels;
    const std::size_t nodes = r.new_views * r.new_lights;
    const std::vector<double> made = zenith(values, columns);
    // the lights of each frame, then the views; one light at a time
    std::vector<double> lit(r.frames.size() * columns), resampled(columns);
    for (std::size_t light = 0; light < r.new_lights; ++light) {
      std::fill(lit.begin(), lit.end(), 0.0);
      for (std::size_t f = 0; f < r.frames.size(); ++f) {
        const Resampling::Frame& frame = r.frames[f];
        const double* weights =
            r.lights.data() + (frame.lights * r.new_lights + light) * r.measured_lights;
        for (std::size_t l = 0; l < r.measured_lights; ++l) {
          const std::size_t image = frame.view * r.measured_lights + l;
          for (std::size_t i = 0; i < columns; ++i) {
            const double value = frame.view < r.measured_views ? double{values[image * columns + i]}
                                                               : made[l * columns + i];
            lit[f * columns + i] += weights[l] * value;
          }
        }
      }
      for (std::size_t view = 0; view < r.new_views; ++view) {
        std::fill(resampled.begin(), resampled.end(), 0.0);
        for (std::size_t f = 0; f < r.frames.size(); ++f) {
          const double weight = r.views[view * r.frames.size() + f];
          for (std::size_t i = 0; i < columns; ++i) {
            resampled[i] += weight * lit[f * columns + i];
          }
        }
        const std::size_t node = view * r.new_lights + light;
        for (std::size_t p = 0; p < count; ++p) {
          put_node(resampled.data() + p * shape_.channels, node, nodes,
                   rows.data() + p * nodes * shape_.channels);
        }
      }
    }
  }

 private:
  // The values of one texel at a node; luminance is not negative.
  void put_node(const double* values, std::size_t node, std::size_t nodes, float* row) const {
    row[node] = static_cast<float>(std::max(values[0], 0.0));
    float* chromaticity = row + nodes + node * (shape_.channels - 1);
    for (std::size_t c = 1; c < shape_.channels; ++c) {
      chromaticity[c - 1] = static_cast<float>(values[c]);
    }
  }

  // The zenith view that is made of the others, [L][columns].
  std::vector<double> zenith(std::span<const float> values, std::size_t columns) const {
    const Resampling& r = *resampling_;
    std::vector<double> made;
    if (r.zenith.empty()) return made;
    made.assign(r.measured_lights * columns, 0.0);
    for (std::size_t v = 0; v < r.measured_views; ++v) {
      const float* view = values.data() + v * made.size();
      for (std::size_t i = 0; i < made.size(); ++i) made[i] += r.zenith[v] * double{view[i]};
    }
    return made;
  }

  BtfShape shape_;
  std::optional<Resampling> resampling_;
  std::unique_ptr<NearestSearch> search_;
};

}  // namespace

std::unique_ptr<VqEngine> vq_engine(const BtfInfo& source, const VqRequest& request) {
  return std::make_unique<PlainEngine>(source, request);
}

}  // namespace reference
}  // namespace weft
