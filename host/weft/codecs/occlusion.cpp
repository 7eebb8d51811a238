#include "weft/codecs/occlusion.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "weft/btf/mask_distance.hpp"
#include "weft/codecs/compress.hpp"
#include "weft/codecs/decoded_source.hpp"
#include "weft/error.hpp"
#include "weft/model/model_file.hpp"

namespace weft {
namespace {

// Images of numbers in memory.
class NumberSource final : public TileSource {
 public:
  NumberSource(BtfInfo info, std::vector<float> values)
      : info_(std::move(info)), values_(std::move(values)) {}

  const BtfInfo& info() const override { return info_; }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    const std::span<const std::byte> images = mapped(first, count);
    std::copy(images.begin(), images.end(), out.begin());
  }
  std::span<const std::byte> mapped(std::size_t first, std::size_t count) override {
    return std::as_bytes(std::span(values_))
        .subspan(first * info_.image_bytes(), count * info_.image_bytes());
  }

 private:
  BtfInfo info_;
  std::vector<float> values_;
};

std::vector<float> distances_of(const BtfInfo& info, float band) {
  const BtfShape& shape = info.shape;
  std::vector<float> distances = info.mask_distance;
  if (distances.empty()) {
    for (std::size_t view = 0; view < shape.views; ++view) {
      const auto mask = std::span(info.mask).subspan(view * shape.texels(), shape.texels());
      const std::vector<float> found = signed_distances(mask, shape.height, shape.width);
      distances.insert(distances.end(), found.begin(), found.end());
    }
    normalize_distances(distances);
  }
  // Means over texels of a finer level may lie on the other side of the outline than the mask.
  constexpr float least = 0x1p-10f;
  for (std::size_t i = 0; i < distances.size(); ++i) {
    distances[i] = info.mask[i] != 0 ? std::clamp(distances[i], least, band)
                                     : std::clamp(distances[i], -band, -least);
  }
  return distances;
}

// Models of a mask with their error texels.
class Fits {
 public:
  Fits(Device* device, const BtfInfo& info, const OcclusionRequest& request, Job& job)
      : device_(device),
        info_(info),
        request_(request),
        job_(job),
        source_(occlusion_source(info, request.kind, request.band)) {}

  // With a goal, if one is given.
  std::shared_ptr<const Occlusion> fit(const std::string& target) {
    CompressRequest fitted;
    fitted.codec = request_.codec;
    fitted.parameters = request_.parameters;
    fitted.storage = request_.storage;
    if (!target.empty()) fitted.goal = parse_goal(target, source_->info());
    Occlusion occlusion;
    occlusion.kind = request_.kind;
    occlusion.mapping = request_.mapping;
    occlusion.model = compress(device_, *source_, fitted, job_).model;
    occlusion.errors =
        count_error_texels(info_.mask, decode_occlusion(device_, occlusion, job_), occlusion.kind);
    return std::make_shared<Occlusion>(std::move(occlusion));
  }

  // The largest relative error, of a grid of ratios, with few enough error texels. Their number
  // need not fall with the error, so that it is counted at every step.
  std::shared_ptr<const Occlusion> fit_within(std::size_t most_errors) {
    constexpr double first = 0.5;
    constexpr double coarse_step = 0.5;
    constexpr double least = 1e-4;
    constexpr int refinements = 4;
    std::shared_ptr<const Occlusion> best;
    double misses = 1;
    double meets = first;
    std::size_t fewest = info_.mask.size();
    for (;; meets *= coarse_step) {
      if (meets < least) fail_unmet(most_errors, fewest);
      try {
        best = fit(relative_goal(meets));
      } catch (const Error& error) {
        if (error.kind() != ErrorKind::unmet_goal) throw;
        fail_unmet(most_errors, fewest);
      }
      fewest = std::min(fewest, best->errors.wrong);
      if (best->errors.wrong <= most_errors) break;
      misses = meets;
    }
    for (int i = 0; i < refinements; ++i) {
      const double middle = std::sqrt(misses * meets);
      std::shared_ptr<const Occlusion> candidate = fit(relative_goal(middle));
      if (candidate->errors.wrong <= most_errors) {
        meets = middle;
        best = std::move(candidate);
      } else {
        misses = middle;
      }
    }
    return best;
  }

 private:
  static std::string relative_goal(double error) { return fmt::format("rel={:.6g}", error); }

  [[noreturn]] void fail_unmet(std::size_t most_errors, std::size_t fewest) const {
    fail(ErrorKind::unmet_goal, "--occlusion-errors {}: codec {} came to no fewer than {} of {}",
         most_errors, request_.codec->name(), fewest, info_.mask.size());
  }

  Device* device_;
  const BtfInfo& info_;
  const OcclusionRequest& request_;
  Job& job_;
  std::shared_ptr<TileSource> source_;
};

}  // namespace

std::shared_ptr<TileSource> occlusion_source(const BtfInfo& info, OcclusionKind kind, double band) {
  if (info.mask.empty()) fail_input("occlusion: the material has no mask");
  std::vector<float> values = kind == OcclusionKind::distance
                                  ? distances_of(info, static_cast<float>(band))
                                  : std::vector<float>(info.mask.begin(), info.mask.end());
  return std::make_shared<NumberSource>(occlusion_info(info), std::move(values));
}

std::shared_ptr<const Occlusion> compress_occlusion(Device* device, const BtfInfo& info,
                                                    const OcclusionRequest& request, Job& job) {
  if (request.most_errors && !request.codec->takes_goals()) {
    fail_input("--occlusion-errors {}: codec {} takes no goals", *request.most_errors,
               request.codec->name());
  }
  const StageTimer timer(job, "mask");
  Job quiet;
  quiet.memory = job.memory;
  quiet.seed = job.seed;
  quiet.held = job.held;
  // the images that are fitted, and those that are decoded
  quiet.held.push_back({"mask", 3 * info.mask.size() * sizeof(float)});
  Fits fits(device, info, request, quiet);
  return request.most_errors ? fits.fit_within(*request.most_errors) : fits.fit(request.target);
}

std::vector<float> decode_occlusion(Device* device, const Occlusion& occlusion, Job& job) {
  const StageTimer timer(job, "decode the mask");
  const auto source = decoded_source(device, occlusion.model);
  const BtfShape& shape = source->info().shape;
  std::vector<float> values(shape.values());
  source->read(0, shape.images(), std::as_writable_bytes(std::span(values)));
  return values;
}

BtfInfo with_mask(BtfInfo info, OcclusionKind kind, std::vector<float> decoded) {
  info.mask.clear();
  info.mask.reserve(decoded.size());
  for (const float value : decoded) info.mask.push_back(is_visible(kind, value) ? 1 : 0);
  if (kind == OcclusionKind::distance) {
    for (float& value : decoded) value = std::clamp(value, -1.0f, 1.0f);
    info.mask_distance = std::move(decoded);
  }
  return info;
}

BtfInfo with_decoded_mask(Device* device, const ModelInfo& info, Job& job) {
  if (!info.occlusion) return info.btf;
  return with_mask(info.btf, info.occlusion->kind, decode_occlusion(device, *info.occlusion, job));
}

std::size_t decoded_mask_bytes(const ModelInfo& info) {
  if (!info.occlusion) return 0;
  const Model& model = *info.occlusion->model;
  constexpr std::size_t texel_bytes = 3 * sizeof(float) + 2;
  return model.info.btf.shape.values() * texel_bytes +
         find_codec(model.info.codec).decoder_bytes(model);
}

std::size_t occlusion_file_size(const Occlusion& occlusion) {
  return model_file_size(*occlusion.model);
}

}  // namespace weft
