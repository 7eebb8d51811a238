#include "weft/model/view_pca.hpp"

#include <algorithm>
#include <functional>

#include "weft/btf/mip.hpp"
#include "weft/model/coded_tensor.hpp"
#include "weft/model/divide.hpp"
#include "weft/model/selected_indices.hpp"

namespace weft {
namespace {

constexpr std::size_t component_axis = 0;  // of A [K, P] and B [K, L, C]
constexpr std::size_t view_axis = 0;       // of the means [V, L, C]

std::vector<std::size_t> mean_shape(const BtfShape& shape) {
  return {shape.views, shape.lights, shape.channels};
}
std::vector<std::size_t> images_shape(const BtfShape& shape, std::size_t components) {
  return {components, shape.texels()};
}
std::vector<std::size_t> basis_shape(const BtfShape& shape, std::size_t components) {
  return {components, shape.lights, shape.channels};
}

std::size_t components_of(const IndexTensor& ranks) {
  std::size_t sum = 0;
  for (std::size_t v = 0; v < ranks.size(); ++v) sum += ranks[v];
  return sum;
}

}  // namespace

std::vector<std::size_t> ViewPcaModel::offsets() const {
  std::vector<std::size_t> offsets{0};
  for (std::size_t v = 0; v < ranks.size(); ++v) offsets.push_back(offsets.back() + ranks[v]);
  return offsets;
}

std::vector<ModelTensor> ViewPcaModel::tensors() const {
  const BtfShape& shape = info.btf.shape;
  const std::size_t components = components_of(ranks);
  return {{"ranks", {shape.views}, ranks.dtype(), ranks.bytes()},
          {"mean", mean_shape(shape), DType::f32, std::as_bytes(std::span(mean)), view_axis},
          {"images", images_shape(shape, components), DType::f32, std::as_bytes(std::span(images)),
           component_axis},
          {"basis", basis_shape(shape, components), DType::f32, std::as_bytes(std::span(basis)),
           component_axis}};
}

std::vector<std::span<float>> ViewPcaModel::real_values() {
  return {mean, images, basis};
}

void ViewPcaModel::divide(const Weights& factors) {
  const BtfShape& shape = info.btf.shape;
  const std::size_t row = shape.lights * shape.channels;
  for (std::size_t r = 0; r < mean.size(); ++r) {
    divide_by(mean[r], factors.image(r / shape.channels, shape.lights));
  }
  for (std::size_t i = 0; i < images.size(); ++i) {
    divide_by(images[i], factors.texel(i % shape.texels()));
  }
  const std::vector<std::size_t> first = offsets();
  for (std::size_t v = 0; v < ranks.size(); ++v) {
    for (std::size_t i = first[v] * row; i < first[v + 1] * row; ++i) {
      divide_by(basis[i], factors.image(v * shape.lights + i % row / shape.channels, shape.lights));
    }
  }
}

void ViewPcaModel::add_mean(std::span<const float> added) {
  std::transform(mean.begin(), mean.end(), added.begin(), mean.begin(), std::plus<>());
}

void ViewPcaModel::fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                                std::span<double> out) const {
  const BtfShape& shape = info.btf.shape;
  const std::size_t p = y * shape.width + x;
  const std::size_t light_channels = shape.lights * shape.channels;  // one row of B
  std::size_t first = 0;
  for (std::size_t v = 0; v < view; ++v) first += ranks[v];
  const std::size_t end = first + ranks[view];
  for (std::size_t c = 0; c < shape.channels; ++c) {
    const std::size_t row = light * shape.channels + c;
    double value = mean[view * light_channels + row];
    for (std::size_t i = first; i < end; ++i) {
      value += double{images[i * shape.texels() + p]} * double{basis[i * light_channels + row]};
    }
    out[c] = value;
  }
}

std::unique_ptr<ViewPcaModel> ViewPcaModel::select(const Selection& selection) const {
  Selection part = selection;
  part.level = 0;
  const BtfShape& whole = info.btf.shape;
  auto model = std::make_unique<ViewPcaModel>();
  model->info = selected_info(info, part);

  const SelectedIndices indices = selected_indices(whole, part);
  const std::vector<std::size_t> first = offsets();
  const std::size_t light_channels = whole.lights * whole.channels;
  std::vector<std::size_t> rows;  // (l, c)
  for (const std::size_t l : indices.lights) {
    for (const std::size_t c : indices.channels) rows.push_back(l * whole.channels + c);
  }
  std::vector<std::uint32_t> kept;
  for (const std::size_t v : indices.views) {
    kept.push_back(static_cast<std::uint32_t>(ranks[v]));
    for (const std::size_t row : rows) model->mean.push_back(mean[v * light_channels + row]);
    for (std::size_t i = first[v]; i < first[v + 1]; ++i) {
      for (const std::size_t p : indices.texels) {
        model->images.push_back(images[i * whole.texels() + p]);
      }
      for (const std::size_t row : rows) model->basis.push_back(basis[i * light_channels + row]);
    }
  }
  model->ranks = IndexTensor(kept, *std::max_element(kept.begin(), kept.end()) + std::size_t{1});
  return model;
}

std::unique_ptr<ViewPcaModel> ViewPcaModel::next_mip_level() const {
  if (info.btf.encoding != Encoding::linear) return nullptr;
  const BtfShape& shape = info.btf.shape;
  auto model = std::make_unique<ViewPcaModel>();
  Selection half;
  half.level = 1;
  model->info = selected_info(info, half);
  model->ranks = ranks;
  model->mean = mean;
  model->basis = basis;
  std::vector<float> image;
  for (auto first = images.begin(); first != images.end();) {
    const auto end = first + static_cast<std::ptrdiff_t>(shape.texels());
    image.assign(first, end);
    image.resize(average_mip(image, shape.height, shape.width, 1, 1));
    model->images.insert(model->images.end(), image.begin(), image.end());
    first = end;
  }
  return model;
}

std::unique_ptr<ViewPcaModel> ViewPcaModel::read(const ModelFile& file) {
  if (file.info().codec != "view-pca") {
    file.reject("metadata \"codec\": \"" + file.info().codec + "\" instead of \"view-pca\"");
  }
  auto model = std::make_unique<ViewPcaModel>();
  model->info = file.info();
  const BtfShape& shape = model->info.btf.shape;
  // No view can have more components than there are; and so their sum can't overflow.
  const std::vector<std::size_t> found = tensor_shape(file, "images");
  if (found.size() != 2) {
    file.reject("tensor \"images\": shape " + shape_text(found) + " instead of [K, P]");
  }
  const std::vector<std::uint32_t> ranks =
      file.index_tensor("ranks", {shape.views}, found[0] + std::size_t{1});
  model->ranks = IndexTensor(ranks, *std::max_element(ranks.begin(), ranks.end()) + std::size_t{1});
  const std::size_t components = components_of(model->ranks);
  model->mean = file.real_tensor("mean", mean_shape(shape), view_axis);
  model->images = file.real_tensor("images", images_shape(shape, components), component_axis);
  model->basis = file.real_tensor("basis", basis_shape(shape, components), component_axis);
  return model;
}

}  // namespace weft
