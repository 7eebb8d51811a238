#include "weft/model/vq.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

#include "weft/error.hpp"
#include "weft/model/coded_tensor.hpp"
#include "weft/model/selected_indices.hpp"

namespace weft {
namespace {

constexpr std::size_t no_axis = ModelTensor::no_component_axis;
constexpr std::size_t layout_words = 14;

OnionSlices::Vector wide(const Direction& direction) {
  return {direction[0], direction[1], direction[2]};
}

// The rows of a code-book that others use, in their old order, and their new numbers.
struct Kept {
  std::vector<std::uint32_t> number;
  std::vector<std::size_t> rows;

  Kept(std::size_t size, std::span<const std::uint32_t> used) : number(size, 0) {
    for (const std::uint32_t index : used) number[index] = 1;
    for (std::size_t i = 0; i < size; ++i) {
      if (number[i] == 0) continue;
      number[i] = static_cast<std::uint32_t>(rows.size());
      rows.push_back(i);
    }
  }

  std::size_t size() const { return rows.size(); }
  PackedIndices renumbered(std::vector<std::uint32_t> indices) const {
    for (std::uint32_t& index : indices) index = number[index];
    return {std::move(indices), size()};
  }
};

// Elements of some rows and columns of [rows][width].
template <typename T>
std::vector<T> part_of(std::span<const T> values, std::size_t width,
                       std::span<const std::size_t> rows, std::span<const std::size_t> columns) {
  std::vector<T> part;
  part.reserve(rows.size() * columns.size());
  for (const std::size_t row : rows) {
    for (const std::size_t column : columns) part.push_back(values[row * width + column]);
  }
  return part;
}

std::vector<std::size_t> counted(std::size_t count) {
  std::vector<std::size_t> indices(count);
  for (std::size_t i = 0; i < count; ++i) indices[i] = i;
  return indices;
}

// Every n-th of the indices, from `first` on.
std::vector<std::uint32_t> column_of(const PackedIndices& indices, std::size_t first,
                                     std::size_t n) {
  std::vector<std::uint32_t> column;
  for (std::size_t i = first; i < indices.size(); i += n) column.push_back(indices[i]);
  return column;
}

PackedIndices read_indices(const ModelFile& file, const std::string& name, std::size_t count,
                           std::size_t limit) {
  const std::vector<std::uint32_t> bytes =
      file.index_tensor(name, {PackedIndices::packed_size(count, limit)}, 256);
  return PackedIndices::unpack(bytes, count, limit,
                               fmt::format("{}: tensor \"{}\"", file.file().path().string(), name));
}

}  // namespace

VqPlace vq_place(const OnionSizes& sizes, const Direction& view, const Direction& light) {
  const OnionSlices slices(sizes);
  const OnionPosition at = slices.at(wide(view), wide(light));
  return {slices.phi_step(at.phi), slices.theta_step(at.theta), slices.alpha_step(at.alpha),
          slices.beta_step(at.beta)};
}

VqPlace vq_place(const VqGrid& grid, const BtfInfo& btf, std::size_t view, std::size_t light) {
  if (grid.kind == VqGrid::Kind::measured) {
    return {OnionStep{view, view, 0}, OnionStep{}, OnionStep{}, OnionStep{light, light, 0}};
  }
  const std::size_t of = btf.layout == Layout::paired ? view : light;
  return vq_place(grid.sizes, btf.view_directions[view], btf.light_directions[of]);
}

std::vector<ModelTensor> VqModel::tensors() const {
  const auto& n = grid.sizes;
  const auto real = [](std::string name, std::vector<std::size_t> shape,
                       const std::vector<float>& values) {
    return ModelTensor{std::move(name), std::move(shape), DType::f32,
                       std::as_bytes(std::span(values))};
  };
  const auto packed = [](std::string name, const PackedIndices& indices) {
    return ModelTensor{std::move(name), {indices.bytes().size()}, DType::u8, indices.bytes()};
  };
  std::vector<ModelTensor> tensors{real("P1", {sizes.p1, n.beta}, p1),
                                   real("P2_scales", {sizes.p2, n.alpha}, p2.scales),
                                   real("P3_scales", {sizes.p3, n.theta}, p3.scales),
                                   real("P4_scales", {sizes.p4, n.phi}, p4.scales),
                                   real("P6_scales", {info.btf.shape.texels()}, p6.scales)};
  if (chromaticities > 0) tensors.push_back(real("C", {sizes.c, chromaticities}, c));
  tensors.push_back({"layout", {layout_words}, DType::u32, layout_});
  tensors.push_back({"channels", {channels.size()}, DType::u8, std::as_bytes(std::span(channels))});
  tensors.push_back(packed("P2", p2.entries));
  tensors.push_back(packed("M", m));
  tensors.push_back(packed("P3", p3.entries));
  tensors.push_back(packed("P4", p4.entries));
  tensors.push_back(packed("P6", p6.entries));
  if (chromaticities > 0) {
    tensors.push_back(packed("I1", i1));
    tensors.push_back(packed("I2", i2));
  }
  return tensors;
}

std::vector<std::span<float>> VqModel::real_values() {
  std::vector<std::span<float>> values{p1, p2.scales, p3.scales, p4.scales, p6.scales};
  if (chromaticities > 0) values.emplace_back(c);
  return values;
}

void VqModel::divide(const Weights& factors) {
  (void)factors;
  fail_input("weights: code-books are shared among directions and texels, none can be divided out");
}

void VqModel::entry_values(std::size_t j, const VqPlace& place, std::span<double> out) const {
  const auto& n = grid.sizes;
  const std::size_t per_pair = chromaticities > 0 ? 2 : 1;
  std::fill(out.begin(), out.end(), 0.0);
  // Calls next(node, weight) for the nodes of a level between which the place lies.
  const auto between = [](const OnionStep& step, double weight, const auto& next) {
    if (step.fraction < 1) next(step.low, weight * (1 - step.fraction));
    if (step.fraction > 0) next(step.high, weight * step.fraction);
  };
  between(place[0], 1.0, [&](std::size_t phi, double of_phi) {
    const std::size_t k4 = j * n.phi + phi;
    between(place[1], of_phi, [&](std::size_t theta, double of_theta) {
      const std::size_t k3 = p4.entries[k4] * n.theta + theta;
      const double scale = double{p4.scales[k4]} * double{p3.scales[k3]};
      const std::size_t pair = p3.entries[k3] * per_pair;
      between(place[2], of_theta, [&](std::size_t alpha, double of_alpha) {
        const std::size_t k2 = m[pair] * n.alpha + alpha;
        between(place[3], of_alpha, [&](std::size_t beta, double weight) {
          const double slice = p1[p2.entries[k2] * n.beta + beta];
          out[0] += weight * scale * double{p2.scales[k2]} * slice;
          if (chromaticities == 0) return;
          const std::size_t slice_of_colours = i2[m[pair + 1] * n.alpha + alpha];
          const float* colour = c.data() + i1[slice_of_colours * n.beta + beta] * chromaticities;
          for (std::size_t a = 0; a < chromaticities; ++a) out[1 + a] += weight * double{colour[a]};
        });
      });
    });
  });
}

void VqModel::fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                           std::span<double> out) const {
  texel_values(y * info.btf.shape.width + x, vq_place(grid, info.btf, view, light), out);
}

