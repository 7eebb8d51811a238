#include "weft/codecs/fit_sparse.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include "weft/codecs/ksvd.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/codecs/sparse_decoder.hpp"
#include "weft/codecs/truncated_svd.hpp"
#include "weft/error.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/sparse_lengths.hpp"
#include "weft/ops/matrix_product.hpp"

namespace weft {
namespace {

// The part of a relative error that is left to the projection.
constexpr double projection_share = 0.5;
// The part of a squared error beyond which the projection gets a higher rank.
constexpr double projection_squares = 0.5;
// Rounds of longer lists, where the measured error misses a goal that was foreseen to be met.
constexpr int most_rounds = 4;
// Bytes of the basis that are on the device at a time.
constexpr std::size_t basis_bytes = std::size_t{64} << 20;

// One plan for a job and the jobs within it, which count what is held meanwhile.
class WithinPlan {
 public:
  explicit WithinPlan(Job& job)
      : job_(job), on_plan_(std::exchange(job.on_plan, {})), held_(job.held.size()) {}
  ~WithinPlan() {
    job_.on_plan = std::move(on_plan_);
    job_.held.resize(held_);
  }
  WithinPlan(const WithinPlan&) = delete;
  WithinPlan& operator=(const WithinPlan&) = delete;

 private:
  Job& job_;
  std::function<void(const MemoryPlan&)> on_plan_;
  std::size_t held_;
};

// The sizes of a fit that follow from the data's.
struct SparseSizes {
  std::size_t texels;
  std::size_t row;          // n = V L C
  std::size_t fibre;        // L C
  std::size_t rank;         // at most
  std::size_t abrdf_atoms;  // no more than signals
  std::size_t light_atoms;

  SparseSizes(const BtfShape& shape, const SparseOptions& options)
      : texels(shape.texels()),
        row(shape.images() * shape.channels),
        fibre(shape.lights * shape.channels),
        rank(std::min({options.rank, texels, row})),
        abrdf_atoms(std::min(options.abrdf_atoms, texels)),
        light_atoms(std::min(options.light_atoms, abrdf_atoms * shape.views)) {}
};

SvdOptions svd_options(const SparseOptions& options) {
  SvdOptions svd;
  svd.rank = options.rank;
  if (options.goal.kind == FitGoal::Kind::relative) {
    svd.tolerance = projection_share * options.goal.relative;
  }
  return svd;
}

KsvdOptions ksvd_options(const SparseOptions& options, std::size_t atoms, std::size_t terms,
                         std::uint64_t seed) {
  KsvdOptions ksvd;
  ksvd.atoms = atoms;
  ksvd.sparsity = std::min(terms, atoms);
  ksvd.iterations = options.iterations;
  ksvd.update = options.update;
  ksvd.seed = seed;
  return ksvd;
}

CodeLists code_lists(const KsvdFit<float>& fit, std::size_t length) {
  return {length, fit.indices, {fit.coefficients.begin(), fit.coefficients.end()}};
}

class SparseFitter {
 public:
  SparseFitter(Device& device, TileSource& source, const SparseOptions& options, Job& job)
      : device_(device),
        source_(source),
        options_(options),
        job_(job),
        held_(job.held.size()),
        shape_(source.info().shape),
        sizes_(shape_, options) {}

  SparseFit fit() {
    const WithinPlan within(job_);
    project();
    if (rank_ == 0) return fit_mean();
    if (options_.goal.kind == FitGoal::Kind::size) return fit_size();
    if (options_.goal.kind == FitGoal::Kind::relative) return fit_relative();
    decompose(options_.view_terms, options_.texel_terms, options_.iterations, false);
    return finish();
  }

 private:
  TruncatedSvd projection() {
    try {
      return truncated_svd(device_, source_, svd_options(options_), job_);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::unmet_goal || !options_.goal) throw;
      // "--tolerance E: what was reached", but nobody asked for E
      const std::string_view text = error.what();
      const std::size_t colon = text.find(": ");
      fail(ErrorKind::unmet_goal, "--target {}: half of that, {:g}, is left to the projection; {}",
           options_.goal.text, projection_share * options_.goal.relative,
           colon == std::string_view::npos ? text : text.substr(colon + 2));
    }
  }

