#include "weft/model/lpca.hpp"

#include <algorithm>
#include <limits>

#include "weft/model/coded_tensor.hpp"
#include "weft/model/divide.hpp"
#include "weft/model/selected_indices.hpp"

namespace weft {
namespace {

constexpr std::size_t coefficients_axis = 1;  // of A [P, k]
constexpr std::size_t first_axis = 0;         // of the means [G, V, L, C] and B [K, V, L, C]

std::vector<std::size_t> coefficients_shape(const BtfShape& shape, std::size_t rank) {
  return {shape.texels(), rank};
}
// Of the means, and of B.
std::vector<std::size_t> rows_shape(const BtfShape& shape, std::size_t count) {
  return {count, shape.views, shape.lights, shape.channels};
}

std::size_t sum_of(const IndexTensor& ranks) {
  std::size_t sum = 0;
  for (std::size_t g = 0; g < ranks.size(); ++g) sum += ranks[g];
  return sum;
}

}  // namespace

std::vector<std::size_t> LpcaModel::offsets() const {
  std::vector<std::size_t> offsets{0};
  for (std::size_t g = 0; g < ranks.size(); ++g) offsets.push_back(offsets.back() + ranks[g]);
  return offsets;
}

std::vector<ModelTensor> LpcaModel::tensors() const {
  const BtfShape& shape = info.btf.shape;
  return {{"clusters", {shape.texels()}, clusters.dtype(), clusters.bytes()},
          {"ranks", {ranks.size()}, ranks.dtype(), ranks.bytes()},
          {"mean", rows_shape(shape, ranks.size()), DType::f32, std::as_bytes(std::span(mean)),
           first_axis},
          {"coefficients", coefficients_shape(shape, rank), DType::f32,
           std::as_bytes(std::span(coefficients)), coefficients_axis},
          {"basis", rows_shape(shape, sum_of(ranks)), DType::f32, std::as_bytes(std::span(basis)),
           first_axis}};
}

std::vector<std::span<float>> LpcaModel::real_values() {
  return {mean, coefficients, basis};
}

void LpcaModel::divide(const Weights& factors) {
  const BtfShape& shape = info.btf.shape;
  const std::size_t images = shape.images();
  for (std::vector<float>* rows : {&mean, &basis}) {
    for (std::size_t i = 0; i < rows->size(); ++i) {
      divide_by((*rows)[i], factors.image(i / shape.channels % images, shape.lights));
    }
  }
  for (std::size_t i = 0; i < coefficients.size(); ++i) {
    divide_by(coefficients[i], factors.texel(i / rank));
  }
}

void LpcaModel::add_mean(std::span<const float> added) {
  for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += added[i % added.size()];
}

void LpcaModel::fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                             std::span<double> out) const {
  const BtfShape& shape = info.btf.shape;
  const std::size_t n = shape.images() * shape.channels;  // one row of B
  const std::size_t first = (view * shape.lights + light) * shape.channels;
  const std::size_t p = y * shape.width + x;
  const std::size_t cluster = clusters[p];
  std::size_t offset = 0;
  for (std::size_t g = 0; g < cluster; ++g) offset += ranks[g];
  const float* a = coefficients.data() + p * rank;
  for (std::size_t c = 0; c < shape.channels; ++c) {
    double value = mean[cluster * n + first + c];
    for (std::size_t j = 0; j < ranks[cluster]; ++j) {
      value += double{a[j]} * double{basis[(offset + j) * n + first + c]};
    }
    out[c] = value;
  }
}

std::unique_ptr<LpcaModel> LpcaModel::select(const Selection& selection) const {
  Selection part = selection;
  part.level = 0;
  const BtfShape& whole = info.btf.shape;
  auto model = std::make_unique<LpcaModel>();
  model->info = selected_info(info, part);
  model->rank = rank;

  const SelectedIndices indices = selected_indices(whole, part);
  // clusters in their old order, without those that are no longer used
  constexpr std::uint32_t unused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> number(ranks.size(), unused);
  for (const std::size_t p : indices.texels) number[clusters[p]] = 0;
  std::uint32_t kept = 0;
  for (std::uint32_t& value : number) {
    if (value != unused) value = kept++;
  }

  std::vector<std::uint32_t> part_clusters;
  for (const std::size_t p : indices.texels) {
    part_clusters.push_back(number[clusters[p]]);
    const auto row = coefficients.begin() + static_cast<std::ptrdiff_t>(p * rank);
    model->coefficients.insert(model->coefficients.end(), row,
                               row + static_cast<std::ptrdiff_t>(rank));
  }
  const std::vector<std::size_t> rows = indices.image_channels(whole);
  const std::size_t n = whole.images() * whole.channels;
  const std::vector<std::size_t> first = offsets();
  std::vector<std::uint32_t> part_ranks;
  for (std::size_t g = 0; g < ranks.size(); ++g) {
    if (number[g] == unused) continue;
    part_ranks.push_back(static_cast<std::uint32_t>(ranks[g]));
    for (const std::size_t row : rows) model->mean.push_back(mean[g * n + row]);
    for (std::size_t i = first[g]; i < first[g + 1]; ++i) {
      for (const std::size_t row : rows) model->basis.push_back(basis[i * n + row]);
    }
  }
  model->clusters = IndexTensor(part_clusters, kept);
  model->ranks = IndexTensor(part_ranks, rank + 1);
  return model;
}

std::unique_ptr<LpcaModel> LpcaModel::read(const ModelFile& file) {
  if (file.info().codec != "lpca") {
    file.reject("metadata \"codec\": \"" + file.info().codec + "\" instead of \"lpca\"");
  }
  auto model = std::make_unique<LpcaModel>();
  model->info = file.info();
  const BtfShape& shape = model->info.btf.shape;
  // The numbers of clusters and of columns are those of `ranks` and of A; everything else must fit.
  const std::vector<std::size_t> found = tensor_shape(file, "ranks");
  if (found.size() != 1 || found[0] == 0) {
    file.reject("tensor \"ranks\": shape " + shape_text(found) + " instead of [G]");
  }
  const std::size_t clusters = found[0];
  const std::vector<std::size_t> columns = tensor_shape(file, "coefficients");
  if (columns.size() != 2) {
    file.reject("tensor \"coefficients\": shape " + shape_text(columns) + " instead of [P, k]");
  }
  model->rank = columns[1];
  if (model->rank >= std::numeric_limits<std::uint32_t>::max()) {
    file.reject("tensor \"coefficients\": shape " + shape_text(columns) + " has too many columns");
  }
  model->clusters =
      IndexTensor(file.index_tensor("clusters", {shape.texels()}, clusters), clusters);
  model->ranks =
      IndexTensor(file.index_tensor("ranks", {clusters}, model->rank + 1), model->rank + 1);
  model->mean = file.real_tensor("mean", rows_shape(shape, clusters), first_axis);
  model->coefficients =
      file.real_tensor("coefficients", coefficients_shape(shape, model->rank), coefficients_axis);
  model->basis = file.real_tensor("basis", rows_shape(shape, sum_of(model->ranks)), first_axis);
  return model;
}

}  // namespace weft
