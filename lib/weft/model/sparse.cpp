#include "weft/model/sparse.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <functional>
#include <limits>

#include "weft/model/coded_tensor.hpp"
#include "weft/model/divide.hpp"
#include "weft/model/selected_indices.hpp"

namespace weft {
namespace {

constexpr std::size_t first_axis = 0;  // of the dictionary [D1, L, C] and of V [D2, V, k1]
constexpr std::size_t no_axis = ModelTensor::no_component_axis;

std::vector<std::size_t> mean_shape(const BtfShape& shape) {
  return {shape.views, shape.lights, shape.channels};
}
std::vector<std::size_t> dictionary_shape(const BtfShape& shape, std::size_t atoms) {
  return {atoms, shape.lights, shape.channels};
}
std::vector<std::size_t> views_shape(const BtfShape& shape, std::size_t atoms, std::size_t k1) {
  return {atoms, shape.views, k1};
}
std::vector<std::size_t> texels_shape(const BtfShape& shape, std::size_t k2) {
  return {shape.texels(), k2};
}

// Numbers the atoms that are in use in their old order; the others get none.
struct Renumbering {
  static constexpr std::uint32_t unused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> number;  // [atoms]
  std::vector<std::size_t> kept;      // old numbers

  explicit Renumbering(std::size_t atoms) : number(atoms, unused) {}
  void use(std::size_t atom) { number[atom] = 0; }
  void count() {
    for (std::size_t i = 0; i < number.size(); ++i) {
      if (number[i] == unused) continue;
      number[i] = static_cast<std::uint32_t>(kept.size());
      kept.push_back(i);
    }
  }
};

// The given rows of lists, with their atoms renumbered.
SparseLists pick(const SparseLists& lists, const std::vector<std::size_t>& rows, std::size_t atoms,
                 Renumbering& renumbering) {
  renumbering = Renumbering(atoms);
  for (const std::size_t row : rows) {
    for (std::size_t i = 0; i < lists.length; ++i) {
      renumbering.use(lists.atoms[row * lists.length + i]);
    }
  }
  renumbering.count();
  SparseLists part;
  part.length = lists.length;
  std::vector<std::uint32_t> numbers;
  for (const std::size_t row : rows) {
    for (std::size_t i = row * lists.length; i < (row + 1) * lists.length; ++i) {
      numbers.push_back(renumbering.number[lists.atoms[i]]);
      part.coefficients.push_back(lists.coefficients[i]);
    }
  }
  part.atoms = IndexTensor(numbers, renumbering.kept.size());
  return part;
}

// The lists of a file, `name`_atoms and `name`_coefficients.
SparseLists read_lists(const ModelFile& file, const std::string& name,
                       const std::vector<std::size_t>& shape, std::size_t atoms,
                       std::size_t component_axis) {
  SparseLists lists;
  lists.length = shape.back();
  if (lists.length > atoms) {
    file.reject(
        fmt::format("tensor \"{}_atoms\": lists of {} among {} atoms", name, lists.length, atoms));
  }
  const std::vector<std::uint32_t> indices = file.index_tensor(name + "_atoms", shape, atoms);
  for (std::size_t i = 1; i < indices.size(); ++i) {
    if (i % lists.length != 0 && indices[i] <= indices[i - 1]) {
      file.reject(fmt::format("tensor \"{}_atoms\": {} behind {} at index {} is not in order", name,
                              indices[i], indices[i - 1], i));
    }
  }
  lists.atoms = IndexTensor(indices, atoms);
  lists.coefficients = file.real_tensor(name + "_coefficients", shape, component_axis);
  return lists;
}

}  // namespace

std::vector<ModelTensor> SparseModel::tensors() const {
  const BtfShape& shape = info.btf.shape;
  return {{"mean", mean_shape(shape), DType::f32, std::as_bytes(std::span(mean))},
          {"dictionary", dictionary_shape(shape, light_atoms), DType::f32,
           std::as_bytes(std::span(dictionary)), first_axis},
          {"view_atoms", views_shape(shape, abrdf_atoms, views.length), views.atoms.dtype(),
           views.atoms.bytes()},
          {"view_coefficients", views_shape(shape, abrdf_atoms, views.length), DType::f32,
           std::as_bytes(std::span(views.coefficients)), first_axis},
          {"texel_atoms", texels_shape(shape, texels.length), texels.atoms.dtype(),
           texels.atoms.bytes()},
          {"texel_coefficients", texels_shape(shape, texels.length), DType::f32,
           std::as_bytes(std::span(texels.coefficients))}};
}

std::vector<std::span<float>> SparseModel::real_values() {
  return {mean, dictionary, views.coefficients, texels.coefficients};
}

// The views' lists take s_v, the dictionary s_l, the texels' lists s_p.
void SparseModel::divide(const Weights& factors) {
  const BtfShape& shape = info.btf.shape;
  const std::size_t C = shape.channels;
  for (std::size_t r = 0; r < mean.size(); ++r) {
    divide_by(mean[r], factors.image(r / C, shape.lights));
  }
  if (!factors.lights.empty()) {
    for (std::size_t i = 0; i < dictionary.size(); ++i) {
      divide_by(dictionary[i], factors.lights[i / C % shape.lights]);
    }
  }
  if (!factors.views.empty()) {
    for (std::size_t i = 0; i < views.coefficients.size(); ++i) {
      divide_by(views.coefficients[i], factors.views[i / views.length % shape.views]);
    }
  }
  for (std::size_t i = 0; i < texels.coefficients.size(); ++i) {
    divide_by(texels.coefficients[i], factors.texel(i / texels.length));
  }
}

void SparseModel::add_mean(std::span<const float> added) {
  std::transform(mean.begin(), mean.end(), added.begin(), mean.begin(), std::plus<>());
}

void SparseModel::fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                               std::span<double> out) const {
  const BtfShape& shape = info.btf.shape;
  const std::size_t C = shape.channels;
  for (std::size_t c = 0; c < C; ++c) out[c] = mean[(view * shape.lights + light) * C + c];
  const std::size_t texel = (y * shape.width + x) * texels.length;
  for (std::size_t j = texel; j < texel + texels.length; ++j) {
    const std::size_t row = (texels.atoms[j] * shape.views + view) * views.length;
    for (std::size_t i = row; i < row + views.length; ++i) {
      const double product = double{texels.coefficients[j]} * double{views.coefficients[i]};
      const float* atom = dictionary.data() + (views.atoms[i] * shape.lights + light) * C;
      for (std::size_t c = 0; c < C; ++c) out[c] += product * double{atom[c]};
    }
  }
}