  // Mean, Y = U Sigma and W.
  void project() {
    // nothing of a projection of lower rank is held meanwhile
    job_.held.resize(held_);
    for (std::vector<float>* values : {&Y_, &W_, &B_}) *values = std::vector<float>();
    texels_ = KsvdFit<float>();
    views_ = KsvdFit<float>();
    TruncatedSvd svd = projection();
    job_.notes.push_back(fmt::format("projection: svd {}, {} passes over the data, rank {}: {}",
                                     name_of(svd.method), svd.passes, svd.rank, svd.reason));
    mean_ = std::move(svd.mean);
    rank_ = svd.rank;
    std::vector<double> sigma(rank_, 0.0);
    for (std::size_t r = 0; r < sizes_.row; ++r) {
      for (std::size_t j = 0; j < rank_; ++j) {
        sigma[j] += std::pow(double{svd.right[r * rank_ + j]}, 2);
      }
    }
    double largest = 0;
    for (double& value : sigma) {
      value = std::sqrt(value);
      largest = std::max(largest, value);
    }
    int exponent = 0;
    std::frexp(largest, &exponent);
    unit_ = std::ldexp(1.0, exponent);
    squares_ = svd.squares / (unit_ * unit_);
    projection_ = std::pow(svd.residual / unit_, 2);
    Y_ = std::move(svd.left);
    for (std::size_t p = 0; p < sizes_.texels; ++p) {
      for (std::size_t j = 0; j < rank_; ++j) {
        Y_[p * rank_ + j] = static_cast<float>(double{Y_[p * rank_ + j]} * sigma[j] / unit_);
      }
    }
    W_ = std::move(svd.right);
    for (std::size_t r = 0; r < sizes_.row; ++r) {
      for (std::size_t j = 0; j < rank_; ++j) {
        const double value = double{W_[r * rank_ + j]};
        W_[r * rank_ + j] = static_cast<float>(sigma[j] > 0 ? value / sigma[j] : 0.0);
      }
    }
    job_.held.push_back({"projected texels", Y_.size() * sizeof(float)});
    job_.held.push_back({"basis of the projection", W_.size() * sizeof(float)});
    job_.held.push_back({"ABRDFs", sizes_.abrdf_atoms * sizes_.row * sizeof(float)});
  }

  // Both K-SVDs; `warm`: from the dictionaries of the decomposition before.
  void decompose(std::size_t view_terms, std::size_t texel_terms, std::size_t iterations,
                 bool warm) {
    KsvdOptions options = ksvd_options(options_, sizes_.abrdf_atoms, texel_terms, job_.seed);
    options.iterations = iterations;
    options.start = warm ? KsvdStart::given : KsvdStart::samples;
    texels_ =
        ksvd(device_, KsvdSignals::of(rank_, Y_), options,
             warm ? std::vector<float>(texels_.dictionary) : std::vector<float>(), job_, "texels");
    P_ = code_lists(texels_, options.sparsity);
    weights_ = atom_weights(P_, sizes_.abrdf_atoms);
    kept_ = drop_unused(P_, weights_);
    combine_abrdfs();

    const std::size_t fibres = kept_.size() * shape_.views;
    const std::size_t atoms = std::min(options_.light_atoms, fibres);
    options = ksvd_options(options_, atoms, view_terms, job_.seed + 1);
    options.iterations = iterations;
    const bool given = warm && views_.dictionary.size() == atoms * sizes_.fibre;
    options.start = given ? KsvdStart::given : KsvdStart::samples;
    views_ =
        ksvd(device_, KsvdSignals::of(sizes_.fibre, B_), options,
             given ? std::vector<float>(views_.dictionary) : std::vector<float>(), job_, "views");
    V_ = code_lists(views_, options.sparsity);
  }

  // B = diag(|P_j|) D W^T, in blocks of W's rows.
  void combine_abrdfs() {
    const std::size_t atoms = kept_.size();
    const StageTimer timer(
        job_, "back-projection",
        2.0 * static_cast<double>(atoms * sizes_.row) * static_cast<double>(rank_));
    std::vector<float> D(atoms * rank_);
    for (std::size_t a = 0; a < atoms; ++a) {
      for (std::size_t j = 0; j < rank_; ++j) {
        D[a * rank_ + j] =
            static_cast<float>(weights_[a] * double{texels_.dictionary[kept_[a] * rank_ + j]});
      }
    }
    B_.resize(atoms * sizes_.row);
    const std::size_t run =
        std::clamp<std::size_t>(basis_bytes / (rank_ * sizeof(float)), 1, sizes_.row);
    Buffer atoms_buffer(device_, D.size() * sizeof(float), "atoms of texels");
    Buffer basis(device_, run * rank_ * sizeof(float), "basis of the projection");
    Buffer product(device_, atoms * run * sizeof(float), "ABRDFs");
    device_.write(atoms_buffer, std::span<const float>(D));
    std::vector<float> rows(atoms * run);
    for (std::size_t first = 0; first < sizes_.row; first += run) {
      check_interrupt();
      const std::size_t count = std::min(run, sizes_.row - first);
      device_.write(basis, std::span<const float>(W_).subspan(first * rank_, count * rank_));
      ops::gemm(device_, ops::Transpose::no, ops::Transpose::yes, atoms, count, rank_, 1.0,
                {atoms_buffer, rank_}, {basis, rank_}, 0.0, {product, count});
      device_.read(product, std::span<float>(rows).first(atoms * count));
      for (std::size_t a = 0; a < atoms; ++a) {
        std::copy_n(rows.data() + a * count, count, B_.data() + a * sizes_.row + first);
      }
    }
  }

