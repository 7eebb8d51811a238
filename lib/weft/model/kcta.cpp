#include "weft/model/kcta.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include "weft/btf/view_grid.hpp"
#include "weft/error.hpp"
#include "weft/model/coded_tensor.hpp"
#include "weft/model/divide.hpp"
#include "weft/model/group_tensors.hpp"
#include "weft/model/selected_indices.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

constexpr std::size_t cores_axis = 0;   // of Z: its clusters
constexpr std::size_t mixing_axis = 2;  // of [I_m][K][R_m]
constexpr std::size_t global_axis = 1;  // of U_n [I_n][R_n]
constexpr std::size_t local_axis = 2;   // of U_n,c [C][I_n][R_n]

constexpr const char* grid_clusters_name = "grid.clusters";
constexpr const char* grid_mixing_name = "grid.mixing";

std::string global_name(const ModeGroup& group) {
  return "global." + group.name;
}
std::string local_name(const ModeGroup& group) {
  return "factor." + group.name;
}

// Clusters [..][mixtures] of slices ascend.
void check_ascending(const ModelFile& file, std::string_view tensor, std::size_t mixtures,
                     std::span<const std::uint32_t> numbers) {
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (i % mixtures > 0 && numbers[i] <= numbers[i - 1]) {
      file.reject("tensor \"" + std::string(tensor) + "\": those of slice " +
                  std::to_string(i / mixtures) + " do not ascend");
    }
  }
}

}  // namespace

void KctaModel::set_groups(ModeGroups modes, std::size_t clustered) {
  groups = std::move(modes);
  mode = clustered;
  clustered_ = static_cast<std::uint8_t>(clustered);
  ranks = groups.sizes();
  global.assign(groups.count(), {});
  local.assign(groups.count(), {});
  group_of_modes_ = group_numbers(groups);
}

std::vector<std::size_t> KctaModel::other_ranks() const {
  std::vector<std::size_t> others = ranks;
  others.erase(others.begin() + static_cast<std::ptrdiff_t>(mode));
  return others;
}

std::size_t KctaModel::core_row() const {
  return product(other_ranks());
}

std::vector<std::size_t> KctaModel::cores_shape() const {
  std::vector<std::size_t> shape = other_ranks();
  shape.insert(shape.begin(), {clusters, ranks[mode]});
  return shape;
}

std::vector<std::size_t> KctaModel::mixing_shape() const {
  return {slices(), mixtures, ranks[mode]};
}

std::span<const float> KctaModel::factor(std::size_t n, std::size_t cluster) const {
  if (!global[n].empty()) return global[n];
  if (local[n].empty()) return {};
  const std::size_t values = groups.groups()[n].size * ranks[n];
  return std::span(local[n]).subspan(cluster * values, values);
}

std::size_t KctaModel::member(std::size_t slice, std::size_t k) const {
  return slice < slices() ? members[slice * mixtures + k]
                          : grid_members[(slice - slices()) * mixtures + k];
}

std::span<const float> KctaModel::mixing_row(std::size_t slice, std::size_t k) const {
  const std::vector<float>& rows = slice < slices() ? mixing : grid_mixing;
  const std::size_t row = slice < slices() ? slice : slice - slices();
  return std::span(rows).subspan((row * mixtures + k) * ranks[mode], ranks[mode]);
}

bool KctaModel::clusters_views() const {
  const ModeGroup& group = groups.groups()[mode];
  return group.modes.size() == 1 && group.has(Mode::view);
}

