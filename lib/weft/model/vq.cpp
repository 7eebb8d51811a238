#include "weft/model/vq.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "weft/btf/mip.hpp"
#include "weft/error.hpp"
#include "weft/model/selected_indices.hpp"

namespace weft {
namespace {

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
  // How many of the first rows of the whole are among them.
  std::size_t among(std::size_t first) const {
    return static_cast<std::size_t>(std::lower_bound(rows.begin(), rows.end(), first) -
                                    rows.begin());
  }
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

// The part of a mip level's planar index that belongs to a region of level 0, as texels of it;
// none where the region cuts texels of the level.
std::optional<Region> region_at(const Region& region, const BtfShape& whole, std::size_t level) {
  const std::size_t side = std::size_t{1} << level;
  const auto cuts = [&](std::size_t first, std::size_t count, std::size_t all) {
    return first % side != 0 || (count % side != 0 && first + count != all);
  };
  if (cuts(region.x, region.width, whole.width) || cuts(region.y, region.height, whole.height)) {
    return std::nullopt;
  }
  return Region{region.x / side, region.y / side, mip_side(region.width, level),
                mip_side(region.height, level)};
}

// Every n-th of the indices, from `first` on.
std::vector<std::uint32_t> column_of(const PackedIndices& indices, std::size_t first,
                                     std::size_t n) {
  std::vector<std::uint32_t> column;
  for (std::size_t i = first; i < indices.size(); i += n) column.push_back(indices[i]);
  return column;
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
  model->some_directions = some_directions || part.views || part.lights;
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
  std::vector<std::vector<std::uint32_t>> of_levels;
  std::vector<std::uint32_t> used = texels;
  const Region region = part.region.value_or(Region{0, 0, whole.width, whole.height});
  for (std::size_t l = 1; l <= coarser.size(); ++l) {
    Selection of_level;
    of_level.region = region_at(region, whole, l);
    if (!of_level.region) break;
    const BtfShape level{1, 1, mip_side(whole.height, l), mip_side(whole.width, l), 1};
    const std::vector<std::size_t> rows = selected_indices(level, of_level).texels;
    of_levels.push_back(entries(coarser[l - 1].entries, 1, rows, one));
    used.insert(used.end(), of_levels.back().begin(), of_levels.back().end());
    model->coarser.push_back({{}, reals(coarser[l - 1].scales, 1, rows, one)});
  }
  const Kept in_p4(sizes.p4, used);
  model->p6 = {in_p4.renumbered(texels), reals(p6.scales, 1, indices.texels, one)};
  for (std::size_t i = 0; i < of_levels.size(); ++i) {
    model->coarser[i].entries = in_p4.renumbered(of_levels[i]);
  }
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
  for (const Sizes& before : earlier) {
    model->earlier.push_back({in_p1.among(before.p1), in_p2.among(before.p2), in_m.among(before.m),
                              in_p3.among(before.p3), in_p4.among(before.p4), 0, 0, 0});
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
    for (std::size_t i = 0; i < earlier.size(); ++i) {
      Sizes& before = model->earlier[i];
      before.c = in_c.among(earlier[i].c);
      before.i1 = in_i1.among(earlier[i].i1);
      before.i2 = in_i2.among(earlier[i].i2);
    }
  }
  // additions that nothing is left of
  while (!model->earlier.empty() && model->earlier.back() == model->sizes) {
    model->earlier.pop_back();
  }
  model->m = PackedIndices(std::move(renumbered), std::max(model->sizes.p2, model->sizes.i2));
  model->seal();
  return model;
}

std::unique_ptr<VqModel> VqModel::next_mip_level() const {
  if (coarser.empty()) return nullptr;
  auto next = std::make_unique<VqModel>(*this);
  Selection level;
  level.level = 1;
  next->info.btf = weft::select(info.btf, level);
  next->info.errors.reset();
  next->p6 = coarser.front();
  next->coarser.erase(next->coarser.begin());
  return next;
}

}  // namespace weft