  SparseErrors errors(double texel_squares, double view_squares) const {
    const double all = squares_ > 0 ? squares_ : 1;
    return {std::sqrt(projection_ / all), std::sqrt(texel_squares / all),
            std::sqrt(view_squares / all)};
  }

  // The model of the last decomposition, as it is stored.
  std::unique_ptr<SparseModel> model() const {
    auto model = std::make_unique<SparseModel>();
    model->info.codec = "sparse";
    model->info.storage = options_.storage;
    model->info.btf = source_.info();
    model->mean = mean_;
    if (rank_ > 0) {
      // an ABRDF's fibres have its weight
      CodeLists V = V_;
      const std::size_t terms = shape_.views * V.length;
      for (std::size_t i = 0; i < V.coefficients.size(); ++i) {
        V.coefficients[i] /= weights_[i / terms];
      }
      std::vector<double> uses = atom_weights(V, views_.dictionary.size() / sizes_.fibre);
      const std::vector<std::uint32_t> atoms = drop_unused(V, uses);
      for (const std::uint32_t atom : atoms) {
        for (std::size_t i = 0; i < sizes_.fibre; ++i) {
          model->dictionary.push_back(
              static_cast<float>(double{views_.dictionary[atom * sizes_.fibre + i]} * unit_));
        }
      }
      model->light_atoms = atoms.size();
      model->abrdf_atoms = kept_.size();
      model->views = sparse_lists(V, model->light_atoms);
      model->texels = sparse_lists(P_, model->abrdf_atoms);
    }
    model->round_to_storage();
    return model;
  }

  SparseFit finish() const { return {model(), rank_, errors(texels_.objective, views_.objective)}; }

  // Data that is its mean: there is nothing to choose.
  SparseFit fit_mean() const {
    SparseFit fit = finish();
    const FitGoal& goal = options_.goal;
    const std::size_t bytes = model_file_size(*fit.model);
    if (goal.kind == FitGoal::Kind::size && bytes > goal.bytes) {
      fail(ErrorKind::unmet_goal, "--target {}: the mean alone takes {} bytes, {} are allowed",
           goal.text, bytes, goal.bytes);
    }
    return fit;
  }

  std::size_t real_bytes() const { return options_.storage == Storage::f16 ? 2 : 4; }
  // Of a term of lists of so many atoms.
  std::size_t term_bytes(std::size_t atoms) const {
    return size_of(IndexTensor({}, atoms).dtype()) + real_bytes();
  }

  // Bytes of the file for other lengths than those of `model`, with all atoms in use.
  LengthBytes length_bytes(const SparseModel& model) const {
    const std::size_t scale = options_.storage == Storage::f16 ? sizeof(float) : 0;
    const std::size_t light_atom = sizes_.fibre * real_bytes() + scale;
    // the header's numbers may be longer by some digits, and the parameters are still to come
    constexpr std::size_t digits = 512;
    const std::size_t without_lists =
        model_file_size(model) - model.views.coefficients.size() * term_bytes(model.light_atoms) -
        model.texels.coefficients.size() * term_bytes(model.abrdf_atoms) -
        model.light_atoms * light_atom - model.abrdf_atoms * scale;
    const std::size_t fixed =
        without_lists + digits + sizes_.light_atoms * light_atom + sizes_.abrdf_atoms * scale;
    const std::size_t of_views = sizes_.abrdf_atoms * shape_.views * term_bytes(sizes_.light_atoms);
    const std::size_t of_texels = sizes_.texels * term_bytes(sizes_.abrdf_atoms);
    return [=](std::size_t k1, std::size_t k2) { return fixed + k1 * of_views + k2 * of_texels; };
  }