void VqModel::fitted_texel_at(const Direction& view, const Direction& light, std::size_t y,
                              std::size_t x, std::span<double> out) const {
  texel_values(y * info.btf.shape.width + x, vq_place(grid.sizes, view, light), out);
}

void VqModel::texel_values(std::size_t p, const VqPlace& place, std::span<double> out) const {
  std::vector<double> values(1 + chromaticities);
  entry_values(p6.entries[p], place, values);
  values[0] *= double{p6.scales[p]};
  for (std::size_t i = 0; i < channels.size(); ++i) out[i] = values[channels[i]];
}

std::unique_ptr<VqModel> VqModel::select(const Selection& selection) const {
  Selection part = selection;
  part.level = 0;
  const BtfShape& whole = info.btf.shape;
  const SelectedIndices indices = selected_indices(whole, part);
  const OnionSizes& n = grid.sizes;
  auto model = std::make_unique<VqModel>();
  model->info = selected_info(info, part);
  model->chromaticities = chromaticities;
  for (const std::size_t channel : indices.channels) model->channels.push_back(channels[channel]);
  // measured directions are columns of code-books; onion slices are there for all directions
  const bool measured = grid.kind == VqGrid::Kind::measured;
  model->grid = measured ? VqGrid::measured(model->info.btf.shape) : grid;
  const std::vector<std::size_t> of_phi = measured ? indices.views : counted(n.phi);
  const std::vector<std::size_t> of_beta = measured ? indices.lights : counted(n.beta);
  const std::vector<std::size_t> of_theta = counted(n.theta);
  const std::vector<std::size_t> of_alpha = counted(n.alpha);
  const std::vector<std::size_t> one{0};

  const auto entries = [](const PackedIndices& list, std::size_t width,
                          const std::vector<std::size_t>& rows,
                          const std::vector<std::size_t>& columns) {
    return part_of<std::uint32_t>(list.indices(), width, rows, columns);
  };
  const auto reals = [](const std::vector<float>& list, std::size_t width,
                        const std::vector<std::size_t>& rows,
                        const std::vector<std::size_t>& columns) {
    return part_of<float>(list, width, rows, columns);
  };
  // from the texels down, each code-book without the rows that nothing points to
  const std::vector<std::uint32_t> texels = entries(p6.entries, 1, indices.texels, one);
  const Kept in_p4(sizes.p4, texels);
  model->p6 = {in_p4.renumbered(texels), reals(p6.scales, 1, indices.texels, one)};
  const auto row_p4 = entries(p4.entries, n.phi, in_p4.rows, of_phi);
  const Kept in_p3(sizes.p3, row_p4);
  model->p4 = {in_p3.renumbered(row_p4), reals(p4.scales, n.phi, in_p4.rows, of_phi)};
  const auto row_p3 = entries(p3.entries, n.theta, in_p3.rows, of_theta);
  const Kept in_m(sizes.m, row_p3);
  model->p3 = {in_m.renumbered(row_p3), reals(p3.scales, n.theta, in_p3.rows, of_theta)};
  const std::size_t per_pair = chromaticities > 0 ? 2 : 1;
  const auto pairs = entries(m, per_pair, in_m.rows, counted(per_pair));
  const PackedIndices all_pairs(pairs, std::max(sizes.p2, sizes.i2));
  const Kept in_p2(sizes.p2, column_of(all_pairs, 0, per_pair));
  const auto row_p2 = entries(p2.entries, n.alpha, in_p2.rows, of_alpha);
  const Kept in_p1(sizes.p1, row_p2);
  model->p2 = {in_p1.renumbered(row_p2), reals(p2.scales, n.alpha, in_p2.rows, of_alpha)};
  model->p1 = reals(p1, n.beta, in_p1.rows, of_beta);
  model->sizes = {in_p1.size(), in_p2.size(), in_m.size(), in_p3.size(), in_p4.size(), 0, 0, 0};
  std::vector<std::uint32_t> renumbered = pairs;
  for (std::size_t i = 0; i < renumbered.size(); i += per_pair) {
    renumbered[i] = in_p2.number[renumbered[i]];
  }
  if (chromaticities > 0) {
    const Kept in_i2(sizes.i2, column_of(all_pairs, 1, per_pair));
    const auto row_i2 = entries(i2, n.alpha, in_i2.rows, of_alpha);
    const Kept in_i1(sizes.i1, row_i2);
    const auto row_i1 = entries(i1, n.beta, in_i1.rows, of_beta);
    const Kept in_c(sizes.c, row_i1);
    for (std::size_t i = 1; i < renumbered.size(); i += 2) {
      renumbered[i] = in_i2.number[renumbered[i]];
    }
    model->i2 = in_i1.renumbered(row_i2);
    model->i1 = in_c.renumbered(row_i1);
    model->c = reals(c, chromaticities, in_c.rows, counted(chromaticities));
    model->sizes.c = in_c.size();
    model->sizes.i1 = in_i1.size();
    model->sizes.i2 = in_i2.size();
  }
  model->m = PackedIndices(std::move(renumbered), std::max(model->sizes.p2, model->sizes.i2));
  model->seal();
  return model;
}

