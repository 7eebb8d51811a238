#include "weft/codecs/view_pca.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "weft/btf/view_source.hpp"
#include "weft/codecs/nested_components.hpp"
#include "weft/codecs/scan_source.hpp"
#include "weft/codecs/svd_options.hpp"
#include "weft/codecs/truncated_svd.hpp"
#include "weft/error.hpp"
#include "weft/model/storage.hpp"
#include "weft/model/view_pca.hpp"
#include "weft/ops/decode_pca.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/look_up_factors.hpp"
#include "weft/reference/view_pca.hpp"

namespace weft {
namespace {

const ViewPcaModel& as_view_pca(const Model& model) {
  return dynamic_cast<const ViewPcaModel&>(model);
}

// A view's factors on the device, as decode_pca takes them.
struct ViewFactors {
  std::size_t rank = 0;
  Buffer mean;  // [L C]
  Buffer A;     // panels of the texels
  Buffer B;     // [L C][k]
};

class ViewPcaDeviceDecoder final : public DeviceDecoder {
 public:
  ViewPcaDeviceDecoder(Device& device, const ViewPcaModel& model)
      : device_(device), shape_(model.info.btf.shape) {
    const std::size_t texels = shape_.texels();
    const std::size_t light_channels = shape_.lights * shape_.channels;
    const std::vector<std::size_t> offsets = model.offsets();
    const std::span<const float> images(model.images);
    const std::span<const float> means(model.mean);
    for (std::size_t v = 0; v < shape_.views; ++v) {
      const std::size_t k = offsets[v + 1] - offsets[v];
      ViewFactors view{k, Buffer(device, light_channels * sizeof(float), "mean of a view"),
                       Buffer(device, ops::packed_elements(device, k, texels) * sizeof(float),
                              "components of a view"),
                       Buffer(device, k * light_channels * sizeof(float), "weights of a view")};
      device.write(view.mean, means.subspan(v * light_channels, light_channels));
      if (k > 0) {
        Buffer rows(device, k * texels * sizeof(float), "components of a view");
        device.write(rows, images.subspan(offsets[v] * texels, k * texels));
        ops::pack_panels(device, ops::row_major(device, rows, texels), k, texels, view.A);
        std::vector<float> transposed(k * light_channels);
        for (std::size_t j = 0; j < k; ++j) {
          for (std::size_t r = 0; r < light_channels; ++r) {
            transposed[r * k + j] = model.basis[(offsets[v] + j) * light_channels + r];
          }
        }
        device.write(view.B, std::span<const float>(transposed));
        device.finish();
      }
      views_.push_back(std::move(view));
    }
    mean_rank_ = static_cast<double>(offsets.back()) / static_cast<double>(shape_.views);
  }

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    for (std::size_t image = first; image < first + count;) {
      const std::size_t light = image % shape_.lights;
      const std::size_t run = std::min(shape_.lights - light, first + count - image);
      const ViewFactors& view = views_[image / shape_.lights];
      ops::decode_pca(device_,
                      {light, run, shape_.texels(), shape_.channels, view.rank, image - first},
                      view.A, view.B, view.mean, out);
      image += run;
    }
  }

  double image_flops() const override {
    return 2.0 * static_cast<double>(shape_.image_values()) * mean_rank_;
  }

 private:
  Device& device_;
  BtfShape shape_;
  std::vector<ViewFactors> views_;
  double mean_rank_ = 0;
};

// The factors of all views behind each other, in rows for look-ups.
class ViewPcaDeviceSampler final : public DeviceSampler {
 public:
  ViewPcaDeviceSampler(Device& device, const ViewPcaModel& model)
      : device_(device), shape_(model.info.btf.shape) {
    const std::size_t texels = shape_.texels();
    const std::size_t light_channels = shape_.lights * shape_.channels;
    mean_ = Buffer(device, model.mean.size() * sizeof(float), "means");
    device.write(mean_, std::span<const float>(model.mean));
    const Rows rows = rows_of(model);
    std::vector<float> A(rows.A_floats, 0.0f), B(rows.B_floats, 0.0f);
    views_ = Buffer(device, rows.views.size() * sizeof(std::uint64_t), "factors of views");
    device.write(views_, std::span<const std::uint64_t>(rows.views));
    const std::vector<std::size_t> offsets = model.offsets();
    for (std::size_t v = 0; v < shape_.views; ++v) {
      const std::size_t k = offsets[v + 1] - offsets[v];
      largest_rank_ = std::max(largest_rank_, k);
      ops::pad_rows(
          texels, k,
          [&](std::size_t p, std::size_t j) { return model.images[(offsets[v] + j) * texels + p]; },
          std::span(A).subspan(rows.views[3 * v + 1] * ops::row_lanes));
      ops::pad_rows(
          light_channels, k,
          [&](std::size_t r, std::size_t j) {
            return model.basis[(offsets[v] + j) * light_channels + r];
          },
          std::span(B).subspan(rows.views[3 * v + 2] * ops::row_lanes));
    }
    A_ = Buffer(device, A.size() * sizeof(float), "components");
    B_ = Buffer(device, B.size() * sizeof(float), "weights of components");
    device.write(A_, std::span<const float>(A));
    device.write(B_, std::span<const float>(B));
  }

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    validate(lookup, shape_);
    ops::look_up_view_pca(device_, {lookup, shape_, count, lookups, out}, views_, A_, B_, mean_);
  }