  std::size_t first_iterations() const { return (options_.iterations + 1) / 2; }

  // A decomposition with long lists, no longer than `most_bytes` of one kind, and the errors of all
  // shorter ones.
  void decompose_long(std::size_t most_bytes) {
    const auto length = [&](std::size_t terms, std::size_t lists, std::size_t atoms) {
      return std::clamp<std::size_t>(most_bytes / (lists * term_bytes(atoms)), 1, terms);
    };
    decompose(length(options_.view_terms, sizes_.abrdf_atoms * shape_.views, sizes_.light_atoms),
              length(options_.texel_terms, sizes_.texels, sizes_.abrdf_atoms), first_iterations(),
              false);
    const StageTimer timer(job_, "errors of shorter lists");
    texel_errors_ = truncation_errors(rank_, Y_, used_atoms(), P_);
    view_errors_ = truncation_errors(sizes_.fibre, B_, views_.dictionary, V_);
  }

  // The decomposition with these lengths, from the dictionaries that there are.
  SparseFit refit(const SparseLengthChoice& choice) {
    decompose(choice.view_terms, choice.texel_terms, options_.iterations - first_iterations(),
              true);
    SparseFit fit = finish();
    const SparseErrors foreseen =
        errors(texel_errors_[choice.texel_terms], view_errors_[choice.view_terms]);
    job_.notes.push_back(fmt::format(
        "k1 {}, k2 {}: relative error foreseen {:.4g} from longer lists, {:.4g} from these "
        "(projection {:.4g}, texels {:.4g}, views {:.4g})",
        choice.view_terms, choice.texel_terms, foreseen.foreseen(), fit.errors.foreseen(),
        fit.errors.projection, fit.errors.texels, fit.errors.views));
    return fit;
  }

  // Whether the rank was raised, since the projection makes most of the error beside `squares`.
  bool raise_rank(double squares) {
    const std::size_t next = std::min(2 * options_.rank, options_.most_rank);
    if (rank_ < options_.rank || next <= options_.rank ||
        projection_ <= projection_squares * (projection_ + squares)) {
      return false;
    }
    SparseOptions raised = options_;
    raised.rank = next;
    std::size_t bytes = plan_sparse(device_, source_, raised, job_).total();
    for (std::size_t i = 0; i < held_; ++i) bytes += job_.held[i].bytes;
    if (bytes > job_.memory) {
      job_.notes.push_back(fmt::format(
          "rank {} kept, though the projection makes most of the error: {} would take {} bytes",
          options_.rank, next, bytes));
      return false;
    }
    job_.notes.push_back(fmt::format("rank {} raised to {}: the projection made most of the error",
                                     options_.rank, next));
    options_.rank = next;
    sizes_ = SparseSizes(shape_, options_);
    return true;
  }

  SparseFit fit_size() {
    const FitGoal& goal = options_.goal;
    for (;;) {
      decompose_long(goal.bytes);
      const LengthBytes bytes = length_bytes(*model());
      const auto choice = lengths_of_size(view_errors_, texel_errors_, bytes, goal.bytes);
      if (!choice) {
        fail(ErrorKind::unmet_goal,
             "--target {}: lists of one term take {} bytes, {} are allowed; fewer --atoms take "
             "less",
             goal.text, bytes(1, 1), goal.bytes);
      }
      if (!raise_rank(choice->squares)) return refit(*choice);
      project();
    }
  }

  SparseFit fit_relative() {
    const FitGoal& goal = options_.goal;
    decompose_long(std::numeric_limits<std::size_t>::max());
    const LengthBytes bytes = length_bytes(*model());
    const SparseLengthChoice longest{view_errors_.size() - 1, texel_errors_.size() - 1,
                                     view_errors_.back() + texel_errors_.back()};
    double ratio = 1;  // of the measured error to that of the choice
    for (int round = 0;; ++round) {
      const double allowed = std::pow(goal.relative / ratio, 2) * squares_ - projection_;
      const SparseLengthChoice choice =
          lengths_of_error(view_errors_, texel_errors_, bytes, allowed).value_or(longest);
      SparseFit fit = refit(choice);
      const double reached = measured(*fit.model);
      job_.notes.push_back(fmt::format("relative error reached {:.4g}", reached));
      if (reached <= goal.relative) return fit;
      const bool none_longer =
          choice.view_terms == longest.view_terms && choice.texel_terms == longest.texel_terms;
      if (none_longer || round + 1 == most_rounds) {
        fail(ErrorKind::unmet_goal,
             "--target {}: k1 = {}, k2 = {} and {} components reach {:.4g}; raise --k1, --k2, "
             "--atoms or --rank",
             goal.text, choice.view_terms, choice.texel_terms, rank_, reached);
      }
      ratio =
          std::max(1.02 * ratio, reached / std::sqrt((projection_ + choice.squares) / squares_));
    }
  }

