#include "weft/model/tucker.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "weft/error.hpp"
#include "weft/model/coded_tensor.hpp"
#include "weft/model/divide.hpp"
#include "weft/model/group_tensors.hpp"
#include "weft/model/selected_indices.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

constexpr std::size_t core_axis = 0;    // of Z: slices of the first mode
constexpr std::size_t factor_axis = 1;  // of U_n [I_n][R_n]

std::string factor_name(const ModeGroup& group) {
  return "factor." + group.name;
}

// The dot product of a row of numbers with one of a factor. Several sums side by side do not wait
// for each other.
template <typename Number>
double dot(const Number* a, const float* u, std::size_t count) {
  constexpr std::size_t lanes = 8;
  std::array<double, lanes> sums{};
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    for (std::size_t k = 0; k < lanes; ++k) sums[k] += double{a[i + k]} * double{u[i + k]};
  }
  double sum = 0;
  for (const double part : sums) sum += part;
  for (; i < count; ++i) sum += double{a[i]} * double{u[i]};
  return sum;
}

// T x_n u of a row-major tensor T [outer][n][inner] and a row u of that mode's factor: a tensor
// [outer][inner].
template <typename Number>
std::vector<double> contract(std::span<const Number> T, std::size_t outer, std::span<const float> u,
                             std::size_t inner) {
  std::vector<double> rest(outer * inner, 0.0);
  for (std::size_t o = 0; o < outer; ++o) {
    const Number* slices = T.data() + o * u.size() * inner;
    if (inner == 1) {
      rest[o] = dot(slices, u.data(), u.size());
      continue;
    }
    double* sums = rest.data() + o * inner;
    for (std::size_t r = 0; r < u.size(); ++r) {
      for (std::size_t i = 0; i < inner; ++i) {
        sums[i] += double{u[r]} * double{slices[r * inner + i]};
      }
    }
  }
  return rest;
}

}  // namespace

void TuckerModel::set_groups(ModeGroups modes) {
  groups = std::move(modes);
  ranks = groups.sizes();
  factors.assign(groups.count(), {});
  group_of_modes_ = group_numbers(groups);
}

std::vector<ModelTensor> TuckerModel::tensors() const {
  std::vector<ModelTensor> list{
      {"modes", {mode_count}, DType::u8, std::as_bytes(std::span(group_of_modes_))},
      {"core", ranks, DType::f32, std::as_bytes(std::span(core)), core_axis}};
  for (std::size_t n = 0; n < groups.count(); ++n) {
    if (!has_factor(n)) continue;
    const ModeGroup& group = groups.groups()[n];
    list.push_back({factor_name(group),
                    {group.size, ranks[n]},
                    DType::f32,
                    std::as_bytes(std::span(factors[n])),
                    factor_axis});
  }
  return list;
}

std::vector<std::span<float>> TuckerModel::real_values() {
  std::vector<std::span<float>> list{core};
  for (std::size_t n = 0; n < groups.count(); ++n) {
    if (has_factor(n)) list.emplace_back(factors[n]);
  }
  return list;
}

// A mode's factors divide the rows of its U, or the slices of the core where it has none.
void TuckerModel::divide(const Weights& scale) {
  const auto divisors = group_divisors(groups, info.btf.shape, scale, "tucker");
  for (std::size_t n = 0; n < groups.count(); ++n) {
    const std::vector<double>& s = divisors[n];
    if (s.empty()) continue;
    if (has_factor(n)) {
      std::vector<float>& U = factors[n];
      for (std::size_t i = 0; i < U.size(); ++i) divide_by(U[i], s[i / ranks[n]]);
      continue;
    }
    const std::size_t inner = product(std::span(ranks).subspan(n + 1));
    for (std::size_t i = 0; i < core.size(); ++i) divide_by(core[i], s[i / inner % ranks[n]]);
  }
}

void TuckerModel::fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                               std::span<double> out) const {
  const std::size_t channels = info.btf.shape.channels;
  const std::size_t channel = groups.group_of(Mode::channel);
  if (!channels_alone()) {
    for (std::size_t c = 0; c < channels; ++c) {
      out[c] = contracted({view, light, y, x, c}).front();
    }
    return;
  }
  const std::vector<double> left = contracted({view, light, y, x, 0});
  for (std::size_t c = 0; c < channels; ++c) {
    out[c] = has_factor(channel)
                 ? dot(left.data(), factors[channel].data() + c * left.size(), left.size())
                 : left[c];
  }
}

bool TuckerModel::channels_alone() const {
  return groups.groups()[groups.group_of(Mode::channel)].modes.size() == 1;
}

// The largest ranks first: they leave the least behind.
std::vector<std::size_t> TuckerModel::contraction_order() const {
  std::vector<std::size_t> order;
  for (std::size_t n = 0; n < groups.count(); ++n) {
    const bool channel = channels_alone() && n == groups.group_of(Mode::channel);
    if (has_factor(n) && !channel) order.push_back(n);
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return ranks[a] > ranks[b]; });
  return order;
}