std::vector<ModelTensor> KctaModel::tensors() const {
  std::vector<ModelTensor> list{
      {"modes", {mode_count}, DType::u8, std::as_bytes(std::span(group_of_modes_))},
      {"clustered", {1}, DType::u8, std::as_bytes(std::span(&clustered_, 1))},
      {"clusters", {slices(), mixtures}, members.dtype(), members.bytes()},
      {"mixing", mixing_shape(), DType::f32, std::as_bytes(std::span(mixing)), mixing_axis},
      {"cores", cores_shape(), DType::f32, std::as_bytes(std::span(cores)), cores_axis}};
  for (std::size_t n = 0; n < groups.count(); ++n) {
    const ModeGroup& group = groups.groups()[n];
    if (!global[n].empty()) {
      list.push_back({global_name(group),
                      {group.size, ranks[n]},
                      DType::f32,
                      std::as_bytes(std::span(global[n])),
                      global_axis});
    }
    if (!local[n].empty()) {
      list.push_back({local_name(group),
                      {clusters, group.size, ranks[n]},
                      DType::f32,
                      std::as_bytes(std::span(local[n])),
                      local_axis});
    }
  }
  if (grid_side > 0) {
    const std::size_t views = grid_side * grid_side;
    list.push_back(
        {grid_clusters_name, {views, mixtures}, grid_members.dtype(), grid_members.bytes()});
    list.push_back({grid_mixing_name,
                    {views, mixtures, ranks[mode]},
                    DType::f32,
                    std::as_bytes(std::span(grid_mixing)),
                    mixing_axis});
  }
  return list;
}

bool KctaModel::channels_alone() const {
  const std::size_t group = groups.group_of(Mode::channel);
  return groups.groups()[group].modes.size() == 1 && group != mode;
}

std::vector<std::span<float>> KctaModel::real_values() {
  std::vector<std::span<float>> list{mixing, cores};
  for (std::size_t n = 0; n < groups.count(); ++n) {
    if (!global[n].empty()) list.emplace_back(global[n]);
    if (!local[n].empty()) list.emplace_back(local[n]);
  }
  if (grid_side > 0) list.emplace_back(grid_mixing);
  return list;
}

// A mode's factors divide the rows of its U, those of the mixing matrix for the clustered mode, or
// the slices of the cores where it has none. Views of a grid are what is interpolated of the fitted
// views over what is interpolated of their factors, which stays between the measured ones.
void KctaModel::divide(const Weights& scale) {
  const auto divisors = group_divisors(groups, info.btf.shape, scale, info.codec);
  for (std::size_t n = 0; n < groups.count(); ++n) {
    const std::vector<double>& s = divisors[n];
    if (s.empty()) continue;
    if (n == mode) {
      const std::size_t row = mixtures * ranks[mode];
      for (std::size_t i = 0; i < mixing.size(); ++i) divide_by(mixing[i], s[i / row]);
      if (grid_side == 0) continue;
      const auto [least, most] = std::minmax_element(s.begin(), s.end());
      const ViewResampling views(info.btf.view_directions, grid_side);
      for (std::size_t e = 0; e < views.size(); ++e) {
        const std::vector<double> w = views.weights(e);
        const double between = std::inner_product(w.begin(), w.end(), s.begin(), 0.0);
        for (float& u : std::span(grid_mixing).subspan(e * row, row)) {
          divide_by(u, std::clamp(between, *least, *most));
        }
      }
    } else if (has_factor(n)) {
      for (std::vector<float>* U : {&global[n], &local[n]}) {
        for (std::size_t i = 0; i < U->size(); ++i) {
          divide_by((*U)[i], s[i / ranks[n] % s.size()]);
        }
      }
    } else {
      std::size_t inner = 1;
      for (std::size_t m = n + 1; m < groups.count(); ++m) inner *= m == mode ? 1 : ranks[m];
      for (std::size_t i = 0; i < cores.size(); ++i) divide_by(cores[i], s[i / inner % ranks[n]]);
    }
  }
}

void KctaModel::fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                             std::span<double> out) const {
  if (channels_alone()) {
    const std::vector<double> values = mixed({view, light, y, x, 0});
    std::copy(values.begin(), values.end(), out.begin());
    return;
  }
  for (std::size_t c = 0; c < info.btf.shape.channels; ++c) {
    out[c] = mixed({view, light, y, x, c}).front();
  }
}

