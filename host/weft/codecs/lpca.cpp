#include "weft/codecs/lpca.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "weft/codecs/fit_lpca.hpp"
#include "weft/codecs/nested_components.hpp"
#include "weft/error.hpp"
#include "weft/model/storage.hpp"
#include "weft/ops/decode_lpca.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/look_up_factors.hpp"
#include "weft/reference/lpca.hpp"
#include "weft/reference/weigh_clusters.hpp"

namespace weft {
namespace {

const LpcaModel& as_lpca(const Model& model) {
  return dynamic_cast<const LpcaModel&>(model);
}

class LpcaDeviceDecoder final : public DeviceDecoder {
 public:
  LpcaDeviceDecoder(Device& device, const LpcaModel& model)
      : device_(device), shape_(model.info.btf.shape), rank_(model.rank) {
    const std::size_t n = shape_.images() * shape_.channels;
    const std::size_t clusters = model.ranks.size();
    const std::size_t width = ops::panel_width(device);
    std::vector<std::uint32_t> labels(shape_.texels());
    for (std::size_t p = 0; p < labels.size(); ++p) {
      labels[p] = static_cast<std::uint32_t>(model.clusters[p]);
    }
    const ops::ClusterPanels panels = ops::cluster_panels(labels, clusters, width);
    panels_ = panels.count();
    slots_ = Buffer(device, panels.slots.size() * sizeof(std::uint32_t), "slots of texels");
    table_ = Buffer(device, panels.panels.size() * sizeof(std::uint32_t), "panels");
    device.write(slots_, std::span<const std::uint32_t>(panels.slots));
    device.write(table_, std::span<const std::uint32_t>(panels.panels));
    mean_ = Buffer(device, model.mean.size() * sizeof(float), "means");
    device.write(mean_, std::span<const float>(model.mean));

    // A by panels of texels of one cluster
    std::vector<float> A(panels_ * rank_ * width, 0.0f);
    for (std::size_t panel = 0; panel < panels_; ++panel) {
      for (std::size_t slot = 0; slot < panels.panels[2 * panel + 1]; ++slot) {
        const std::size_t p = panels.order[panel * width + slot];
        for (std::size_t j = 0; j < rank_; ++j) {
          A[(panel * rank_ + j) * width + slot] = model.coefficients[p * rank_ + j];
        }
      }
    }
    A_ = Buffer(device, A.size() * sizeof(float), "coefficients");
    if (rank_ > 0) device.write(A_, std::span<const float>(A));

    // B with the k coefficients of an image's channel side by side, zero past a cluster's rank
    B_ = Buffer(device, clusters * n * rank_ * sizeof(float), "bases");
    const std::vector<std::size_t> offsets = model.offsets();
    std::vector<float> rows(n * rank_);
    for (std::size_t g = 0; g < clusters && rank_ > 0; ++g) {
      std::fill(rows.begin(), rows.end(), 0.0f);
      for (std::size_t i = offsets[g]; i < offsets[g + 1]; ++i) {
        for (std::size_t r = 0; r < n; ++r) {
          rows[r * rank_ + i - offsets[g]] = model.basis[i * n + r];
        }
      }
      device.write(B_, std::span<const float>(rows), g * rows.size());
    }
    // Its end is read beside the last texel, though not used.
    sorted_ = Buffer(device, ops::decode_lpca_bytes(device, shape(0, 0)), "sorted texels");
    device.fill_zero(sorted_, 0, sorted_.size());
  }

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    ops::decode_lpca(device_, shape(first, count), table_, slots_, A_, B_, mean_, sorted_, out);
  }

  double image_flops() const override {
    return 2.0 * static_cast<double>(shape_.image_values()) * static_cast<double>(rank_);
  }

 private:
  ops::DecodeLpcaShape shape(std::size_t first, std::size_t count) const {
    return {shape_.images(), first, count, shape_.texels(), shape_.channels, rank_, panels_};
  }

