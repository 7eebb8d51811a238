// The tensors of nested code-books, and their way out of a file.
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#include "weft/btf/mip.hpp"
#include "weft/model/vq.hpp"

namespace weft {
namespace {

constexpr std::size_t no_axis = ModelTensor::no_component_axis;
// Of the grid, and of the code-books' sizes, which follow for each time that some were added.
constexpr std::size_t grid_words = 6;
constexpr std::size_t size_words = 8;
// More levels than any image has, and more additions than a file takes.
constexpr std::size_t most_levels = 64;
constexpr std::size_t most_parts = 65536;

std::array<std::size_t, size_words> words_of(const VqModel::Sizes& s) {
  return {s.p1, s.p2, s.m, s.p3, s.p4, s.c, s.i1, s.i2};
}

VqModel::Sizes sizes_of(std::span<const std::uint32_t> words) {
  return {words[0], words[1], words[2], words[3], words[4], words[5], words[6], words[7]};
}

std::string level_name(std::string_view tensor, std::size_t level) {
  return level == 0 ? std::string(tensor) : fmt::format("{}.level{}", tensor, level);
}

std::string part_name(std::string_view tensor, std::size_t part) {
  return part == 0 ? std::string(tensor) : fmt::format("{}.part{}", tensor, part);
}

// A code-book's reals: rows of a width, and how many of them there were after each addition.
template <typename Floats>
struct RealRows {
  std::string_view name;
  std::size_t width = 0;
  Floats* values = nullptr;
  std::vector<std::size_t> ends;
};

// Calls visit(rows, part, first row, rows of the part) for the parts that hold any.
template <typename Rows, typename Visit>
void for_parts(const std::vector<Rows>& list, const Visit& visit) {
  for (const Rows& rows : list) {
    std::size_t first = 0;
    for (std::size_t part = 0; part < rows.ends.size(); ++part) {
      const std::size_t count = rows.ends[part] - first;
      if (count > 0) visit(rows, part, first, count);
      first += count;
    }
  }
}

// Those of a model, const or not, in the order of their tensors.
template <typename AnyModel>
auto real_rows(AnyModel& model) {
  using Floats = std::remove_reference_t<decltype((model.p1))>;
  const OnionSizes& n = model.grid.sizes;
  std::vector<RealRows<Floats>> list;
  const auto add = [&](std::string_view name, std::size_t width, Floats& values,
                       std::size_t VqModel::Sizes::*size) {
    RealRows<Floats> rows{name, width, &values, {}};
    for (const VqModel::Sizes& before : model.earlier) rows.ends.push_back(before.*size);
    rows.ends.push_back(model.sizes.*size);
    list.push_back(std::move(rows));
  };
  add("P1", n.beta, model.p1, &VqModel::Sizes::p1);
  add("P2_scales", n.alpha, model.p2.scales, &VqModel::Sizes::p2);
  add("P3_scales", n.theta, model.p3.scales, &VqModel::Sizes::p3);
  add("P4_scales", n.phi, model.p4.scales, &VqModel::Sizes::p4);
  if (model.chromaticities > 0) add("C", model.chromaticities, model.c, &VqModel::Sizes::c);
  return list;
}

PackedIndices read_indices(const ModelFile& file, const std::string& name, std::size_t count,
                           std::size_t limit) {
  const std::vector<std::uint32_t> bytes =
      file.index_tensor(name, {PackedIndices::packed_size(count, limit)}, 256);
  return PackedIndices::unpack(bytes, count, limit,
                               fmt::format("{}: tensor \"{}\"", file.file().path().string(), name));
}

}  // namespace

std::vector<ModelTensor> VqModel::tensors() const {
  const auto real = [](std::string name, std::vector<std::size_t> shape,
                       std::span<const float> values) {
    return ModelTensor{std::move(name), std::move(shape), DType::f32, std::as_bytes(values)};
  };
  const auto packed = [](std::string name, const PackedIndices& indices) {
    return ModelTensor{std::move(name), {indices.bytes().size()}, DType::u8, indices.bytes()};
  };
  std::vector<ModelTensor> tensors;
  if (has_code_books()) {
    for_parts(real_rows(*this),
              [&](const auto& rows, std::size_t part, std::size_t first, std::size_t count) {
                tensors.push_back(
                    real(part_name(rows.name, part), {count, rows.width},
                         std::span(*rows.values).subspan(first * rows.width, count * rows.width)));
              });
  }
  if (has_planar_index()) {
    tensors.push_back(real("P6_scales", {p6.scales.size()}, p6.scales));
    for (std::size_t l = 1; l <= coarser.size(); ++l) {
      const std::vector<float>& scales = coarser[l - 1].scales;
      tensors.push_back(real(level_name("P6_scales", l), {scales.size()}, scales));
    }
  }
  if (has_code_books()) {
    tensors.push_back({"layout", {layout_.size() / sizeof(std::uint32_t)}, DType::u32, layout_});
    tensors.push_back(
        {"channels", {channels.size()}, DType::u8, std::as_bytes(std::span(channels))});
    tensors.push_back(packed("P2", p2.entries));
    tensors.push_back(packed("M", m));
    tensors.push_back(packed("P3", p3.entries));
    tensors.push_back(packed("P4", p4.entries));
    if (chromaticities > 0) {
      tensors.push_back(packed("I1", i1));
      tensors.push_back(packed("I2", i2));
    }
  }
  if (has_planar_index()) {
    tensors.push_back(packed("P6", p6.entries));
    for (std::size_t l = 1; l <= coarser.size(); ++l) {
      tensors.push_back(packed(level_name("P6", l), coarser[l - 1].entries));
    }
  }
  return tensors;
}

std::vector<std::span<float>> VqModel::real_values() {
  std::vector<std::span<float>> values;
  if (has_code_books()) {
    for_parts(
        real_rows(*this), [&](const auto& rows, std::size_t, std::size_t first, std::size_t count) {
          values.push_back(std::span(*rows.values).subspan(first * rows.width, count * rows.width));
        });
  }
  if (has_planar_index()) {
    values.emplace_back(p6.scales);
    for (VqCodeBook& level : coarser) values.emplace_back(level.scales);
  }
  return values;
}

void VqModel::seal() {
  const auto& n = grid.sizes;
  std::vector<std::uint32_t> words;
  const auto add = [&](std::span<const std::size_t> sizes_to_add) {
    for (const std::size_t word : sizes_to_add) words.push_back(static_cast<std::uint32_t>(word));
  };
  add(std::array<std::size_t, grid_words>{grid.kind == VqGrid::Kind::onion ? 1U : 0U, n.phi,
                                          n.theta, n.alpha, n.beta, chromaticities});
  add(words_of(sizes));
  for (const Sizes& before : earlier) add(words_of(before));
  layout_.resize(words.size() * sizeof(std::uint32_t));
  std::memcpy(layout_.data(), words.data(), layout_.size());
}

std::unique_ptr<VqModel> VqModel::read(const ModelFile& file) {
  if (file.info().codec != "vq") {
    file.reject("metadata \"codec\": \"" + file.info().codec + "\" instead of \"vq\"");
  }
  auto model = std::make_unique<VqModel>();
  model->info = file.info();
  const BtfShape& shape = model->info.btf.shape;
  const auto reject = [&](const std::string& why) { file.reject("tensor \"layout\": " + why); };

  // the code-books' sizes, and those before each addition
  const std::vector<std::size_t> words = file.shape_of("layout");
  const std::size_t parts = words.size() == 1 ? (words[0] - grid_words) / size_words : 0;
  if (words.size() != 1 || words[0] < grid_words + size_words || parts > most_parts ||
      words[0] != grid_words + parts * size_words) {
    reject(fmt::format("{} words instead of {} and {} for each part of the code-books",
                       words.empty() ? 0 : words[0], grid_words, size_words));
  }
  const auto layout = file.index_tensor("layout", words, std::numeric_limits<std::uint32_t>::max());
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
  const auto sizes_at = [&](std::size_t part) {
    return sizes_of(std::span(layout).subspan(grid_words + part * size_words, size_words));
  };
  model->sizes = sizes_at(0);
  for (std::size_t part = 1; part < parts; ++part) model->earlier.push_back(sizes_at(part));
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
  for (std::size_t i = 0; i < model->earlier.size(); ++i) {
    const auto before = words_of(model->earlier[i]);
    const auto after = words_of(i + 1 < model->earlier.size() ? model->earlier[i + 1] : s);
    for (std::size_t book = 0; book < size_words; ++book) {
      if (before[book] <= after[book]) continue;
      reject(fmt::format("a code-book of {} entries before and {} after something was added",
                         before[book], after[book]));
    }
  }
  const auto channels = file.index_tensor("channels", {shape.channels}, model->chromaticities + 1);
  for (const std::uint32_t channel : channels) {
    if (channel > 255) file.reject("tensor \"channels\": more than 255 chromaticities");
    model->channels.push_back(static_cast<std::uint8_t>(channel));
  }

  // the reals are there before memory is taken for as many entries
  for_parts(real_rows(*model),
            [&](const auto& rows, std::size_t part, std::size_t, std::size_t count) {
              const std::vector<float> values =
                  file.real_tensor(part_name(rows.name, part), {count, rows.width}, no_axis);
              rows.values->insert(rows.values->end(), values.begin(), values.end());
            });
  const auto planar = [&](std::size_t level) {
    const std::size_t texels = mip_side(shape.height, level) * mip_side(shape.width, level);
    VqCodeBook index;
    index.scales = file.real_tensor(level_name("P6_scales", level), {texels}, no_axis);
    index.entries = read_indices(file, level_name("P6", level), texels, s.p4);
    return index;
  };
  model->p2.entries = read_indices(file, "P2", s.p2 * n.alpha, s.p1);
  model->m = read_indices(file, "M", s.m * (colours ? 2 : 1), std::max(s.p2, s.i2));
  for (std::size_t i = 0; i < model->m.size(); ++i) {
    const std::size_t limit = colours && i % 2 == 1 ? s.i2 : s.p2;
    if (model->m[i] >= limit) {
      file.reject(
          fmt::format("tensor \"M\": index {} of entry {} is not below {}", model->m[i], i, limit));
    }
  }
  model->p3.entries = read_indices(file, "P3", s.p3 * n.theta, s.m);
  model->p4.entries = read_indices(file, "P4", s.p4 * n.phi, s.p3);
  model->p6 = planar(0);
  const std::size_t last = last_mip_level(shape.height, shape.width);
  for (std::size_t level = 1; level <= last && file.has(level_name("P6", level)); ++level) {
    model->coarser.push_back(planar(level));
  }
  for (std::size_t level = model->coarser.size() + 1; level < most_levels; ++level) {
    if (file.has(level_name("P6", level)) || file.has(level_name("P6_scales", level))) {
      file.reject(fmt::format(
          "tensor \"{}\": a planar index of level {} behind {} levels of {} x "
          "{} texels, which have {}",
          level_name("P6", level), level, model->coarser.size(), shape.width, shape.height, last));
    }
  }
  if (colours) {
    model->i1 = read_indices(file, "I1", s.i1 * n.beta, s.c);
    model->i2 = read_indices(file, "I2", s.i2 * n.alpha, s.i1);
  }
  model->seal();
  return model;
}

}  // namespace weft
