#include "weft/model/tt.hpp"

#include <algorithm>

#include "weft/btf/mip.hpp"
#include "weft/error.hpp"
#include "weft/model/coded_tensor.hpp"
#include "weft/model/divide.hpp"
#include "weft/model/selected_indices.hpp"

namespace weft {
namespace {

constexpr std::size_t last = mode_count - 1;

// The scale goes with the bond that a core shares with its neighbour to the right; the last core
// has none there.
constexpr std::size_t component_axis(std::size_t n) {
  return n == last ? 0 : 2;
}

// Row vector times the slice i of a core, [R_{n-1}, I_n, R_n].
std::vector<double> times_slice(const std::vector<double>& u, const std::vector<float>& core,
                                std::size_t size, std::size_t i, std::size_t right) {
  std::vector<double> out(right, 0.0);
  for (std::size_t a = 0; a < u.size(); ++a) {
    const float* row = core.data() + (a * size + i) * right;
    for (std::size_t b = 0; b < right; ++b) out[b] += u[a] * double{row[b]};
  }
  return out;
}

// The slice i of a core times a column vector.
std::vector<double> slice_times(const std::vector<float>& core, std::size_t size, std::size_t i,
                                std::size_t left, const std::vector<double>& w) {
  std::vector<double> out(left, 0.0);
  for (std::size_t a = 0; a < left; ++a) {
    const float* row = core.data() + (a * size + i) * w.size();
    for (std::size_t b = 0; b < w.size(); ++b) out[a] += double{row[b]} * w[b];
  }
  return out;
}

}  // namespace

std::size_t TtModel::position(Mode mode) const {
  return static_cast<std::size_t>(std::find(order.begin(), order.end(), mode) - order.begin());
}

std::size_t TtModel::coefficients() const {
  std::size_t sum = 0;
  for (const std::vector<float>& core : cores) sum += core.size();
  return sum;
}

std::vector<std::size_t> TtModel::core_shape(std::size_t n) const {
  return {ranks[n], size(n), ranks[n + 1]};
}

std::string TtModel::core_name(std::size_t n) const {
  return "core." + std::string(name_of(order[n]));
}

std::vector<ModelTensor> TtModel::tensors() const {
  std::vector<ModelTensor> list;
  list.push_back({"order", {mode_count}, DType::u8, std::as_bytes(std::span(order))});
  for (std::size_t n = 0; n < mode_count; ++n) {
    list.push_back({core_name(n), core_shape(n), DType::f32, std::as_bytes(std::span(cores[n])),
                    component_axis(n), stored[n]});
  }
  return list;
}

std::vector<std::span<float>> TtModel::real_values() {
  return {cores.begin(), cores.end()};
}

void TtModel::divide(const Weights& factors) {
  const BtfShape& shape = info.btf.shape;
  const auto split = rows_and_columns(factors.texels, shape.height, shape.width);
  if (!split) fail_runtime("tt: texel factors are no products of those of rows and columns");
  const std::array<const std::vector<double>*, mode_count> lists{
      &factors.views, &factors.lights, &split->first, &split->second, nullptr};
  for (std::size_t n = 0; n < mode_count; ++n) {
    const std::vector<double>* s = lists[index_of(order[n])];
    if (s == nullptr || s->empty()) continue;
    for (std::size_t i = 0; i < cores[n].size(); ++i) {
      divide_by(cores[n][i], (*s)[i / ranks[n + 1] % size(n)]);
    }
  }
}

void TtModel::fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                           std::span<double> out) const {
  const std::array<std::size_t, mode_count> indices{view, light, y, x, 0};
  const auto index = [&](std::size_t n) { return indices[index_of(order[n])]; };
  const std::size_t channel = position(Mode::channel);
  // u from the left of the channels' core, w from its right
  std::vector<double> u{1.0};
  for (std::size_t n = 0; n < channel; ++n) {
    u = times_slice(u, cores[n], size(n), index(n), ranks[n + 1]);
  }
  std::vector<double> w{1.0};
  for (std::size_t n = last; n > channel; --n) {
    w = slice_times(cores[n], size(n), index(n), ranks[n], w);
  }
  for (std::size_t c = 0; c < size(channel); ++c) {
    const std::vector<double> row =
        times_slice(u, cores[channel], size(channel), c, ranks[channel + 1]);
    out[c] = 0;
    for (std::size_t b = 0; b < row.size(); ++b) out[c] += row[b] * w[b];
  }
}