std::vector<double> KctaModel::mixed(const std::array<std::size_t, mode_count>& at) const {
  std::vector<std::size_t> indices(groups.count(), 0);
  for (const Mode one : all_modes) {
    indices[groups.group_of(one)] += at[index_of(one)] * groups.stride(one);
  }
  const std::size_t row = core_row();
  std::vector<double> values;
  for (std::size_t k = 0; k < mixtures; ++k) {
    const std::size_t c = member(indices[mode], k);
    // Z_c x_m (U_m,c)_i*, and then the other modes, the last first
    std::vector<double> T(row, 0.0);
    const std::span<const float> u = mixing_row(indices[mode], k);
    for (std::size_t r = 0; r < u.size(); ++r) {
      const float* slice = cores.data() + (c * u.size() + r) * row;
      for (std::size_t i = 0; i < row; ++i) T[i] += double{u[r]} * double{slice[i]};
    }
    std::size_t inner = 1;
    for (std::size_t n = groups.count(); n-- > 0;) {
      if (n == mode) continue;
      const std::size_t outer = T.size() / ranks[n] / inner;
      T = contracted(T, outer, inner, n, c, indices[n]);
      inner = T.size() / outer;
    }
    if (values.empty()) values.resize(T.size(), 0.0);
    for (std::size_t i = 0; i < T.size(); ++i) values[i] += T[i];
  }
  return values;
}

std::vector<double> KctaModel::contracted(const std::vector<double>& T, std::size_t outer,
                                          std::size_t inner, std::size_t n, std::size_t cluster,
                                          std::size_t row) const {
  const bool all = channels_alone() && n == groups.group_of(Mode::channel);
  const std::size_t first = all ? 0 : row;
  const std::size_t rows = all ? groups.groups()[n].size : 1;
  const std::span<const float> U = factor(n, cluster);
  const std::size_t rank = ranks[n];
  std::vector<double> rest(outer * rows * inner, 0.0);
  for (std::size_t o = 0; o < outer; ++o) {
    for (std::size_t j = 0; j < rows; ++j) {
      double* sums = rest.data() + (o * rows + j) * inner;
      for (std::size_t r = 0; r < rank; ++r) {
        const double u = U.empty() ? (r == first + j ? 1.0 : 0.0) : U[(first + j) * rank + r];
        if (u == 0) continue;
        const double* slice = T.data() + (o * rank + r) * inner;
        for (std::size_t i = 0; i < inner; ++i) sums[i] += u * slice[i];
      }
    }
  }
  return rest;
}

std::unique_ptr<TuckerModel> KctaModel::cluster(std::size_t c) const {
  auto model = std::make_unique<TuckerModel>();
  model->info = info;
  model->info.errors.reset();  // they were measured of all clusters together
  model->set_groups(groups);
  model->ranks = ranks;
  for (std::size_t n = 0; n < groups.count(); ++n) {
    const std::span<const float> U = factor(n, c);
    model->factors[n].assign(U.begin(), U.end());
  }
  const std::size_t rank = ranks[mode];
  std::vector<float>& U_m = model->factors[mode];
  U_m.assign(slices() * rank, 0.0f);
  for (std::size_t i = 0; i < members.size(); ++i) {
    if (members[i] != c) continue;
    const std::span<const float> row = mixing_row(i / mixtures, i % mixtures);
    std::copy(row.begin(), row.end(),
              U_m.begin() + static_cast<std::ptrdiff_t>(i / mixtures * rank));
  }
  // [R_m][outer][inner] -> [outer][R_m][inner]
  const std::size_t outer = product(std::span(ranks).first(mode));
  const std::size_t inner = product(std::span(ranks).subspan(mode + 1));
  model->core = FloatStore(rank * outer * inner);
  const float* Z = cores.data() + c * rank * outer * inner;
  for (std::size_t r = 0; r < rank; ++r) {
    for (std::size_t o = 0; o < outer; ++o, Z += inner) {
      std::copy_n(Z, inner, model->core.data() + (o * rank + r) * inner);
    }
  }
  return model;
}