  Device& device_;
  BtfShape shape_;
  std::size_t rank_;
  std::size_t panels_ = 0;
  Buffer table_;
  Buffer slots_;
  Buffer sorted_;
  Buffer mean_;
  Buffer A_;
  Buffer B_;
};

class LpcaDeviceSampler final : public DeviceSampler {
 public:
  LpcaDeviceSampler(Device& device, const LpcaModel& model)
      : device_(device), shape_(model.info.btf.shape), rank_(model.rank) {
    const std::size_t n = shape_.images() * shape_.channels;
    const std::size_t count = model.ranks.size();
    std::vector<std::uint32_t> clusters(shape_.texels());
    for (std::size_t p = 0; p < clusters.size(); ++p) {
      clusters[p] = static_cast<std::uint32_t>(model.clusters[p]);
    }
    clusters_ = Buffer(device, clusters.size() * sizeof(std::uint32_t), "clusters");
    device.write(clusters_, std::span<const std::uint32_t>(clusters));
    mean_ = Buffer(device, model.mean.size() * sizeof(float), "means");
    device.write(mean_, std::span<const float>(model.mean));
    A_ = Buffer(device, ops::row_floats(shape_.texels(), rank_, "coefficients") * sizeof(float),
                "coefficients");
    ops::write_rows(
        device, shape_.texels(), rank_,
        [&](std::size_t p, std::size_t j) { return model.coefficients[p * rank_ + j]; }, A_);
    B_ = Buffer(device, ops::row_floats(count * n, rank_, "bases") * sizeof(float), "bases");
    const std::vector<std::size_t> offsets = model.offsets();
    ops::write_rows(
        device, count * n, rank_,
        [&](std::size_t row, std::size_t j) {
          const std::size_t g = row / n;  // zero past a cluster's rank
          return offsets[g] + j < offsets[g + 1] ? model.basis[(offsets[g] + j) * n + row % n]
                                                 : 0.0f;
        },
        B_);
  }

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    validate(lookup, shape_);
    ops::look_up_lpca(device_, {lookup, shape_, count, lookups, out}, rank_, clusters_, A_, B_,
                      mean_);
  }

  // As of `pca` where the texels are of one cluster, which neighbours most often are.
  double lookup_flops(const LookupShape& lookup) const override {
    return ops::look_up_flops(lookup, shape_.channels, rank_);
  }

  static std::size_t bytes(const LpcaModel& model) {
    const BtfShape& shape = model.info.btf.shape;
    return (shape.texels() + model.mean.size() +
            ops::row_floats(shape.texels(), model.rank, "coefficients") +
            ops::row_floats(model.mean.size(), model.rank, "bases")) *
           sizeof(float);
  }

 private:
  Device& device_;
  BtfShape shape_;
  std::size_t rank_;
  Buffer clusters_;
  Buffer mean_;
  Buffer A_;
  Buffer B_;
};

class LpcaReferenceDecoder final : public ReferenceDecoder {
 public:
  explicit LpcaReferenceDecoder(const LpcaModel& model) : model_(model) {}
  void decode(std::size_t first, std::size_t count, std::span<double> out) override {
    reference::decode_lpca(model_, first, count, out);
  }

 private:
  const LpcaModel& model_;
};

class LpcaCodec final : public Codec {
 public:
  std::string_view name() const override { return "lpca"; }
  std::string_view summary() const override {
    return "clusters of texels, each with its mean and principal components";
  }
  bool removes_mean() const override { return true; }
  std::span<const ParameterSpec> parameters() const override {
    static constexpr std::array<ParameterSpec, 3> specs{
        {{"rank", "8", "number of components k per cluster"},
         {"clusters", "32", "number of clusters"},
         {"iterations", "10", "most rounds of assignment on the data"}}};
    return specs;
  }

  bool takes_goals() const override { return true; }

  std::unique_ptr<Model> encode(Device& device, TileSource& source, const Parameters& parameters,
                                Storage storage, Job& job) const override {
    std::unique_ptr<LpcaModel> model =
        fit(&device, source, lpca_options(parameters), storage, job).model;
    round_to_storage(*model);
    return model;
  }

  std::unique_ptr<Model> encode_reference(TileSource& source, const Parameters& parameters,
                                          Storage storage, Job& job) const override {
    std::unique_ptr<LpcaModel> model =
        fit(nullptr, source, lpca_options(parameters), storage, job).model;
    round_to_storage(*model);
    return model;
  }