std::vector<double> TuckerModel::contracted(const std::array<std::size_t, mode_count>& at) const {
  std::vector<std::size_t> indices(groups.count(), 0);
  for (const Mode mode : all_modes) {
    indices[groups.group_of(mode)] += at[index_of(mode)] * groups.stride(mode);
  }
  // Of modes without a factor, their one slice of the core.
  std::vector<std::size_t> sizes = ranks;
  for (std::size_t n = 0; n < groups.count(); ++n) {
    const bool alone = channels_alone() && n == groups.group_of(Mode::channel);
    if (!has_factor(n) && !alone) sizes[n] = 1;
  }
  std::vector<float> slices;
  if (sizes != ranks) {
    std::vector<std::size_t> places{0};
    for (std::size_t n = 0; n < groups.count(); ++n) {
      const std::size_t begin = sizes[n] == ranks[n] ? 0 : indices[n];
      std::vector<std::size_t> further;
      further.reserve(places.size() * sizes[n]);
      for (const std::size_t place : places) {
        for (std::size_t r = 0; r < sizes[n]; ++r) {
          further.push_back(place * ranks[n] + begin + r);
        }
      }
      places = std::move(further);
    }
    for (const std::size_t place : places) slices.push_back(core[place]);
  }
  const std::span<const float> first = slices.empty() ? std::span(core) : std::span(slices);

  std::vector<double> rest;
  for (const std::size_t n : contraction_order()) {
    const std::size_t outer = product(std::span(sizes).first(n));
    const std::size_t inner = product(std::span(sizes).subspan(n + 1));
    const auto u = std::span(factors[n]).subspan(indices[n] * ranks[n], ranks[n]);
    rest = rest.empty() ? contract(first, outer, u, inner)
                        : contract(std::span<const double>(rest), outer, u, inner);
    sizes[n] = 1;
  }
  return rest.empty() ? std::vector<double>(first.begin(), first.end()) : rest;
}

std::size_t TuckerModel::coefficients() const {
  std::size_t sum = core.size();
  for (const std::vector<float>& factor : factors) sum += factor.size();
  return sum;
}

// Channels that are no mode of their own are decoded one by one; else they come last, all from one
// vector.
std::size_t TuckerModel::texel_operations() const {
  const std::size_t channels = info.btf.shape.channels;
  const std::size_t channel = groups.group_of(Mode::channel);
  const std::vector<std::size_t> order = contraction_order();
  std::size_t values = channels_alone() ? ranks[channel] : 1;  // left where all are contracted
  std::size_t operations = 0;
  for (auto n = order.rbegin(); n != order.rend(); ++n) {
    operations += values * (2 * ranks[*n] - 1);
    values *= ranks[*n];
  }
  if (!channels_alone()) return operations * channels;
  return operations + (has_factor(channel) ? channels * (2 * ranks[channel] - 1) : 0);
}

std::unique_ptr<TuckerModel> TuckerModel::select(const Selection& selection) const {
  Selection part = selection;
  part.level = 0;
  auto model = std::make_unique<TuckerModel>();
  model->info = selected_info(info, part);
  model->set_groups(ModeGroups(model->info.btf.shape, groups.merge()));
  model->core = core;

  const std::vector<std::vector<std::size_t>> kept = kept_rows(groups, info.btf.shape, part);
  std::vector<std::size_t> sizes = ranks;  // of the core so far
  for (std::size_t n = 0; n < groups.count(); ++n) {
    const std::vector<std::size_t>& rows = kept[n];
    if (has_factor(n)) {
      model->factors[n] = take_rows(factors[n], 1, groups.groups()[n].size, ranks[n], rows);
      model->ranks[n] = ranks[n];
      continue;
    }
    const std::size_t outer = product(std::span(sizes).first(n));
    const std::size_t inner = product(std::span(sizes).subspan(n + 1));
    model->core = take_rows(model->core, outer, sizes[n], inner, rows);
    sizes[n] = rows.size();
    model->ranks[n] = sizes[n];
  }
  return model;
}

std::unique_ptr<TuckerModel> TuckerModel::read(const ModelFile& file) {
  if (file.info().codec != "tucker") {
    file.reject("metadata \"codec\": \"" + file.info().codec + "\" instead of \"tucker\"");
  }
  auto model = std::make_unique<TuckerModel>();
  model->info = file.info();
  model->set_groups(read_groups(file));

  // The core's shape says the ranks; a mode without a factor is as long as the tensor.
  const std::vector<std::size_t> found = tensor_shape(file, "core");
  if (found.size() != model->groups.count()) {
    file.reject("tensor \"core\": shape " + shape_text(found) + " has not one size per mode");
  }
  for (std::size_t n = 0; n < found.size(); ++n) {
    const ModeGroup& group = model->groups.groups()[n];
    const std::string name = factor_name(group);
    if (found[n] == 0) file.reject("tensor \"core\": shape " + shape_text(found) + " holds a 0");
    model->ranks[n] = found[n];
    if (!file.has(name)) {
      if (found[n] != group.size) {
        file.reject("tensor \"core\": shape " + shape_text(found) + ", but there is no tensor \"" +
                    name + "\" for mode " + group.name + " of size " + std::to_string(group.size));
      }
      continue;
    }
    model->factors[n] = file.real_tensor(name, {group.size, found[n]}, factor_axis);
  }
  model->core = file.real_tensor("core", found, core_axis);
  return model;
}

}  // namespace weft
