#include "weft/model/pca.hpp"

#include <algorithm>
#include <functional>

#include "weft/btf/mip.hpp"
#include "weft/model/coded_tensor.hpp"
#include "weft/model/divide.hpp"
#include "weft/model/selected_indices.hpp"

namespace weft {
namespace {

constexpr std::size_t coefficients_axis = 1;  // of A [P, k]
constexpr std::size_t basis_axis = 0;         // of B [k, V, L, C]

std::vector<std::size_t> mean_shape(const BtfShape& shape) {
  return {shape.views, shape.lights, shape.channels};
}
std::vector<std::size_t> coefficients_shape(const BtfShape& shape, std::size_t rank) {
  return {shape.texels(), rank};
}
std::vector<std::size_t> basis_shape(const BtfShape& shape, std::size_t rank) {
  return {rank, shape.views, shape.lights, shape.channels};
}

}  // namespace

std::vector<ModelTensor> PcaModel::tensors() const {
  const BtfShape& shape = info.btf.shape;
  return {
      {"mean", mean_shape(shape), DType::f32, std::as_bytes(std::span(mean))},
      {"coefficients", coefficients_shape(shape, rank), DType::f32,
       std::as_bytes(std::span(coefficients)), coefficients_axis},
      {"basis", basis_shape(shape, rank), DType::f32, std::as_bytes(std::span(basis)), basis_axis}};
}

std::vector<std::span<float>> PcaModel::real_values() {
  return {mean, coefficients, basis};
}

void PcaModel::divide(const Weights& factors) {
  const BtfShape& shape = info.btf.shape;
  for (std::size_t r = 0; r < mean.size(); ++r) {
    const double s = factors.image(r / shape.channels, shape.lights);
    divide_by(mean[r], s);
    for (std::size_t j = 0; j < rank; ++j) divide_by(basis[j * mean.size() + r], s);
  }
  for (std::size_t i = 0; i < coefficients.size(); ++i) {
    divide_by(coefficients[i], factors.texel(i / rank));
  }
}

void PcaModel::add_mean(std::span<const float> added) {
  std::transform(mean.begin(), mean.end(), added.begin(), mean.begin(), std::plus<>());
}

void PcaModel::fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                            std::span<double> out) const {
  const BtfShape& shape = info.btf.shape;
  const std::size_t image_channels = shape.images() * shape.channels;  // one row of B
  const std::size_t first = (view * shape.lights + light) * shape.channels;
  const float* a = coefficients.data() + (y * shape.width + x) * rank;
  for (std::size_t c = 0; c < shape.channels; ++c) {
    double value = mean[first + c];
    for (std::size_t j = 0; j < rank; ++j) {
      value += double{a[j]} * double{basis[j * image_channels + first + c]};
    }
    out[c] = value;
  }
}

std::unique_ptr<PcaModel> PcaModel::select(const Selection& selection) const {
  Selection part = selection;
  part.level = 0;
  const BtfShape& whole = info.btf.shape;
  auto model = std::make_unique<PcaModel>();
  model->info = selected_info(info, part);
  model->rank = rank;

  const SelectedIndices indices = selected_indices(whole, part);
  for (const std::size_t p : indices.texels) {
    const auto row = coefficients.begin() + static_cast<std::ptrdiff_t>(p * rank);
    model->coefficients.insert(model->coefficients.end(), row,
                               row + static_cast<std::ptrdiff_t>(rank));
  }
  const std::vector<std::size_t> rows = indices.image_channels(whole);
  for (const std::size_t row : rows) model->mean.push_back(mean[row]);
  for (std::size_t j = 0; j < rank; ++j) {
    for (const std::size_t row : rows) model->basis.push_back(basis[j * mean.size() + row]);
  }
  return model;
}

std::unique_ptr<PcaModel> PcaModel::next_mip_level() const {
  if (info.btf.encoding != Encoding::linear) return nullptr;
  const BtfShape& shape = info.btf.shape;
  auto model = std::make_unique<PcaModel>();
  Selection half;
  half.level = 1;
  model->info = selected_info(info, half);
  model->rank = rank;
  model->mean = mean;
  model->basis = basis;
  model->coefficients = coefficients;
  model->coefficients.resize(average_mip(model->coefficients, shape.height, shape.width, rank, 1));
  return model;
}

std::unique_ptr<PcaModel> PcaModel::read(const ModelFile& file) {
  if (file.info().codec != "pca") {
    file.reject("metadata \"codec\": \"" + file.info().codec + "\" instead of \"pca\"");
  }
  auto model = std::make_unique<PcaModel>();
  model->info = file.info();
  const BtfShape& shape = model->info.btf.shape;
  // The rank is the width of A; everything else must fit it.
  const std::vector<std::size_t> found = tensor_shape(file, "coefficients");
  if (found.size() != 2) {
    file.reject("tensor \"coefficients\": shape " + shape_text(found) + " instead of [P, k]");
  }
  model->rank = found[1];
  model->mean = file.real_tensor("mean", mean_shape(shape), ModelTensor::no_component_axis);
  model->coefficients =
      file.real_tensor("coefficients", coefficients_shape(shape, model->rank), coefficients_axis);
  model->basis = file.real_tensor("basis", basis_shape(shape, model->rank), basis_axis);
  return model;
}

}  // namespace weft
