#include "weft/codecs/sparse.hpp"

#include <fmt/core.h>

#include <array>
#include <charconv>
#include <cmath>
#include <string_view>
#include <tuple>
#include <utility>

#include "weft/codecs/fit_sparse.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/codecs/sparse_decoder.hpp"
#include "weft/error.hpp"
#include "weft/reference/sparse.hpp"

namespace weft {
namespace {

// Where a goal chooses the lengths, and the rank.
constexpr std::size_t longest_lists = 32;
constexpr std::size_t highest_rank = 1024;
// Indices take 16 bits.
constexpr std::size_t most_atoms = 65536;

constexpr std::array<ParameterSpec, 6> sparse_parameters{{
    {"k1", "", "terms of an ABRDF's lists, 9; with a goal, the most, 32"},
    {"k2", "", "terms of a texel's list, 11; with a goal, the most, 32"},
    {"atoms", "256", "atoms D1[,D2] over lights and of ABRDFs; up to 256 take byte indices"},
    {"rank", "",
     "components of the projection before, 300; without it, a goal may take 600 or 1024"},
    {"iterations", "30", "of each K-SVD"},
    {"update", "approximate", "of an atom: exact or approximate"},
}};

const SparseModel& as_sparse(const Model& model) {
  return dynamic_cast<const SparseModel&>(model);
}

std::string_view text_of(const Parameters& parameters, std::string_view name,
                         std::string_view otherwise) {
  const auto found = parameters.find(name);
  return found == parameters.end() ? otherwise : std::string_view(found->second);
}

// "D1" or "D1,D2".
std::pair<std::size_t, std::size_t> parse_atoms(std::string_view text) {
  std::array<std::size_t, 2> atoms{};
  std::size_t count = 0;
  std::string_view rest = text;
  bool good = true;
  do {
    const std::size_t comma = rest.find(',');
    const std::string_view number = rest.substr(0, comma);
    const char* end = number.data() + number.size();
    std::size_t value = 0;
    const auto [stop, status] = std::from_chars(number.data(), end, value);
    good = status == std::errc() && stop == end && value >= 1 && value <= most_atoms;
    if (good) atoms[count++] = value;
    rest = comma == std::string_view::npos ? std::string_view() : rest.substr(comma + 1);
    if (comma != std::string_view::npos && rest.empty()) good = false;
  } while (good && count < 2 && !rest.empty());
  if (!good || !rest.empty()) {
    fail_input("--atoms {}: one or two whole numbers from 1 to {} are needed, as 256 or 256,512",
               text, most_atoms);
  }
  return {atoms[0], count == 2 ? atoms[1] : atoms[0]};
}

class SparseCodec final : public Codec {
 public:
  std::string_view name() const override { return "sparse"; }
  std::string_view summary() const override {
    return "sparse tensor decomposition: a dictionary and two sparse tensors, by K-SVD";
  }
  bool removes_mean() const override { return true; }
  std::span<const ParameterSpec> parameters() const override { return sparse_parameters; }

  bool takes_goals() const override { return true; }

  std::unique_ptr<Model> encode(Device& device, TileSource& source, const Parameters& parameters,
                                Storage storage, Job& job) const override {
    const SparseOptions options = sparse_options(parameters, source.info(), storage);
    job.plan(plan_sparse(device, source, options, job));
    return finish(fit_sparse(device, source, options, job), options, job);
  }

  std::unique_ptr<Model> encode_reference(TileSource& source, const Parameters& parameters,
                                          Storage storage, Job& job) const override {
    const SparseOptions options = sparse_options(parameters, source.info(), storage);
    const std::unique_ptr<SparseEncoder> encoder = reference::sparse_encoder(source, options, job);
    const MeasureSparse measure = [&](const SparseModel& model) {
      const ErrorSums sums = measure_errors(*sparse_reference_decoder(model), source, job);
      return std::sqrt(sums.square_difference / sums.square_reference);
    };
    SparseFit fit = fit_sparse(*encoder, source.info(), options, measure, job);
    return finish(std::move(fit), options, job);
  }

  // Only where sizes do not follow from the lengths of lists, which a search of its own is cheaper
  // for. Lengths that are given are the most.
  std::unique_ptr<NestedModels> nested(Device* device, TileSource& source,
                                       const Parameters& parameters, const NestedRequest& request,
                                       Job& job) const override {
    if (!request.steps) return nullptr;
    Parameters with_goal = parameters;
    with_goal["target"] = "rel=0.5";  // whatever it is
    SparseOptions options = sparse_options(with_goal, source.info(), request.storage);
    options.goal.text.clear();
    if (device) job.plan(plan_sparse(*device, source, options, job));
    return nested_sparse(
        device ? sparse_encoder(*device, source, options, job)
               : reference::sparse_encoder(source, options, job),
        source.info(), options, request,
        [options, &job](SparseFit fit) { return finish(std::move(fit), options, job); }, job);
  }