std::unique_ptr<SparseModel> SparseModel::select(const Selection& selection) const {
  Selection part = selection;
  part.level = 0;
  const BtfShape& whole = info.btf.shape;
  auto model = std::make_unique<SparseModel>();
  model->info = selected_info(info, part);

  const SelectedIndices indices = selected_indices(whole, part);
  for (const std::size_t row : indices.image_channels(whole)) model->mean.push_back(mean[row]);
  // texels, and the ABRDFs that they are combined from
  Renumbering abrdfs(0);
  model->texels = pick(texels, indices.texels, abrdf_atoms, abrdfs);
  model->abrdf_atoms = abrdfs.kept.size();
  // those ABRDFs' views, and the atoms that they are combined from
  std::vector<std::size_t> rows;
  for (const std::size_t j : abrdfs.kept) {
    for (const std::size_t v : indices.views) rows.push_back(j * whole.views + v);
  }
  Renumbering lights(0);
  model->views = pick(views, rows, light_atoms, lights);
  model->light_atoms = lights.kept.size();
  for (const std::size_t i : lights.kept) {
    for (const std::size_t l : indices.lights) {
      for (const std::size_t c : indices.channels) {
        model->dictionary.push_back(dictionary[(i * whole.lights + l) * whole.channels + c]);
      }
    }
  }
  return model;
}

std::unique_ptr<SparseModel> SparseModel::read(const ModelFile& file) {
  if (file.info().codec != "sparse") {
    file.reject("metadata \"codec\": \"" + file.info().codec + "\" instead of \"sparse\"");
  }
  auto model = std::make_unique<SparseModel>();
  model->info = file.info();
  const BtfShape& shape = model->info.btf.shape;
  // The numbers of atoms and of terms are those of the dictionary and of the lists; everything else
  // must fit them.
  const std::vector<std::size_t> dictionary = tensor_shape(file, "dictionary");
  const std::vector<std::size_t> views = tensor_shape(file, "view_atoms");
  const std::vector<std::size_t> texels = tensor_shape(file, "texel_atoms");
  if (dictionary.size() != 3) {
    file.reject("tensor \"dictionary\": shape " + shape_text(dictionary) +
                " instead of [D1, L, C]");
  }
  if (views.size() != 3) {
    file.reject("tensor \"view_atoms\": shape " + shape_text(views) + " instead of [D2, V, k1]");
  }
  if (texels.size() != 2) {
    file.reject("tensor \"texel_atoms\": shape " + shape_text(texels) + " instead of [P, k2]");
  }
  constexpr std::size_t most_atoms = std::numeric_limits<std::uint32_t>::max();
  if (dictionary[0] >= most_atoms || views[0] >= most_atoms) {
    file.reject(fmt::format("{} and {} atoms are too many", dictionary[0], views[0]));
  }
  model->light_atoms = dictionary[0];
  model->abrdf_atoms = views[0];
  model->mean = file.real_tensor("mean", mean_shape(shape), no_axis);
  model->dictionary =
      file.real_tensor("dictionary", dictionary_shape(shape, model->light_atoms), first_axis);
  model->views = read_lists(file, "view", views_shape(shape, model->abrdf_atoms, views[2]),
                            model->light_atoms, first_axis);
  model->texels =
      read_lists(file, "texel", texels_shape(shape, texels[1]), model->abrdf_atoms, no_axis);
  return model;
}

}  // namespace weft