  // One of `pca` for every view.
  double lookup_flops(const LookupShape& lookup) const override {
    return static_cast<double>(lookup.views) *
           ops::look_up_flops({lookup.texels, 1, lookup.lights}, shape_.channels, largest_rank_);
  }

  static std::size_t bytes(const ViewPcaModel& model) {
    const Rows rows = rows_of(model);
    // the factors on the host as well, while they are put in order
    return (model.mean.size() + 2 * (rows.A_floats + rows.B_floats)) * sizeof(float) +
           rows.views.size() * sizeof(std::uint64_t);
  }

 private:
  struct Rows {
    std::vector<std::uint64_t> views;  // as ops::look_up_view_pca takes them
    std::size_t A_floats = 0;
    std::size_t B_floats = 0;
  };

  static Rows rows_of(const ViewPcaModel& model) {
    const BtfShape& shape = model.info.btf.shape;
    Rows rows;
    std::size_t vectors = 0;  // of all views so far
    for (std::size_t v = 0; v < shape.views; ++v) {
      const std::size_t k8 = ops::row_vectors(model.ranks[v]);
      rows.views.insert(rows.views.end(),
                        {k8, vectors * shape.texels(), vectors * shape.lights * shape.channels});
      vectors += k8;
    }
    // a row of all views' vectors
    rows.A_floats = ops::row_floats(shape.texels(), 8 * vectors, "components");
    rows.B_floats = ops::row_floats(shape.lights * shape.channels, 8 * vectors, "weights");
    return rows;
  }

  Device& device_;
  BtfShape shape_;
  std::size_t largest_rank_ = 0;
  Buffer mean_;
  Buffer A_;
  Buffer B_;
  Buffer views_;
};

class ViewPcaReferenceDecoder final : public ReferenceDecoder {
 public:
  explicit ViewPcaReferenceDecoder(const ViewPcaModel& model) : model_(model) {}
  void decode(std::size_t first, std::size_t count, std::span<double> out) override {
    reference::decode_view_pca(model_, first, count, out);
  }

 private:
  const ViewPcaModel& model_;
};

constexpr std::size_t default_rank = 8;
constexpr std::size_t planned_rank = 64;

class ViewPcaCodec final : public Codec {
 public:
  std::string_view name() const override { return "view-pca"; }
  std::string_view summary() const override {
    return "principal components of the images of each view, mean removed";
  }
  bool removes_mean() const override { return true; }
  std::span<const ParameterSpec> parameters() const override {
    static const std::array<ParameterSpec, svd_parameters.size()> specs = [] {
      auto list = svd_parameters;
      list[0] = {"rank", "8", "number of components k per view; with a goal, the most"};
      return list;
    }();
    return specs;
  }

  bool takes_goals() const override { return true; }

  std::unique_ptr<Model> encode(Device& device, TileSource& source, const Parameters& parameters,
                                Storage storage, Job& job) const override {
    Fit made = fit(device, source, view_options(parameters), storage, job);
    round_to_storage(*made.model);
    return std::move(made.model);
  }

  std::unique_ptr<Model> encode_reference(TileSource& source, const Parameters& parameters,
                                          Storage storage, Job& job) const override {
    Fit made = fit_reference(source, view_options(parameters), storage, job);
    round_to_storage(*made.model);
    return std::move(made.model);
  }

  // With a goal, views take components as they are worth it: each is decomposed further than an
  // equal part of the error asks for.
  std::unique_ptr<NestedModels> nested(Device* device, TileSource& source,
                                       const Parameters& parameters, const NestedRequest& request,
                                       Job& job) const override {
    constexpr double share = 0.7;
    const BtfShape& shape = source.info().shape;
    const std::size_t light_channels = shape.lights * shape.channels;
    NestedRequest of_views = request;
    of_views.relative *= share;
    const SvdOptions options = nested_svd_options(*this, parameters, of_views,
                                                  shape.texels() + light_channels, shape.views);
    Fit made = device ? fit(*device, source, options, request.storage, job)
                      : fit_reference(source, options, request.storage, job);
    std::size_t least = made.model->ranks[0];
    for (std::size_t v = 0; v < shape.views; ++v) least = std::min(least, made.model->ranks[v]);
    return nested_components(
        std::move(made.model),
        {request.squares, made.residual_squares,
         rank_bound(options, parameters, least, std::min(shape.texels(), light_channels))});
  }