// Of each of K clusters: the row of mixing coefficients, then the other modes from the last on.
std::size_t KctaModel::texel_operations() const {
  std::size_t left = core_row();
  std::size_t operations = left * (2 * ranks[mode] - 1);
  std::size_t kept = 1;  // of channels that stand alone
  for (std::size_t n = groups.count(); n-- > 0;) {
    if (n == mode) continue;
    const bool channel = channels_alone() && n == groups.group_of(Mode::channel);
    const std::size_t rows = channel ? info.btf.shape.channels : 1;
    left /= ranks[n];
    if (has_factor(n)) operations += left * kept * rows * (2 * ranks[n] - 1);
    kept *= rows;
  }
  const std::size_t repeats = channels_alone() ? 1 : info.btf.shape.channels;
  return repeats * (mixtures * operations + (mixtures - 1) * kept);
}

std::unique_ptr<KctaModel> KctaModel::select(const Selection& selection) const {
  Selection part = selection;
  part.level = 0;
  auto model = std::make_unique<KctaModel>();
  model->info = selected_info(info, part);
  model->set_groups(ModeGroups(model->info.btf.shape, groups.merge()), mode);
  model->mixtures = mixtures;
  const std::vector<std::vector<std::size_t>> kept = kept_rows(groups, info.btf.shape, part);

  // slices, and clusters in their old order, without those that are no longer used
  constexpr std::uint32_t unused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> number(clusters, unused);
  for (const std::size_t i : kept[mode]) {
    for (std::size_t k = 0; k < mixtures; ++k) number[member(i, k)] = 0;
  }
  // a grid is of all views, in their order: of some it would show what the others have
  bool keeps_grid = grid_side > 0 && kept[mode].size() == slices();
  for (std::size_t i = 0; i < kept[mode].size(); ++i) keeps_grid = keeps_grid && kept[mode][i] == i;
  for (std::size_t i = 0; keeps_grid && i < grid_members.size(); ++i) number[grid_members[i]] = 0;
  std::vector<std::size_t> used;
  for (std::size_t c = 0; c < clusters; ++c) {
    if (number[c] == unused) continue;
    number[c] = static_cast<std::uint32_t>(used.size());
    used.push_back(c);
  }
  model->clusters = used.size();
  std::vector<std::uint32_t> numbers;
  for (const std::size_t i : kept[mode]) {
    for (std::size_t k = 0; k < mixtures; ++k) {
      numbers.push_back(number[member(i, k)]);
    }
  }
  model->members = IndexTensor(numbers, used.size());
  if (keeps_grid) {
    model->grid_side = grid_side;
    model->grid_mixing = grid_mixing;
    numbers.clear();
    for (std::size_t i = 0; i < grid_members.size(); ++i) {
      numbers.push_back(number[grid_members[i]]);
    }
    model->grid_members = IndexTensor(numbers, used.size());
  }
  model->mixing = take_rows(mixing, 1, slices(), mixtures * ranks[mode], kept[mode]);

  model->cores = take_rows(cores, 1, clusters, ranks[mode] * core_row(), used);
  std::vector<std::size_t> sizes = cores_shape();  // of the cores so far
  sizes[0] = used.size();
  std::size_t axis = 2;
  model->ranks[mode] = ranks[mode];
  for (std::size_t n = 0; n < groups.count(); ++n) {
    if (n == mode) continue;
    const std::size_t size = groups.groups()[n].size;
    if (has_factor(n)) {
      if (!global[n].empty()) model->global[n] = take_rows(global[n], 1, size, ranks[n], kept[n]);
      if (!local[n].empty()) {
        const std::vector<float> of_used = take_rows(local[n], 1, clusters, size * ranks[n], used);
        model->local[n] = take_rows(of_used, used.size(), size, ranks[n], kept[n]);
      }
      model->ranks[n] = ranks[n];
    } else {
      const std::size_t outer = product(std::span(sizes).first(axis));
      const std::size_t inner = product(std::span(sizes).subspan(axis + 1));
      model->cores = take_rows(model->cores, outer, sizes[axis], inner, kept[n]);
      sizes[axis] = kept[n].size();
      model->ranks[n] = sizes[axis];
    }
    ++axis;
  }
  return model;
}