std::size_t TtModel::texel_operations() const {
  // A vector of n times a matrix n x m takes (2 n - 1) m; the outermost cores are only read.
  const std::size_t channel = position(Mode::channel);
  std::size_t sum = 0;
  for (std::size_t n = 1; n < channel; ++n) sum += (2 * ranks[n] - 1) * ranks[n + 1];
  for (std::size_t n = last; n-- > channel + 1;) sum += (2 * ranks[n + 1] - 1) * ranks[n];
  std::size_t each = 0;
  if (channel > 0) each += (2 * ranks[channel] - 1) * ranks[channel + 1];
  if (channel < last) each += 2 * ranks[channel + 1] - 1;
  return sum + size(channel) * each;
}

std::unique_ptr<TtModel> TtModel::select(const Selection& selection) const {
  Selection part = selection;
  part.level = 0;
  auto model = std::make_unique<TtModel>();
  model->info = selected_info(info, part);
  model->order = order;
  model->ranks = ranks;
  model->stored = stored;

  const SelectedIndices indices = selected_indices(info.btf.shape, part);
  const Region region =
      part.region.value_or(Region{0, 0, info.btf.shape.width, info.btf.shape.height});
  std::vector<std::size_t> rows(region.height);
  std::vector<std::size_t> columns(region.width);
  for (std::size_t y = 0; y < rows.size(); ++y) rows[y] = region.y + y;
  for (std::size_t x = 0; x < columns.size(); ++x) columns[x] = region.x + x;
  const std::array<const std::vector<std::size_t>*, mode_count> kept{
      &indices.views, &indices.lights, &rows, &columns, &indices.channels};
  for (std::size_t n = 0; n < mode_count; ++n) {
    const std::vector<std::size_t>& slices = *kept[index_of(order[n])];
    std::vector<float>& core = model->cores[n];
    core.reserve(ranks[n] * slices.size() * ranks[n + 1]);
    for (std::size_t a = 0; a < ranks[n]; ++a) {
      for (const std::size_t i : slices) {
        const auto row =
            cores[n].begin() + static_cast<std::ptrdiff_t>((a * size(n) + i) * ranks[n + 1]);
        core.insert(core.end(), row, row + static_cast<std::ptrdiff_t>(ranks[n + 1]));
      }
    }
  }
  // Rounded values stay as they are under any scale that holds them.
  return model;
}

std::unique_ptr<TtModel> TtModel::next_mip_level() const {
  if (info.btf.encoding != Encoding::linear) return nullptr;
  auto model = std::make_unique<TtModel>();
  Selection half;
  half.level = 1;
  model->info = selected_info(info, half);
  model->order = order;
  model->ranks = ranks;
  model->stored = stored;
  model->cores = cores;
  for (const Mode mode : {Mode::row, Mode::column}) {
    // A core is [R_{n-1}][I_n][R_n]: images of one column, or one row, of R_n channels.
    const std::size_t n = position(mode);
    const std::size_t slice = size(n) * ranks[n + 1];
    std::vector<float>& core = model->cores[n];
    core.clear();
    for (std::size_t a = 0; a < ranks[n]; ++a) {
      const auto begin = cores[n].begin() + static_cast<std::ptrdiff_t>(a * slice);
      std::vector<float> part(begin, begin + static_cast<std::ptrdiff_t>(slice));
      part.resize(average_mip(part, size(n), 1, ranks[n + 1], 1));
      core.insert(core.end(), part.begin(), part.end());
    }
  }
  return model;
}

std::unique_ptr<TtModel> TtModel::read(const ModelFile& file) {
  if (file.info().codec != "tt") {
    file.reject("metadata \"codec\": \"" + file.info().codec + "\" instead of \"tt\"");
  }
  auto model = std::make_unique<TtModel>();
  model->info = file.info();

  const std::vector<std::uint32_t> order = file.index_tensor("order", {mode_count}, mode_count);
  std::array<bool, mode_count> seen{};
  for (std::size_t n = 0; n < mode_count; ++n) {
    if (seen[order[n]]) {
      file.reject("tensor \"order\": mode " + std::to_string(order[n]) + " twice");
    }
    seen[order[n]] = true;
    model->order[n] = all_modes[order[n]];
  }
  // Each core's left rank is its neighbour's right one; none is zero.
  for (std::size_t n = 0; n < mode_count; ++n) {
    const std::string name = model->core_name(n);
    const std::vector<std::size_t> found = tensor_shape(file, name);
    if (found.size() != 3 || found[2] == 0 || (n == last && found[2] != 1)) {
      file.reject("tensor \"" + name + "\": shape " + shape_text(found) +
                  (n == last ? " instead of [R, I, 1]" : " instead of [R, I, R']"));
    }
    model->ranks[n + 1] = found[2];
    model->stored[n] = file.storage_of(name);
    model->cores[n] =
        file.real_tensor(name, model->core_shape(n), component_axis(n), model->stored[n]);
  }
  return model;
}

}  // namespace weft
