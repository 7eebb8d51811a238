// A fit with weights by codecs that know of none: they fit s T, s = sqrt(w), and the factors of
// their models are divided by s (see weights.hpp).
//
// Where texels have weights and the codec takes a mean from them, the weighted mean is taken
// before, so that the model has all of its components for the rest:
//
//   T ~ m + (A B) / s      A B ~ s (T - m)      m = sum_p w_p T_p / sum_p w_p
#pragma once

#include <memory>

#include "weft/btf/weighted_source.hpp"
#include "weft/btf/weights.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/job.hpp"
#include "weft/model/model.hpp"

namespace weft {

class WeightedFit {
 public:
  // `source` must outlive it; the weights are of it, each mode's of mean 1. What is fitted is kept
  // in memory, or in a temporary file where it takes more than a quarter of job.memory. Throws an
  // input error where the codec can't divide by these weights: its rows and columns are modes of
  // their own, and those of texels are no products.
  WeightedFit(const Codec& codec, const Parameters& parameters, TileSource& source,
              const Weights& weights, Job& job);
  ~WeightedFit();
  WeightedFit(const WeightedFit&) = delete;
  WeightedFit& operator=(const WeightedFit&) = delete;

  // What the codec is to fit, unrounded.
  TileSource& source();

  // Makes a model of source() one of what the weights are of, unrounded.
  void undo(Model& model) const;

 private:
  Job& job_;
  BtfInfo info_;
  Weights roots_;
  std::size_t held_before_;
  std::unique_ptr<WeightedSource> weighted_;
  std::unique_ptr<TileSource> held_;
};

// Throws the input error for weights that the codec can't divide by.
void check_weights(const Codec& codec, const Parameters& parameters, const BtfShape& shape,
                   const Weights& weights);

}  // namespace weft