std::unique_ptr<KctaModel> KctaModel::read(const ModelFile& file) {
  const std::string& codec = file.info().codec;
  if (codec != "kcta" && codec != "cta") {
    file.reject("metadata \"codec\": \"" + codec + "\" instead of \"kcta\" or \"cta\"");
  }
  auto model = std::make_unique<KctaModel>();
  model->info = file.info();
  ModeGroups groups = read_groups(file);
  const std::uint32_t mode = file.index_tensor("clustered", {1}, groups.count())[0];
  model->set_groups(std::move(groups), mode);

  // The cores' shape says clusters and ranks, that of `clusters` the mixtures.
  const std::vector<std::size_t> found = tensor_shape(file, "cores");
  if (found.size() != model->groups.count() + 1) {
    file.reject("tensor \"cores\": shape " + shape_text(found) +
                " has not the clusters and one size per mode");
  }
  if (std::find(found.begin(), found.end(), std::size_t{0}) != found.end()) {
    file.reject("tensor \"cores\": shape " + shape_text(found) + " holds a 0");
  }
  model->clusters = found[0];
  const std::vector<std::size_t> listed = tensor_shape(file, "clusters");
  if (listed.size() != 2 || listed[1] == 0 || listed[1] > model->clusters) {
    file.reject("tensor \"clusters\": shape " + shape_text(listed) + " instead of [" +
                std::to_string(model->slices()) + ", K] with K from 1 to " +
                std::to_string(model->clusters));
  }
  if (codec == "cta" && listed[1] != 1) {
    file.reject("tensor \"clusters\": " + std::to_string(listed[1]) +
                " clusters for each slice, codec cta has one");
  }
  model->mixtures = listed[1];
  const std::vector<std::uint32_t> numbers =
      file.index_tensor("clusters", {model->slices(), model->mixtures}, model->clusters);
  check_ascending(file, "clusters", model->mixtures, numbers);
  model->members = IndexTensor(numbers, model->clusters);

  model->ranks[mode] = found[1];
  std::size_t axis = 2;
  for (std::size_t n = 0; n < model->groups.count(); ++n) {
    if (n == mode) continue;
    const ModeGroup& group = model->groups.groups()[n];
    const std::size_t rank = found[axis++];
    model->ranks[n] = rank;
    const bool of_all = file.has(global_name(group));
    const bool of_each = file.has(local_name(group));
    if (of_all && of_each) {
      file.reject("tensors \"" + global_name(group) + "\" and \"" + local_name(group) +
                  "\": mode " + group.name + " has one of them");
    }
    if (of_all) {
      model->global[n] = file.real_tensor(global_name(group), {group.size, rank}, global_axis);
    } else if (of_each) {
      model->local[n] =
          file.real_tensor(local_name(group), {model->clusters, group.size, rank}, local_axis);
    } else if (rank != group.size) {
      file.reject("tensor \"cores\": shape " + shape_text(found) +
                  ", but there is no factor for mode " + group.name + " of size " +
                  std::to_string(group.size));
    }
  }
  model->mixing = file.real_tensor("mixing", model->mixing_shape(), mixing_axis);
  model->cores = file.real_tensor("cores", found, cores_axis);
  if (file.has(grid_clusters_name)) model->read_grid(file);
  return model;
}

void KctaModel::read_grid(const ModelFile& file) {
  const std::string tensor = std::string("tensor \"") + grid_clusters_name + "\": ";
  if (!clusters_views()) {
    file.reject(tensor + "a grid of views, but clusters are of mode " + groups.groups()[mode].name);
  }
  const std::vector<std::size_t> found = tensor_shape(file, grid_clusters_name);
  const std::size_t views = found.empty() ? 0 : found[0];
  std::size_t side = 1;
  while (side * side < views && side < most_grid_side) ++side;
  if (side * side != views) {
    file.reject(tensor + "shape " + shape_text(found) + " is not N N views, N from 1 to " +
                std::to_string(most_grid_side));
  }
  grid_side = side;
  const std::vector<std::uint32_t> numbers =
      file.index_tensor(grid_clusters_name, {views, mixtures}, clusters);
  check_ascending(file, grid_clusters_name, mixtures, numbers);
  grid_members = IndexTensor(numbers, clusters);
  grid_mixing = file.real_tensor(grid_mixing_name, {views, mixtures, ranks[mode]}, mixing_axis);
}

}  // namespace weft