void VqModel::seal() {
  const auto& n = grid.sizes;
  const std::array<std::size_t, layout_words> words{grid.kind == VqGrid::Kind::onion ? 1U : 0U,
                                                    n.phi,
                                                    n.theta,
                                                    n.alpha,
                                                    n.beta,
                                                    chromaticities,
                                                    sizes.p1,
                                                    sizes.p2,
                                                    sizes.m,
                                                    sizes.p3,
                                                    sizes.p4,
                                                    sizes.c,
                                                    sizes.i1,
                                                    sizes.i2};
  layout_.resize(layout_words * sizeof(std::uint32_t));
  for (std::size_t i = 0; i < layout_words; ++i) {
    const auto word = static_cast<std::uint32_t>(words[i]);
    std::memcpy(layout_.data() + i * sizeof(word), &word, sizeof(word));
  }
}

std::unique_ptr<VqModel> VqModel::read(const ModelFile& file) {
  if (file.info().codec != "vq") {
    file.reject("metadata \"codec\": \"" + file.info().codec + "\" instead of \"vq\"");
  }
  auto model = std::make_unique<VqModel>();
  model->info = file.info();
  const BtfShape& shape = model->info.btf.shape;
  const auto reject = [&](const std::string& why) { file.reject("tensor \"layout\": " + why); };

  const auto layout =
      file.index_tensor("layout", {layout_words}, std::numeric_limits<std::uint32_t>::max());
  if (layout[0] > 1) reject(fmt::format("grid {} is neither 0, measured, nor 1, onion", layout[0]));
  model->grid.kind = layout[0] == 1 ? VqGrid::Kind::onion : VqGrid::Kind::measured;
  model->grid.sizes = {layout[1], layout[2], layout[3], layout[4]};
  const OnionSizes& n = model->grid.sizes;
  validate(n, file.file().path().string() + ": tensor \"layout\"");
  if (model->grid.kind == VqGrid::Kind::measured && model->grid != VqGrid::measured(shape)) {
    reject(fmt::format("sizes {} x {} x {} x {} of {} measured views and {} lights", n.phi, n.theta,
                       n.alpha, n.beta, shape.views, shape.lights));
  }
  model->chromaticities = layout[5];
  model->sizes = {layout[6],  layout[7],  layout[8],  layout[9],
                  layout[10], layout[11], layout[12], layout[13]};
  const Sizes& s = model->sizes;
  const bool colours = model->chromaticities > 0;
  if (std::min({s.p1, s.p2, s.m, s.p3, s.p4}) == 0 ||
      (colours && std::min({s.c, s.i1, s.i2}) == 0)) {
    reject("a code-book without entries");
  }
  if (model->chromaticities > 1024 || (!colours && (s.c != 0 || s.i1 != 0 || s.i2 != 0))) {
    reject(fmt::format("{} chromaticities in code-books of {}, {} and {}", model->chromaticities,
                       s.c, s.i1, s.i2));
  }
  const auto channels = file.index_tensor("channels", {shape.channels}, model->chromaticities + 1);
  for (const std::uint32_t channel : channels) {
    if (channel > 255) file.reject("tensor \"channels\": more than 255 chromaticities");
    model->channels.push_back(static_cast<std::uint8_t>(channel));
  }

  const auto book = [&](const std::string& name, std::size_t rows, std::size_t width,
                        std::size_t below, const std::vector<std::size_t>& scales) {
    // the scales are there before memory is taken for as many entries
    VqCodeBook result;
    result.scales = file.real_tensor(name + "_scales", scales, no_axis);
    result.entries = read_indices(file, name, rows * width, below);
    return result;
  };
  model->p1 = file.real_tensor("P1", {s.p1, n.beta}, no_axis);
  model->p2 = book("P2", s.p2, n.alpha, s.p1, {s.p2, n.alpha});
  model->m = read_indices(file, "M", s.m * (colours ? 2 : 1), std::max(s.p2, s.i2));
  for (std::size_t i = 0; i < model->m.size(); ++i) {
    const std::size_t limit = colours && i % 2 == 1 ? s.i2 : s.p2;
    if (model->m[i] >= limit) {
      file.reject(
          fmt::format("tensor \"M\": index {} of entry {} is not below {}", model->m[i], i, limit));
    }
  }
  model->p3 = book("P3", s.p3, n.theta, s.m, {s.p3, n.theta});
  model->p4 = book("P4", s.p4, n.phi, s.p3, {s.p4, n.phi});
  model->p6 = book("P6", shape.texels(), 1, s.p4, {shape.texels()});
  if (colours) {
    model->c = file.real_tensor("C", {s.c, model->chromaticities}, no_axis);
    model->i1 = read_indices(file, "I1", s.i1 * n.beta, s.c);
    model->i2 = read_indices(file, "I2", s.i2 * n.alpha, s.i1);
  }
  model->seal();
  return model;
}

}  // namespace weft
