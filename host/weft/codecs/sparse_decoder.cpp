#include "weft/codecs/sparse_decoder.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "weft/device/tile_stream.hpp"
#include "weft/ops/decode_sparse.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/look_up_sparse.hpp"
#include "weft/reference/sparse.hpp"

namespace weft {
namespace {

std::vector<std::uint32_t> indices_of(const IndexTensor& tensor) {
  std::vector<std::uint32_t> indices(tensor.size());
  for (std::size_t i = 0; i < indices.size(); ++i) {
    indices[i] = static_cast<std::uint32_t>(tensor[i]);
  }
  return indices;
}

template <typename T>
Buffer upload(Device& device, const std::vector<T>& values, const char* what) {
  if (values.empty()) return {};
  Buffer buffer(device, values.size() * sizeof(T), what);
  device.write(buffer, std::span<const T>(values));
  return buffer;
}

std::size_t term_bytes(const SparseLists& lists) {
  return lists.coefficients.size() * (sizeof(std::uint32_t) + sizeof(float));
}

ops::DecodeSparseShape decode_shape(const SparseModel& model, std::size_t first,
                                    std::size_t count) {
  const BtfShape& shape = model.info.btf.shape;
  return {first,
          count,
          shape.views,
          shape.lights,
          shape.texels(),
          shape.channels,
          model.light_atoms,
          model.abrdf_atoms,
          model.views.length,
          model.texels.length};
}

class SparseDeviceDecoder final : public DeviceDecoder {
 public:
  SparseDeviceDecoder(Device& device, const SparseModel& model)
      : device_(device), width_(ops::vector_width(device)), shape_(decode_shape(model, 0, 0)) {
    view_atoms_ = upload(device, indices_of(model.views.atoms), "atoms of views");
    view_coefficients_ = upload(device, model.views.coefficients, "coefficients of views");
    texel_atoms_ = upload(device, indices_of(model.texels.atoms), "atoms of texels");
    texel_coefficients_ = upload(device, model.texels.coefficients, "coefficients of texels");
    dictionary_ =
        upload(device, ops::sparse_dictionary(width_, shape_, model.dictionary), "dictionary");
    mean_ = upload(device, ops::sparse_mean(width_, shape_, model.mean), "mean");
  }

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    shape_.first_image = first;
    shape_.images = count;
    const std::size_t bytes = ops::sparse_abrdf_floats(width_, shape_) * sizeof(float);
    if (abrdfs_.size() < bytes) {
      device_.finish();
      abrdfs_ = Buffer();
      abrdfs_ = Buffer(device_, bytes, "ABRDFs of some images");
    }
    ops::decode_sparse(device_, shape_, {view_atoms_, view_coefficients_},
                       {texel_atoms_, texel_coefficients_}, dictionary_, mean_, abrdfs_, out);
  }

  double image_flops() const override {
    return 2.0 * static_cast<double>(shape_.channels) *
           static_cast<double>(shape_.texels * shape_.texel_terms +
                               shape_.abrdf_atoms * shape_.view_terms);
  }

 private:
  Device& device_;
  std::size_t width_;
  ops::DecodeSparseShape shape_;
  Buffer view_atoms_;
  Buffer view_coefficients_;
  Buffer texel_atoms_;
  Buffer texel_coefficients_;
  Buffer dictionary_;
  Buffer mean_;
  Buffer abrdfs_;
};

class SparseDeviceSampler final : public DeviceSampler {
 public:
  SparseDeviceSampler(Device& device, const SparseModel& model)
      : device_(device),
        shape_(model.info.btf.shape),
        lengths_{model.light_atoms, model.views.length, model.texels.length} {
    view_rows_ = upload(device,
                        ops::lookup_rows(indices_of(model.views.atoms), model.views.coefficients,
                                         lengths_.view_terms),
                        "lists of views");
    texel_atoms_ =
        upload(device, ops::end_lists(indices_of(model.texels.atoms), lengths_.texel_terms),
               "atoms of texels");
    texel_coefficients_ =
        upload(device, ops::end_lists(model.texels.coefficients, lengths_.texel_terms),
               "coefficients of texels");
    dictionary_ = upload(
        device,
        ops::lookup_dictionary(model.light_atoms, shape_.lights, shape_.channels, model.dictionary),
        "dictionary");
    mean_ = upload(device, model.mean, "mean");
  }

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    validate(lookup, shape_);
    ops::look_up_sparse(device_, {lookup, shape_, count, lookups, out}, lengths_, view_rows_,
                        {texel_atoms_, texel_coefficients_}, dictionary_, mean_);
  }

