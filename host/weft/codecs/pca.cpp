#include "weft/codecs/pca.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "weft/codecs/nested_components.hpp"
#include "weft/codecs/truncated_svd.hpp"
#include "weft/error.hpp"
#include "weft/model/pca.hpp"
#include "weft/model/storage.hpp"
#include "weft/ops/decode_pca.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/look_up_factors.hpp"
#include "weft/reference/pca.hpp"

namespace weft {
namespace {

const PcaModel& as_pca(const Model& model) {
  return dynamic_cast<const PcaModel&>(model);
}

class PcaDeviceDecoder final : public DeviceDecoder {
 public:
  PcaDeviceDecoder(Device& device, const PcaModel& model)
      : device_(device),
        shape_(model.info.btf.shape),
        rank_(model.rank),
        mean_(device, model.mean.size() * sizeof(float), "mean"),
        A_(device, ops::packed_elements(device, rank_, shape_.texels()) * sizeof(float),
           "coefficients"),
        B_(device, model.basis.size() * sizeof(float), "basis") {
    device.write(mean_, std::span<const float>(model.mean));
    if (rank_ == 0) return;
    // A by panels of texels
    Buffer rows(device, model.coefficients.size() * sizeof(float), "coefficients");
    device.write(rows, std::span<const float>(model.coefficients));
    ops::pack_panels(device, ops::transposed(device, rows, rank_), rank_, shape_.texels(), A_);
    device.finish();
    // B with the k coefficients of an image's channel side by side
    const std::size_t n = model.mean.size();
    std::vector<float> transposed(model.basis.size());
    for (std::size_t j = 0; j < rank_; ++j) {
      for (std::size_t r = 0; r < n; ++r) transposed[r * rank_ + j] = model.basis[j * n + r];
    }
    device.write(B_, std::span<const float>(transposed));
  }

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    ops::decode_pca(device_, {first, count, shape_.texels(), shape_.channels, rank_}, A_, B_, mean_,
                    out);
  }

  double image_flops() const override {
    return 2.0 * static_cast<double>(shape_.image_values()) * static_cast<double>(rank_);
  }

 private:
  Device& device_;
  BtfShape shape_;
  std::size_t rank_;
  Buffer mean_;
  Buffer A_;
  Buffer B_;
};

class PcaDeviceSampler final : public DeviceSampler {
 public:
  PcaDeviceSampler(Device& device, const PcaModel& model)
      : device_(device),
        shape_(model.info.btf.shape),
        rank_(model.rank),
        mean_(device, model.mean.size() * sizeof(float), "mean"),
        A_(device, ops::row_floats(shape_.texels(), rank_, "coefficients") * sizeof(float),
           "coefficients"),
        B_(device, ops::row_floats(model.mean.size(), rank_, "basis") * sizeof(float), "basis") {
    device.write(mean_, std::span<const float>(model.mean));
    ops::write_rows(
        device, shape_.texels(), rank_,
        [&](std::size_t p, std::size_t j) { return model.coefficients[p * rank_ + j]; }, A_);
    const std::size_t n = model.mean.size();
    ops::write_rows(
        device, n, rank_, [&](std::size_t r, std::size_t j) { return model.basis[j * n + r]; }, B_);
  }

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    validate(lookup, shape_);
    ops::look_up_pca(device_, {lookup, shape_, count, lookups, out}, rank_, A_, B_, mean_);
  }

  double lookup_flops(const LookupShape& lookup) const override {
    return ops::look_up_flops(lookup, shape_.channels, rank_);
  }

 private:
  Device& device_;
  BtfShape shape_;
  std::size_t rank_;
  Buffer mean_;
  Buffer A_;
  Buffer B_;
};

class PcaReferenceDecoder final : public ReferenceDecoder {
 public:
  explicit PcaReferenceDecoder(const PcaModel& model) : model_(model) {}
  void decode(std::size_t first, std::size_t count, std::span<double> out) override {
    reference::decode_pca(model_, first, count, out);
  }

 private:
  const PcaModel& model_;
};

class PcaCodec final : public Codec {
 public:
  std::string_view name() const override { return "pca"; }
  std::string_view summary() const override {
    return "principal components of the texels' ABRDFs, mean removed";
  }
  bool removes_mean() const override { return true; }
  std::span<const ParameterSpec> parameters() const override { return svd_parameters; }

  bool takes_goals() const override { return true; }

  std::unique_ptr<Model> encode(Device& device, TileSource& source, const Parameters& parameters,
                                Storage storage, Job& job) const override {
    const SvdOptions options = svd_options(*this, parameters);
    std::unique_ptr<PcaModel> model = fit(device, source, options, storage, job).model;
    round_to_storage(*model);
    return model;
  }

  std::unique_ptr<Model> encode_reference(TileSource& source, const Parameters& parameters,
                                          Storage storage, Job& job) const override {
    const SvdOptions options = svd_options(*this, parameters);
    std::unique_ptr<PcaModel> model = fit_reference(source, options, storage, job).model;
    round_to_storage(*model);
    return model;
  }

  std::unique_ptr<NestedModels> nested(Device* device, TileSource& source,
                                       const Parameters& parameters, const NestedRequest& request,
                                       Job& job) const override {
    const BtfShape& shape = source.info().shape;
    const std::size_t n = shape.images() * shape.channels;
    const SvdOptions options =
        nested_svd_options(*this, parameters, request, shape.texels() + n, 1);
    Fit whole = device ? fit(*device, source, options, request.storage, job)
                       : fit_reference(source, options, request.storage, job);
    const std::size_t rank = whole.model->rank;
    return nested_components(std::move(whole.model),
                             {request.squares, whole.residual * whole.residual,
                              rank_bound(options, parameters, rank, std::min(shape.texels(), n))});
  }