  // The clusters stay, their components are chosen. Where their number is not given, it is that of
  // bases that balance the coefficients, and leaves a size room for some components of each.
  std::unique_ptr<NestedModels> nested(Device* device, TileSource& source,
                                       const Parameters& parameters, const NestedRequest& request,
                                       Job& job) const override {
    const BtfShape& shape = source.info().shape;
    const std::size_t n = shape.images() * shape.channels;
    LpcaOptions options = lpca_options(parameters);
    if (!parameters.contains("clusters")) {
      // so many that bases take about the room of the coefficients
      options.clusters = std::clamp<std::size_t>(shape.texels() / n + 1, 2, options.clusters);
      if (request.values > 0) {
        constexpr std::size_t parts = 5;  // the mean, and so many components less one
        options.clusters =
            std::clamp<std::size_t>(request.values / (parts * n), 1, options.clusters);
      }
    }
    const bool bounded = parameters.contains("rank");
    if (!bounded && request.values > 0) {
      const double means = static_cast<double>(options.clusters * n);
      const double of_rank = static_cast<double>(options.clusters * n + shape.texels());
      const double ranks = (static_cast<double>(request.values) - means) / of_rank;
      // clusters of more components than others take them from those of fewer
      options.rank = 2 + static_cast<std::size_t>(1.5 * std::max(ranks, 0.0));
    }
    const std::size_t most = std::min(shape.texels(), n);
    if (!bounded) {
      const double grown = static_cast<double>(options.rank) * request.growth;
      options.rank = request.spectra && request.wanted > 0
                         ? foreseen_rank(request.spectra->front(), request)
                         : static_cast<std::size_t>(grown);
      options.rank = std::min(options.rank, most);
    }
    Fit made = fit(device, source, options, request.storage, job);
    const std::size_t kept = made.model->rank;
    std::string bound;
    if (kept < options.rank || kept == most) bound = "no cluster holds more components";
    if (bounded && kept == options.rank) bound = fmt::format("--rank {}", options.rank);
    return nested_components(std::move(made.model),
                             {request.squares, made.error * made.error * request.squares, bound});
  }

  std::unique_ptr<Model> fitted_part(const Model& model,
                                     const Selection& selection) const override {
    return as_lpca(model).select(selection);
  }

  std::unique_ptr<DeviceDecoder> fitted_decoder(Device& device, const Model& model) const override {
    return std::make_unique<LpcaDeviceDecoder>(device, as_lpca(model));
  }

  // Factors and lists on the device, the padded coefficients and one basis also made ready on the
  // host.
  std::size_t fitted_decoder_bytes(const Model& model) const override {
    const LpcaModel& lpca = as_lpca(model);
    constexpr std::size_t widest_panel = 48;
    const BtfShape& shape = model.info.btf.shape;
    const std::size_t clusters = lpca.ranks.size();
    const std::size_t n = shape.images() * shape.channels;
    const std::size_t slots =
        widest_panel * ops::most_cluster_panels(shape.texels(), clusters, widest_panel);
    const std::size_t image = slots * shape.channels * sizeof(float);
    const std::size_t sorted =
        std::min(std::max(ops::decode_lpca_cached_bytes, image), shape.images() * image) + 16;
    return (lpca.mean.size() + (clusters + 1) * n * lpca.rank) * sizeof(float) + sorted +
           2 * slots * (lpca.rank * sizeof(float) + 2 * sizeof(std::uint32_t));
  }

  std::unique_ptr<ReferenceDecoder> fitted_reference_decoder(const Model& model) const override {
    return std::make_unique<LpcaReferenceDecoder>(as_lpca(model));
  }

  std::unique_ptr<DeviceSampler> fitted_sampler(Device& device, const Model& model) const override {
    return std::make_unique<LpcaDeviceSampler>(device, as_lpca(model));
  }

  std::size_t fitted_sampler_bytes(const Model& model) const override {
    return LpcaDeviceSampler::bytes(as_lpca(model));
  }

  // As for `pca`, cluster by cluster: |error| <= gamma_{k+1} (|mean| + |A_p| |B_r|).
  double fitted_tolerance(const Model& model) const override {
    const LpcaModel& lpca = as_lpca(model);
    const std::size_t clusters = lpca.ranks.size();
    const std::size_t n = lpca.mean.size() / clusters;
    const std::vector<std::size_t> offsets = lpca.offsets();
    std::vector<double> rows(clusters, 0.0);
    for (std::size_t p = 0; p < lpca.clusters.size(); ++p) {
      double square = 0;
      for (std::size_t j = 0; j < lpca.rank; ++j) {
        square += std::pow(double{lpca.coefficients[p * lpca.rank + j]}, 2);
      }
      double& largest = rows[lpca.clusters[p]];
      largest = std::max(largest, std::sqrt(square));
    }
    double size = 0;
    for (std::size_t g = 0; g < clusters; ++g) {
      double largest_mean = 0;
      double largest_column = 0;
      for (std::size_t r = 0; r < n; ++r) {
        largest_mean = std::max(largest_mean, std::abs(double{lpca.mean[g * n + r]}));
        double square = 0;
        for (std::size_t i = offsets[g]; i < offsets[g + 1]; ++i) {
          square += std::pow(double{lpca.basis[i * n + r]}, 2);
        }
        largest_column = std::max(largest_column, std::sqrt(square));
      }
      size = std::max(size, largest_mean + rows[g] * largest_column);
    }
    const double terms = static_cast<double>(lpca.rank + 1);
    // Each operation on subnormal values may round by half a step of 2^-149 beside.
    return terms * 0x1p-24 / (1 - terms * 0x1p-24) * size + terms * 0x1p-149;
  }

