#include "weft/reference/vq_code_books.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "weft/error.hpp"

namespace weft {
namespace {

// Vectors that are compared with each other one by one before they become code-vectors.
constexpr std::size_t block = 256;

}  // namespace

VqThresholds VqThresholds::times(double factor) const {
  return {p4 * factor, p3 * factor, m * factor,  p2 * factor,
          p1 * factor, i2 * factor, i1 * factor, c * factor};
}

VectorShape texel_vector(const VqGrid& grid, std::size_t channels) {
  return {grid.nodes(), grid.nodes() * (channels - 1)};
}

float mean_magnitude(std::span<const float> values) {
  double sum = 0;
  for (const float value : values) sum += std::abs(double{value});
  return static_cast<float>(sum / static_cast<double>(std::max<std::size_t>(values.size(), 1)));
}

VqCodeBooks::VqCodeBooks(const VqGrid& grid, std::size_t channels, std::size_t most_bytes)
    : grid_(grid), chromaticities_(channels - 1), most_bytes_(most_bytes) {
  const OnionSizes& n = grid.sizes;
  const auto set = [&](LevelName name, std::size_t nodes, bool luminance, bool chromaticity,
                       std::size_t width) {
    Level& level = levels_[name];
    level.shape = {luminance ? nodes : 0, chromaticity ? nodes * chromaticities_ : 0};
    level.width = width;
  };
  set(p4, grid.nodes(), true, true, n.phi);
  set(p3, n.theta * n.lights(), true, true, n.theta);
  set(m, n.lights(), true, true, chromaticities_ > 0 ? 2 : 1);
  set(p2, n.lights(), true, false, n.alpha);
  set(p1, n.beta, true, false, 0);
  set(i2, n.lights(), false, true, n.alpha);
  set(i1, n.beta, false, true, n.beta);
  set(c, 1, false, true, 0);
}

void VqCodeBooks::check_bytes() const {
  if (bytes_ <= most_bytes_) return;
  fail_input(
      "--threshold: the code-vectors that it takes are more than {} bytes: a larger one takes "
      "fewer, "
      "and more --memory holds more",
      most_bytes_);
}

void VqCodeBooks::append(Level& level, const float* row, float scale) {
  bytes_ += level.shape.values() * sizeof(float);
  check_bytes();
  const double divisor = scale > 0 ? double{scale} : 1.0;
  for (std::size_t i = 0; i < level.shape.luminances; ++i) {
    level.rows.push_back(static_cast<float>(double{row[i]} / divisor));
  }
  level.rows.insert(level.rows.end(), row + level.shape.luminances, row + level.shape.values());
}

void VqCodeBooks::Vectors::append(const ScaledVectors& from, std::size_t first, std::size_t count) {
  const std::array<std::span<const float>, plane_count> given{from.rows, from.means,
                                                              from.deviations};
  for (std::size_t plane = 0; plane < plane_count; ++plane) {
    if (given[plane].empty()) continue;
    const std::span<const float> values = given[plane].subspan(first, count);
    planes[plane].insert(planes[plane].end(), values.begin(), values.end());
  }
}

VqCodeBooks::Assigned VqCodeBooks::assign(LevelName name, const ScaledVectors& vectors,
                                          double threshold, NearestSearch& search) {
  Level& level = levels_[name];
  const VectorShape& shape = level.shape;
  const std::size_t width = shape.values();
  const double most = search.distance_of(threshold, shape);
  const std::size_t before = level.size();
  Assigned assigned;
  assigned.index.resize(vectors.scales.size());
  const auto distance = [&](std::size_t vector, std::size_t code_vector) {
    return search.distance(shape, vectors.vector(shape, vector),
                           level.rows.data() + code_vector * width, most);
  };
  // those that a code-vector in [first, size) is near enough to; the others
  const auto place = [&](const std::vector<std::size_t>& wanted, std::size_t first) {
    if (first == level.size() || wanted.empty()) return wanted;
    Vectors chosen;
    for (const std::size_t i : wanted) {
      chosen.append(vectors, i * width, width);
      chosen.scales.push_back(vectors.scales[i]);
    }
    search.set(shape, std::span<const float>(level.rows).subspan(first * width));
    const std::vector<std::uint32_t> nearest = search.nearest(chosen.view(), most);
    std::vector<std::size_t> others;
    for (std::size_t n = 0; n < wanted.size(); ++n) {
      const std::size_t j = first + nearest[n];
      if (distance(wanted[n], j) <= most) {
        assigned.index[wanted[n]] = static_cast<std::uint32_t>(j);
      } else {
        others.push_back(wanted[n]);
      }
    }
    return others;
  };
  std::vector<std::size_t> all(vectors.scales.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
  const std::vector<std::size_t> unplaced = place(all, 0);
  for (std::size_t begin = 0; begin < unplaced.size(); begin += block) {
    const std::size_t end = std::min(begin + block, unplaced.size());
    const std::vector<std::size_t> part(unplaced.begin() + static_cast<std::ptrdiff_t>(begin),
                                        unplaced.begin() + static_cast<std::ptrdiff_t>(end));
    const std::vector<std::size_t> others = place(part, before);
    const std::size_t first = level.size();
    for (const std::size_t i : others) {
      double least = std::numeric_limits<double>::infinity();
      std::size_t nearest = level.size();
      for (std::size_t j = first; j < level.size(); ++j) {
        const double d = distance(i, j);
        if (d > most || d >= least) continue;
        least = d;
        nearest = j;
      }
      if (nearest == level.size()) {
        append(level, vectors.rows.data() + i * width, vectors.scales[i]);
        assigned.added.push_back(i);
      }
      assigned.index[i] = static_cast<std::uint32_t>(nearest);
    }
  }
  return assigned;
}

void VqCodeBooks::enter(LevelName name, const ScaledVectors& vectors,
                        const VqThresholds& thresholds, NearestSearch& search,
                        std::vector<std::uint32_t>& indices) {
  const std::array<double, level_count> bounds{thresholds.p4, thresholds.p3, thresholds.m,
                                               thresholds.p2, thresholds.p1, thresholds.i2,
                                               thresholds.i1, thresholds.c};
  Assigned assigned = assign(name, vectors, bounds[name], search);
  descend(name, vectors, assigned.added, thresholds, search);
  indices = std::move(assigned.index);
}

void VqCodeBooks::descend(LevelName name, const ScaledVectors& vectors,
                          const std::vector<std::size_t>& added, const VqThresholds& thresholds,
                          NearestSearch& search) {
  if (name == p1 || name == c || added.empty()) return;
  Level& level = levels_[name];
  const std::size_t lum = level.shape.luminances;
  const std::size_t values = level.shape.values();
  std::vector<std::uint32_t> indices;
  if (name == m) {
    // luminance and chromaticity part
    Vectors luminance, chromaticity;
    for (const std::size_t i : added) {
      luminance.append(vectors, i * values, lum);
      luminance.scales.push_back(vectors.scales[i]);
      chromaticity.append(vectors, i * values + lum, values - lum);
      chromaticity.scales.push_back(1);
    }
    enter(p2, luminance.view(), thresholds, search, indices);
    std::vector<std::uint32_t> colours;
    if (chromaticities_ > 0) enter(i2, chromaticity.view(), thresholds, search, colours);
    for (std::size_t n = 0; n < added.size(); ++n) {
      level.children.push_back(indices[n]);
      if (chromaticities_ > 0) level.children.push_back(colours[n]);
    }
    return;
  }
  const LevelName below = name == p4 ? p3 : name == p3 ? m : name == p2 ? p1 : name == i2 ? i1 : c;
  const VectorShape part{lum / level.width, level.shape.chromaticities / level.width};
  Vectors parts;
  for (const std::size_t i : added) {
    for (std::size_t n = 0; n < level.width; ++n) {
      const std::size_t luminance = i * values + n * part.luminances;
      parts.append(vectors, luminance, part.luminances);
      parts.append(vectors, i * values + lum + n * part.chromaticities, part.chromaticities);
      if (lum == 0) {
        parts.scales.push_back(1);
        continue;
      }
      const float scale = mean_magnitude(vectors.rows.subspan(luminance, part.luminances));
      parts.scales.push_back(scale);
      level.scales.push_back(vectors.scales[i] > 0 ? scale / vectors.scales[i] : 0);
    }
  }
  enter(below, parts.view(), thresholds, search, indices);
  level.children.insert(level.children.end(), indices.begin(), indices.end());
}

void VqCodeBooks::rebuild(LevelName name, std::size_t first) {
  Level& level = levels_[name];
  const std::size_t values = level.shape.values();
  for (std::size_t row = first; row < level.size(); ++row) {
    float* luminance = level.rows.data() + row * values;
    float* chromaticity = luminance + level.shape.luminances;
    if (name == m) {
      const std::size_t pair = row * level.width;
      const float* from = levels_[p2].rows.data() + level.children[pair] * level.shape.luminances;
      std::copy(from, from + level.shape.luminances, luminance);
      if (chromaticities_ == 0) continue;
      from = levels_[i2].rows.data() + level.children[pair + 1] * level.shape.chromaticities;
      std::copy(from, from + level.shape.chromaticities, chromaticity);
      continue;
    }
    const LevelName below = name == p4   ? p3
                            : name == p3 ? m
                            : name == p2 ? p1
                            : name == i2 ? i1
                                         : c;
    const Level& parts = levels_[below];
    for (std::size_t n = 0; n < level.width; ++n) {
      const std::size_t at = row * level.width + n;
      const float* from = parts.rows.data() + level.children[at] * parts.shape.values();
      for (std::size_t i = 0; i < parts.shape.luminances; ++i) {
        *luminance++ = level.scales[at] * from[i];
      }
      from += parts.shape.luminances;
      chromaticity = std::copy(from, from + parts.shape.chromaticities, chromaticity);
    }
  }
}

void VqCodeBooks::add(const ScaledVectors& texels, const VqThresholds& thresholds,
                      NearestSearch& search) {
  std::array<std::size_t, level_count> before;
  for (std::size_t i = 0; i < level_count; ++i) {
    const bool there = levels_[i].shape.values() > 0;
    before[i] = there ? levels_[i].size() : 0;
  }
  const VectorShape& shape = levels_[p4].shape;
  std::vector<float> scales;
  for (std::size_t first = 0; first < texels.rows.size(); first += shape.values()) {
    scales.push_back(mean_magnitude(texels.rows.subspan(first, shape.luminances)));
  }
  std::vector<std::uint32_t> indices;
  enter(p4, {texels.rows, scales, texels.means, texels.deviations}, thresholds, search, indices);
  rebuild(p2, before[p2]);
  if (chromaticities_ > 0) {
    rebuild(i1, before[i1]);
    rebuild(i2, before[i2]);
  }
  for (const LevelName name : {m, p3, p4}) rebuild(name, before[name]);
}

void VqCodeBooks::fill(VqModel& model) const {
  const auto size = [&](LevelName name) {
    return levels_[name].shape.values() > 0 ? levels_[name].size() : 0;
  };
  model.grid = grid_;
  model.chromaticities = chromaticities_;
  model.sizes = {size(p1), size(p2), size(m), size(p3), size(p4), size(c), size(i1), size(i2)};
  model.p1 = levels_[p1].rows;
  model.p2 = {{levels_[p2].children, size(p1)}, levels_[p2].scales};
  model.m = {levels_[m].children, std::max(size(p2), size(i2))};
  model.p3 = {{levels_[p3].children, size(m)}, levels_[p3].scales};
  model.p4 = {{levels_[p4].children, size(p3)}, levels_[p4].scales};
  if (chromaticities_ == 0) return;
  model.c = levels_[c].rows;
  model.i1 = {levels_[i1].children, size(c)};
  model.i2 = {levels_[i2].children, size(i1)};
}

void VqCodeBooks::continue_from(const VqModel& model, int unit) {
  const auto begin = [&](LevelName name, std::size_t size, const PackedIndices& children,
                         std::span<const float> scales) {
    Level& level = levels_[name];
    level.children.assign(children.indices().begin(), children.indices().end());
    level.scales.assign(scales.begin(), scales.end());
    level.rows.resize(size * level.shape.values());
    bytes_ += level.rows.size() * sizeof(float);
  };
  const VqModel::Sizes& sizes = model.sizes;
  begin(p1, sizes.p1, {}, {});
  begin(p2, sizes.p2, model.p2.entries, model.p2.scales);
  begin(m, sizes.m, model.m, {});
  begin(p3, sizes.p3, model.p3.entries, model.p3.scales);
  begin(p4, sizes.p4, model.p4.entries, model.p4.scales);
  levels_[p1].rows = model.p1;
  if (chromaticities_ > 0) {
    begin(c, sizes.c, {}, {});
    begin(i1, sizes.i1, model.i1, {});
    begin(i2, sizes.i2, model.i2, {});
    for (std::size_t i = 0; i < model.c.size(); ++i) {
      levels_[c].rows[i] = static_cast<float>(std::ldexp(double{model.c[i]}, unit));
    }
  }
  check_bytes();
  rebuild(p2, 0);
  if (chromaticities_ > 0) {
    rebuild(i1, 0);
    rebuild(i2, 0);
  }
  for (const LevelName name : {m, p3, p4}) rebuild(name, 0);
}

}  // namespace weft