  // Atoms of the texels' space that codes use.
  std::vector<float> used_atoms() const {
    std::vector<float> atoms;
    for (const std::uint32_t atom : kept_) {
      const auto row = texels_.dictionary.begin() + static_cast<std::ptrdiff_t>(atom * rank_);
      atoms.insert(atoms.end(), row, row + static_cast<std::ptrdiff_t>(rank_));
    }
    return atoms;
  }

  double measured(const SparseModel& model) const {
    const auto decoder = sparse_decoder(device_, model);
    const ErrorSums sums = measure_errors(device_, *decoder, source_, job_);
    return std::sqrt(sums.square_difference / sums.square_reference);
  }

  Device& device_;
  TileSource& source_;
  SparseOptions options_;
  Job& job_;
  std::size_t held_;  // items of the job's caller
  BtfShape shape_;
  SparseSizes sizes_;

  // Everything is in units of `unit_`.
  double unit_ = 1;
  double squares_ = 0;     // |T|^2
  double projection_ = 0;  // |A - U Sigma W^T|^2
  std::size_t rank_ = 0;
  std::vector<float> mean_;  // [n], in the data's own unit
  std::vector<float> Y_;     // U Sigma [P][rank]
  std::vector<float> W_;     // [n][rank]
  KsvdFit<float> texels_;
  CodeLists P_;                      // of the atoms that are used
  std::vector<double> weights_;      // [atoms used]
  std::vector<std::uint32_t> kept_;  // [atoms used], their numbers in texels_
  std::vector<float> B_;             // [atoms used][n]
  KsvdFit<float> views_;
  CodeLists V_;
  // with a goal: squared errors by the length of lists
  std::vector<double> view_errors_;
  std::vector<double> texel_errors_;
};

}  // namespace

MemoryPlan plan_sparse(Device& device, TileSource& source, const SparseOptions& options,
                       const Job& job) {
  const BtfShape& shape = source.info().shape;
  const SparseSizes sizes(shape, options);
  const auto held = [&](MemoryPlan plan) {
    plan.add("projected texels", sizes.texels * sizes.rank * sizeof(float));
    plan.add("basis of the projection", sizes.row * sizes.rank * sizeof(float));
    plan.add("ABRDFs", sizes.abrdf_atoms * sizes.row * sizeof(float));
    plan.add("dictionary of texels", sizes.abrdf_atoms * sizes.rank * sizeof(float));
    return plan;
  };
  const std::size_t codes = 2 * (sizeof(std::uint32_t) + sizeof(double));
  const std::size_t fibres = sizes.abrdf_atoms * shape.views;
  MemoryPlan texels =
      held(ksvd_plan(device, sizes.texels, sizes.rank,
                     ksvd_options(options, sizes.abrdf_atoms, options.texel_terms, job.seed)));
  MemoryPlan back;
  const std::size_t run = std::min(sizes.row, basis_bytes / (sizes.rank * sizeof(float)) + 1);
  back.add("block of the basis", run * (sizes.rank + 2 * sizes.abrdf_atoms) * sizeof(float));
  back.add("atoms of texels", 2 * sizes.abrdf_atoms * sizes.rank * sizeof(float));
  back.add("product", ops::product_bytes(device, run, sizes.rank));
  back = held(back);
  MemoryPlan views =
      held(ksvd_plan(device, fibres, sizes.fibre,
                     ksvd_options(options, sizes.light_atoms, options.view_terms, job.seed)));
  for (MemoryPlan* plan : {&texels, &back, &views}) {
    plan->add("lists", (sizes.texels * options.texel_terms + fibres * options.view_terms) * codes);
  }
  const auto less = [](const MemoryPlan& a, const MemoryPlan& b) { return a.total() < b.total(); };
  return std::max(
      {plan_truncated_svd(device, source, svd_options(options), job), texels, back, views}, less);
}

SparseFit fit_sparse(Device& device, TileSource& source, const SparseOptions& options, Job& job) {
  return SparseFitter(device, source, options, job).fit();
}

}  // namespace weft