  std::unique_ptr<Model> fitted_part(const Model& model,
                                     const Selection& selection) const override {
    return as_view_pca(model).select(selection);
  }

  std::unique_ptr<DeviceDecoder> fitted_decoder(Device& device, const Model& model) const override {
    return std::make_unique<ViewPcaDeviceDecoder>(device, as_view_pca(model));
  }

  // The components in panels, padded by less than one, and one view's beside them while it is
  // packed.
  std::size_t fitted_decoder_bytes(const Model& model) const override {
    const ViewPcaModel& pca = as_view_pca(model);
    constexpr std::size_t widest_panel = 48;
    const std::size_t components = pca.offsets().back();
    std::size_t largest = 0;
    for (std::size_t v = 0; v < pca.ranks.size(); ++v) largest = std::max(largest, pca.ranks[v]);
    return (pca.mean.size() + pca.basis.size() + pca.images.size() + components * widest_panel +
            largest * model.info.btf.shape.texels()) *
           sizeof(float);
  }

  std::unique_ptr<ReferenceDecoder> fitted_reference_decoder(const Model& model) const override {
    return std::make_unique<ViewPcaReferenceDecoder>(as_view_pca(model));
  }

  std::unique_ptr<DeviceSampler> fitted_sampler(Device& device, const Model& model) const override {
    return std::make_unique<ViewPcaDeviceSampler>(device, as_view_pca(model));
  }

  std::size_t fitted_sampler_bytes(const Model& model) const override {
    return ViewPcaDeviceSampler::bytes(as_view_pca(model));
  }

  // A view's image is a sum of its components: their averages are those of the image.
  std::unique_ptr<Model> fitted_mip_level(const Model& model) const override {
    return as_view_pca(model).next_mip_level();
  }

  // As for `pca`, view by view: |error| <= gamma_{k+1} (|mean| + |A_p| |B_r|).
  double fitted_tolerance(const Model& model) const override {
    const ViewPcaModel& pca = as_view_pca(model);
    const BtfShape& shape = model.info.btf.shape;
    const std::size_t light_channels = shape.lights * shape.channels;
    const std::vector<std::size_t> offsets = pca.offsets();
    // The largest norm over a view's components, of texels or of rows.
    const auto largest_norm = [&](const std::vector<float>& factor, std::size_t width,
                                  std::size_t v) {
      double largest = 0;
      for (std::size_t i = 0; i < width; ++i) {
        double square = 0;
        for (std::size_t j = offsets[v]; j < offsets[v + 1]; ++j) {
          square += std::pow(double{factor[j * width + i]}, 2);
        }
        largest = std::max(largest, square);
      }
      return std::sqrt(largest);
    };
    double bound = 0;
    for (std::size_t v = 0; v < shape.views; ++v) {
      double mean = 0;
      for (std::size_t r = 0; r < light_channels; ++r) {
        mean = std::max(mean, std::abs(double{pca.mean[v * light_channels + r]}));
      }
      const double terms = static_cast<double>(offsets[v + 1] - offsets[v] + 1);
      const double size = mean + largest_norm(pca.images, shape.texels(), v) *
                                     largest_norm(pca.basis, light_channels, v);
      // Each operation on subnormal values may round by half a step of 2^-149 beside.
      bound = std::max(bound, terms * 0x1p-24 / (1 - terms * 0x1p-24) * size + terms * 0x1p-149);
    }
    return bound;
  }

  std::unique_ptr<Model> read(const ModelFile& file) const override {
    return ViewPcaModel::read(file);
  }

 private:
  struct Fit {
    std::unique_ptr<ViewPcaModel> model;  // unrounded
    double residual_squares = 0;          // |T - T'|^2
  };