  std::unique_ptr<Model> read(const ModelFile& file) const override {
    return LpcaModel::read(file);
  }

 private:
  // The rank at which clusters come to the wanted error, from what smaller ranks leave: about a
  // power of the rank, which the upper half of them tells. At least half as many again.
  static std::size_t foreseen_rank(const std::vector<double>& left, const NestedRequest& request) {
    const std::size_t rank = left.size() - 1;
    const std::size_t half_rank = rank / 2;
    const double half = left[half_rank];
    const double whole = left[rank];
    const double wanted = request.wanted * request.wanted * request.squares;
    constexpr double most_growth = 16;
    double growth = 2;
    if (rank >= 2 && half > whole && whole > wanted && wanted > 0) {
      const double power = std::log(half / whole) /
                           std::log(static_cast<double>(rank) / static_cast<double>(half_rank));
      constexpr double spare = 1.1;
      growth = spare * std::pow(whole / wanted, 1 / power);
    }
    growth = std::clamp(growth, 1.5, most_growth);
    return static_cast<std::size_t>(
        std::ceil(static_cast<double>(std::max<std::size_t>(rank, 1)) * growth));
  }

  struct Fit {
    std::unique_ptr<LpcaModel> model;  // unrounded
    double error = 0;                  // relative; 0 where it is too small to be resolved
  };

  Fit fit(Device* device, TileSource& source, const LpcaOptions& options, Storage storage,
          Job& job) const {
    std::unique_ptr<LpcaModel> model;
    std::vector<double> errors;
    LpcaOptions fitted = options;
    fitted.rank += extra_rank(source);
    if (device) {
      job.plan(plan_lpca(*device, source, fitted));
      LpcaFit made = fit_lpca(*device, source, fitted, job);
      job.notes.push_back(fmt::format("clustered in {} global components ({}), {} iterations there",
                                      made.reduced_rank, made.svd, made.reduced_errors.size()));
      model = std::move(made.model);
      errors = std::move(made.errors);
    } else {
      reference::LpcaFit made =
          reference::encode_lpca(source, {fitted.clusters, fitted.rank, fitted.iterations}, job);
      model = std::move(made.model);
      errors = std::move(made.errors);
    }
    if (!source.texel_scale().empty()) {
      reference::weigh_clusters(*model, source.texel_scale(), options.rank);
    }
    note_errors(errors, job);
    describe(*model, source.info(), options, storage, job);
    return {std::move(model), errors.empty() ? 0.0 : errors.back()};
  }

  LpcaOptions lpca_options(const Parameters& parameters) const {
    LpcaOptions options;
    options.rank = count_parameter(*this, parameters, "rank", 1);
    options.clusters = count_parameter(*this, parameters, "clusters", 1);
    options.iterations = count_parameter(*this, parameters, "iterations", 0);
    return options;
  }

  static void note_errors(const std::vector<double>& errors, Job& job) {
    std::vector<std::string> texts;
    for (const double error : errors) {
      texts.push_back(error > 0 ? fmt::format("{:.4g}", error) : std::string("below 1e-3"));
    }
    job.notes.push_back(
        fmt::format("relative error of each fit to the data: {}", fmt::join(texts, ", ")));
  }

  // Where texels have weights, a component more is fitted in place of the clusters' means.
  static std::size_t extra_rank(const TileSource& source) {
    return source.texel_scale().empty() ? 0 : 1;
  }

  void describe(LpcaModel& model, const BtfInfo& info, const LpcaOptions& options, Storage storage,
                Job& job) const {
    const std::size_t kept = model.ranks.size();
    if (kept < options.clusters) {
      job.notes.push_back(fmt::format("{} clusters asked, {} kept: the data has no use for more",
                                      options.clusters, kept));
    }
    if (model.rank < options.rank) {
      job.notes.push_back(
          fmt::format("rank {} asked, {} kept: no cluster holds more", options.rank, model.rank));
    }
    model.info.codec = name();
    model.info.parameters = fmt::format(
        R"({{"clusters":{},"rank":{},"iterations":{},"seed":{},"kept_clusters":{},"kept_rank":{}}})",
        options.clusters, options.rank, options.iterations, job.seed, kept, model.rank);
    model.info.storage = storage;
    model.info.btf = info;
  }
};

}  // namespace

const Codec& lpca_codec() {
  static const LpcaCodec codec;
  return codec;
}

}  // namespace weft