  double lookup_flops(const LookupShape& lookup) const override {
    return ops::look_up_sparse_flops(lookup, shape_.channels, lengths_);
  }

 private:
  Device& device_;
  BtfShape shape_;
  ops::SparseLengths lengths_;
  Buffer view_rows_;
  Buffer texel_atoms_;
  Buffer texel_coefficients_;
  Buffer dictionary_;
  Buffer mean_;
};

class SparseReferenceDecoder final : public ReferenceDecoder {
 public:
  explicit SparseReferenceDecoder(const SparseModel& model) : model_(model) {}
  void decode(std::size_t first, std::size_t count, std::span<double> out) override {
    reference::decode_sparse(model_, first, count, out);
  }

 private:
  const SparseModel& model_;
};

}  // namespace

std::unique_ptr<DeviceDecoder> sparse_decoder(Device& device, const SparseModel& model) {
  return std::make_unique<SparseDeviceDecoder>(device, model);
}

std::size_t sparse_decoder_bytes(const SparseModel& model) {
  constexpr std::size_t width = ops::most_sparse_lanes;
  const BtfShape& shape = model.info.btf.shape;
  const ops::DecodeSparseShape run = decode_shape(model, 0, image_granule(shape));
  return term_bytes(model.views) + term_bytes(model.texels) +
         (ops::sparse_dictionary_floats(width, run) + ops::sparse_mean_floats(width, run) +
          ops::sparse_abrdf_floats(width, run)) *
             sizeof(float);
}

std::unique_ptr<DeviceSampler> sparse_sampler(Device& device, const SparseModel& model) {
  return std::make_unique<SparseDeviceSampler>(device, model);
}

std::size_t sparse_sampler_bytes(const SparseModel& model) {
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t rows = model.views.length > 0 ? model.abrdf_atoms * shape.views : 0;
  return rows * ops::lookup_row(model.views.length) * sizeof(std::uint32_t) +
         term_bytes(model.texels) + shape.texels() * (sizeof(std::uint32_t) + sizeof(float)) +
         (model.mean.size() +
          ops::lookup_dictionary_floats(model.light_atoms, shape.lights, shape.channels)) *
             sizeof(float);
}

std::unique_ptr<ReferenceDecoder> sparse_reference_decoder(const SparseModel& model) {
  return std::make_unique<SparseReferenceDecoder>(model);
}

// k1 products within k2 products and the mean, summed in float: |error| <= gamma_{k1 + k2 + 1}
// times the sum of the terms' magnitudes, in whatever order the sums are taken.
double sparse_decode_tolerance(const SparseModel& model) {
  const BtfShape& shape = model.info.btf.shape;
  const auto larger = [](double most, float value) {
    return std::max(most, std::abs(double{value}));
  };
  std::vector<double> atoms(model.light_atoms, 0.0);
  const std::size_t row = shape.lights * shape.channels;
  for (std::size_t i = 0; i < model.dictionary.size(); ++i) {
    atoms[i / row] = larger(atoms[i / row], model.dictionary[i]);
  }
  const auto sum_of = [](const SparseLists& lists, std::size_t list,
                         const std::vector<double>& magnitudes) {
    double sum = 0;
    for (std::size_t i = list * lists.length; i < (list + 1) * lists.length; ++i) {
      sum += std::abs(double{lists.coefficients[i]}) * magnitudes[lists.atoms[i]];
    }
    return sum;
  };
  std::vector<double> abrdfs(model.abrdf_atoms, 0.0);
  for (std::size_t j = 0; j < model.abrdf_atoms; ++j) {
    for (std::size_t v = 0; v < shape.views; ++v) {
      abrdfs[j] = std::max(abrdfs[j], sum_of(model.views, j * shape.views + v, atoms));
    }
  }
  double largest = 0;
  double largest_coefficient = 0;
  for (std::size_t p = 0; p < shape.texels(); ++p) {
    largest = std::max(largest, sum_of(model.texels, p, abrdfs));
  }
  for (const float value : model.texels.coefficients) {
    largest_coefficient = larger(largest_coefficient, value);
  }
  double mean = 0;
  for (const float value : model.mean) mean = larger(mean, value);
  const double terms = static_cast<double>(model.views.length + model.texels.length + 1);
  const double unit = 0x1p-24;
  // Each operation on subnormal values may round by half a step of 2^-149 beside, which is
  // multiplied by the texel's coefficient where it happens in an ABRDF.
  const double steps = static_cast<double>(model.texels.length) *
                       static_cast<double>(model.views.length + 1) * (largest_coefficient + 1);
  return terms * unit / (1 - terms * unit) * (mean + largest) + (terms + steps) * 0x1p-149;
}

}  // namespace weft