  std::unique_ptr<Model> fitted_part(const Model& model,
                                     const Selection& selection) const override {
    return as_sparse(model).select(selection);
  }

  std::unique_ptr<DeviceDecoder> fitted_decoder(Device& device, const Model& model) const override {
    return sparse_decoder(device, as_sparse(model));
  }
  std::size_t fitted_decoder_bytes(const Model& model) const override {
    return sparse_decoder_bytes(as_sparse(model));
  }
  std::unique_ptr<ReferenceDecoder> fitted_reference_decoder(const Model& model) const override {
    return sparse_reference_decoder(as_sparse(model));
  }

  std::unique_ptr<DeviceSampler> fitted_sampler(Device& device, const Model& model) const override {
    return sparse_sampler(device, as_sparse(model));
  }
  std::size_t fitted_sampler_bytes(const Model& model) const override {
    return sparse_sampler_bytes(as_sparse(model));
  }

  double fitted_tolerance(const Model& model) const override {
    return sparse_decode_tolerance(as_sparse(model));
  }

  std::unique_ptr<Model> read(const ModelFile& file) const override {
    return SparseModel::read(file);
  }

 private:
  SparseOptions sparse_options(const Parameters& parameters, const BtfInfo& source,
                               Storage storage) const {
    SparseOptions options;
    options.storage = storage;
    options.goal = fit_goal(parameters, source);
    if (options.goal) {
      options.view_terms = longest_lists;
      options.texel_terms = longest_lists;
    }
    if (options.goal && !parameters.contains("rank")) {
      options.most_rank = highest_rank;
    }
    const auto count = [&](std::string_view name, std::size_t& value) {
      if (parameters.contains(name)) value = count_parameter(*this, parameters, name, 1);
    };
    count("k1", options.view_terms);
    count("k2", options.texel_terms);
    count("rank", options.rank);
    count("iterations", options.iterations);
    std::tie(options.light_atoms, options.abrdf_atoms) =
        parse_atoms(text_of(parameters, "atoms", "256"));
    for (const auto& [name, terms, atoms] :
         {std::tuple("k1", &options.view_terms, options.light_atoms),
          std::tuple("k2", &options.texel_terms, options.abrdf_atoms)}) {
      if (*terms <= atoms) continue;
      if (parameters.contains(name)) {
        fail_input("--{} {}: lists of so many terms take more than {} atoms", name, *terms, atoms);
      }
      *terms = atoms;
    }
    const std::string_view update = text_of(parameters, "update", "approximate");
    if (update == name_of(KsvdUpdate::exact)) {
      options.update = KsvdUpdate::exact;
    } else if (update != name_of(KsvdUpdate::approximate)) {
      fail_input("--update {}: exact or approximate is needed", update);
    }
    return options;
  }

  static std::unique_ptr<Model> finish(SparseFit fit, const SparseOptions& options, Job& job) {
    const SparseModel& model = *fit.model;
    fit.model->info.parameters = fmt::format(
        R"({{"k1":{},"k2":{},"atoms":[{},{}],"rank":{},"iterations":{},"update":"{}",)"
        R"("target":"{}","projection_error":{:.6g},"texels_error":{:.6g},"views_error":{:.6g},)"
        R"("foreseen_error":{:.6g}}})",
        model.views.length, model.texels.length, model.light_atoms, model.abrdf_atoms, fit.rank,
        options.iterations, name_of(options.update), options.goal.text, fit.errors.projection,
        fit.errors.texels, fit.errors.views, fit.errors.foreseen());
    job.notes.push_back(fmt::format(
        "k1 {}, k2 {}, {} and {} atoms, rank {}; relative error foreseen {:.6g} "
        "(projection {:.4g}, texels {:.4g}, views {:.4g})",
        model.views.length, model.texels.length, model.light_atoms, model.abrdf_atoms, fit.rank,
        fit.errors.foreseen(), fit.errors.projection, fit.errors.texels, fit.errors.views));
    return std::move(fit.model);
  }
};

}  // namespace

const Codec& sparse_codec() {
  static const SparseCodec codec;
  return codec;
}

}  // namespace weft