  std::unique_ptr<Model> fitted_part(const Model& model,
                                     const Selection& selection) const override {
    return as_pca(model).select(selection);
  }

  std::unique_ptr<DeviceDecoder> fitted_decoder(Device& device, const Model& model) const override {
    return std::make_unique<PcaDeviceDecoder>(device, as_pca(model));
  }

  std::size_t fitted_decoder_bytes(const Model& model) const override {
    const PcaModel& pca = as_pca(model);
    return (pca.mean.size() + pca.basis.size() + 2 * pca.coefficients.size()) * sizeof(float);
  }

  std::unique_ptr<ReferenceDecoder> fitted_reference_decoder(const Model& model) const override {
    return std::make_unique<PcaReferenceDecoder>(as_pca(model));
  }

  std::unique_ptr<DeviceSampler> fitted_sampler(Device& device, const Model& model) const override {
    return std::make_unique<PcaDeviceSampler>(device, as_pca(model));
  }

  std::size_t fitted_sampler_bytes(const Model& model) const override {
    const PcaModel& pca = as_pca(model);
    const std::size_t n = pca.mean.size();
    return (n + ops::row_floats(n, pca.rank, "basis") +
            ops::row_floats(model.info.btf.shape.texels(), pca.rank, "coefficients")) *
           sizeof(float);
  }

  // A texel's coefficients are linear in its values: their averages are those of the values.
  std::unique_ptr<Model> fitted_mip_level(const Model& model) const override {
    return as_pca(model).next_mip_level();
  }

  // k products and the mean, summed in float: |error| <= gamma_{k+1} (|mean| + |A_p| |B_r|) for any
  // order of the sum, by Cauchy-Schwarz over the components.
  double fitted_tolerance(const Model& model) const override {
    const PcaModel& pca = as_pca(model);
    const std::size_t n = pca.mean.size();
    double largest_mean = 0;
    for (const float value : pca.mean)
      largest_mean = std::max(largest_mean, std::abs(double{value}));
    double largest_row = 0;
    for (std::size_t p = 0; p * pca.rank < pca.coefficients.size(); ++p) {
      double square = 0;
      for (std::size_t j = 0; j < pca.rank; ++j) {
        square += std::pow(double{pca.coefficients[p * pca.rank + j]}, 2);
      }
      largest_row = std::max(largest_row, std::sqrt(square));
    }
    double largest_column = 0;
    for (std::size_t r = 0; r < n; ++r) {
      double square = 0;
      for (std::size_t j = 0; j < pca.rank; ++j)
        square += std::pow(double{pca.basis[j * n + r]}, 2);
      largest_column = std::max(largest_column, std::sqrt(square));
    }
    const double terms = static_cast<double>(pca.rank + 1);
    const double unit = 0x1p-24;
    // Each operation on subnormal values may round by half a step of 2^-149 beside.
    return terms * unit / (1 - terms * unit) * (largest_mean + largest_row * largest_column) +
           terms * 0x1p-149;
  }

  std::unique_ptr<Model> read(const ModelFile& file) const override { return PcaModel::read(file); }

 private:
  struct Fit {
    std::unique_ptr<PcaModel> model;  // unrounded
    double residual = 0;              // |T - T'|
  };

  Fit fit(Device& device, TileSource& source, const SvdOptions& options, Storage storage,
          Job& job) const {
    job.plan(plan_truncated_svd(device, source, options, job));
    TruncatedSvd svd = truncated_svd(device, source, options, job);
    auto model = std::make_unique<PcaModel>();
    model->rank = svd.rank;
    model->mean = std::move(svd.mean);
    model->coefficients = std::move(svd.left);
    // right is [n, k]
    const std::size_t n = model->mean.size();
    model->basis.resize(svd.right.size());
    for (std::size_t r = 0; r < n; ++r) {
      for (std::size_t j = 0; j < svd.rank; ++j) {
        model->basis[j * n + r] = svd.right[r * svd.rank + j];
      }
    }
    describe(*model, source.info(), storage,
             svd_parameters_json(options, svd.method, svd.passes, svd.reason));
    if (!options.has_goal() && svd.rank < options.rank) {
      job.notes.push_back(
          fmt::format("rank {} asked, {} kept: the data holds no more", options.rank, svd.rank));
    }
    job.notes.push_back(fmt::format("svd {}, {} passes over the data, rank {}: {}",
                                    name_of(svd.method), svd.passes, svd.rank, svd.reason));
    return {std::move(model), svd.residual};
  }

  Fit fit_reference(TileSource& source, SvdOptions options, Storage storage, Job& job) const {
    reference::PcaFit made = reference::encode_pca(source, reference_request(options), job);
    options.arithmetic = Arithmetic::f64;  // whatever the device is asked for
    describe(*made.model, source.info(), storage,
             svd_parameters_json(options, made.method, made.passes, "the reference's way"));
    return {std::move(made.model), made.residual};
  }

  // `svd`: members of a JSON object
  void describe(PcaModel& model, const BtfInfo& info, Storage storage,
                const std::string& svd) const {
    model.info.codec = name();
    model.info.parameters = fmt::format(R"({{{},"kept":{}}})", svd, model.rank);
    model.info.storage = storage;
    model.info.btf = info;
  }
};

}  // namespace

const Codec& pca_codec() {
  static const PcaCodec codec;
  return codec;
}

}  // namespace weft