  Fit fit(Device& device, TileSource& source, const SvdOptions& options, Storage storage,
          Job& job) const {
    const BtfShape& shape = source.info().shape;
    const std::size_t light_channels = shape.lights * shape.channels;
    // Where only a goal is given, so many per view are planned for, and no more are kept.
    const std::size_t planned =
        std::min({options.rank > 0 ? options.rank : planned_rank, shape.texels(), light_channels});
    Job view_job = job;  // one plan and one progress: those of the whole
    view_job.progress = {};
    view_job.held.push_back(
        {"model", shape.views * (planned * (shape.texels() + light_channels) + light_channels) *
                      sizeof(float)});
    // All views have one shape, and so one plan.
    ViewSource first_view(source, 0);
    view_job.plan(plan_truncated_svd(device, first_view, options, view_job));
    view_job.on_plan = {};

    // NaN is looked for in the whole, where it has its own view's number.
    scan_source(device, source, job);
    view_job.stages = job.stages;

    auto model = std::make_unique<ViewPcaModel>();
    model->images.reserve(shape.views * planned * shape.texels());
    model->basis.reserve(shape.views * planned * light_channels);
    std::vector<std::uint32_t> ranks;
    std::size_t passes = 0;
    double residual_squares = 0;
    std::size_t components = 0;
    std::map<SvdMethod, std::size_t> methods;  // views that each took
    std::map<SvdMethod, std::string> reasons;
    for (std::size_t v = 0; v < shape.views; ++v) {
      ViewSource view(source, v);
      const TruncatedSvd svd = truncated_svd(device, view, options, view_job);
      append(*model, svd, shape.texels());
      components += svd.rank;
      residual_squares += svd.residual * svd.residual;
      if (components > shape.views * planned) {
        fail(ErrorKind::unmet_goal,
             "the goal takes {} components up to view {}; without --rank, {} for all views are "
             "planned for",
             components, v, shape.views * planned);
      }
      ranks.push_back(static_cast<std::uint32_t>(svd.rank));
      passes = std::max(passes, svd.passes);
      ++methods[svd.method];
      reasons.emplace(svd.method, svd.reason);
      job.advance("views", v + 1, shape.views);
    }
    job.stages = std::move(view_job.stages);
    // Views may have taken different ways: the model names the one that most took.
    const auto most = std::max_element(
        methods.begin(), methods.end(),
        [](const auto& one, const auto& other) { return one.second < other.second; });
    const SvdMethod method = most->first;
    std::string reason = reasons[method];
    for (const auto& [other, views] : methods) {
      job.notes.push_back(fmt::format("svd {} of {} views, at most {} passes: {}", name_of(other),
                                      views, passes, reasons[other]));
      if (other != method) {
        reason += fmt::format("; {} views by {}: {}", views, name_of(other), reasons[other]);
      }
    }
    finish(*model, ranks, source.info(), options.has_goal() ? 0 : options.rank, storage,
           svd_parameters_json(options, method, passes, reason), job);
    return {std::move(model), residual_squares};
  }

  Fit fit_reference(TileSource& source, SvdOptions options, Storage storage, Job& job) const {
    reference::ViewPcaFit made =
        reference::encode_view_pca(source, reference_request(options), job);
    options.arithmetic = Arithmetic::f64;  // whatever the device is asked for
    std::vector<std::uint32_t> ranks;
    for (std::size_t v = 0; v < made.model->ranks.size(); ++v) {
      ranks.push_back(static_cast<std::uint32_t>(made.model->ranks[v]));
    }
    finish(*made.model, ranks, source.info(), options.has_goal() ? 0 : options.rank, storage,
           svd_parameters_json(options, made.method, made.passes, "the reference's way"), job);
    return {std::move(made.model), made.residual_squares};
  }

  SvdOptions view_options(Parameters parameters) const {
    const bool has_goal = parameters.contains("tolerance") || parameters.contains("energy");
    if (!has_goal && !parameters.contains("rank")) {
      parameters["rank"] = std::to_string(default_rank);
    }
    return svd_options(*this, parameters);
  }

  // A view's factors behind those of the views before it.
  static void append(ViewPcaModel& model, const TruncatedSvd& svd, std::size_t texels) {
    model.mean.insert(model.mean.end(), svd.mean.begin(), svd.mean.end());
    for (std::size_t j = 0; j < svd.rank; ++j) {
      for (std::size_t p = 0; p < texels; ++p) model.images.push_back(svd.left[p * svd.rank + j]);
      for (std::size_t r = 0; r < svd.mean.size(); ++r) {
        model.basis.push_back(svd.right[r * svd.rank + j]);
      }
    }
  }

  // `rank` 0 where a goal decided. `parameters`: members of a JSON object.
  void finish(ViewPcaModel& model, const std::vector<std::uint32_t>& ranks, const BtfInfo& info,
              std::size_t rank, Storage storage, const std::string& parameters, Job& job) const {
    const auto [least, most] = std::minmax_element(ranks.begin(), ranks.end());
    model.ranks = IndexTensor(ranks, *most + std::size_t{1});
    if (rank > 0 && *least < rank) {
      job.notes.push_back(fmt::format(
          "rank {} asked, {} to {} kept per view: the data holds no more", rank, *least, *most));
    }
    model.info.codec = name();
    model.info.parameters = fmt::format(R"({{{},"kept":[{},{}]}})", parameters, *least, *most);
    model.info.storage = storage;
    model.info.btf = info;
  }
};

}  // namespace

const Codec& view_pca_codec() {
  static const ViewPcaCodec codec;
  return codec;
}

}  // namespace weft
