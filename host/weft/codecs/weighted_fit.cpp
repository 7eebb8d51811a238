#include "weft/codecs/weighted_fit.hpp"

#include "weft/btf/held_source.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

// Weights of texels that are products of those of rows and columns, exactly so where the codec
// divides by these.
Weights divisible(const Codec& codec, const Parameters& parameters, const BtfShape& shape,
                  const Weights& weights) {
  if (!codec.takes_weights() && !weights.all_equal()) {
    fail_input("--weights: codec {} takes none: its code-books are shared among all directions",
               codec.name());
  }
  Weights result = weights;
  if (weights.texels.empty() || !codec.separates_texels(parameters, shape)) return result;
  const auto split = rows_and_columns(weights.texels, shape.height, shape.width);
  if (!split) {
    fail_input(
        "--weights: of codec {}, rows and columns are modes of their own here, and these weights "
        "of texels are no products of those of rows and columns; --codec tucker --merge yx takes "
        "any",
        codec.name());
  }
  for (std::size_t p = 0; p < result.texels.size(); ++p) {
    result.texels[p] = split->first[p / shape.width] * split->second[p % shape.width];
  }
  return result;
}

}  // namespace

WeightedFit::WeightedFit(const Codec& codec, const Parameters& parameters, TileSource& source,
                         const Weights& weights, Job& job)
    : job_(job), info_(source.info()), held_before_(job.held.size()) {
  const Weights used = divisible(codec, parameters, info_.shape, weights);
  roots_ = square_roots(used);
  weighted_ = std::make_unique<WeightedSource>(source, used, codec.removes_mean(), job.nan_zero);
  const std::size_t bytes = weighted_->info().bytes();
  const bool in_memory = bytes <= job.memory / 4;
  job.held.push_back({"weighted input", weighted_->bytes() + (in_memory ? bytes : 0)});
  const StageTimer timer(job, "weights", 0, static_cast<double>(info_.bytes() + bytes));
  held_ = std::make_unique<HeldSource>(
      *weighted_, in_memory ? FloatStore::Place::memory : FloatStore::Place::file);
}

WeightedFit::~WeightedFit() {
  job_.held.resize(held_before_);
}

TileSource& WeightedFit::source() {
  return *held_;
}

void WeightedFit::undo(Model& model) const {
  model.info.btf = info_;
  model.divide(roots_);
  if (!weighted_->texel_scale().empty()) model.add_mean(weighted_->means());
}

void check_weights(const Codec& codec, const Parameters& parameters, const BtfShape& shape,
                   const Weights& weights) {
  divisible(codec, parameters, shape, weights);
}

}  // namespace weft
