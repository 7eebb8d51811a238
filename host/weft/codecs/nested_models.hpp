// Models of several sizes that are cut of one decomposition: a larger rank contains the smaller
// ones, and so a goal takes one decomposition and some measuring (meet_goal.hpp).
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "weft/model/model.hpp"

namespace weft {

// Squared singular values of the data's modes, descending; none of modes that are not looked at.
using ModeSpectra = std::vector<std::vector<double>>;

// What a decomposition is to hold.
struct NestedRequest {
  double relative = 0;  // models with |T - T'| / |T| down to this; 0: by their size
  double wanted = 0;    // that a goal is about; `relative` is more when a decomposition missed it
  std::size_t values = 0;  // or models of up to so many numbers
  double growth = 1;       // of a codec's own first guess, where what it came to was too little
  double squares = 0;      // |T|^2
  Storage storage = Storage::f16;  // that models are to be rounded to
  bool steps = false;              // whether steps of quantisation are searched for besides
  // What the decomposition before this one found, where it does not change: see
  // NestedModels::spectra.
  std::shared_ptr<const ModeSpectra> spectra;
};

// The models, from the smallest to the largest.
class NestedModels {
 public:
  virtual ~NestedModels() = default;

  // At least 1.
  virtual std::size_t count() const = 0;
  // Model i with its tensors as they were found: they are to be rounded to what its info says. Its
  // selection and its errors are left to the caller.
  virtual std::unique_ptr<Model> model(std::size_t i) const = 0;
  // Numbers in model i; does not descend with i.
  virtual std::size_t values(std::size_t i) const = 0;
  // |T - T'| / |T| of model i as foreseen, before it is rounded; does not ascend with i.
  virtual double error(std::size_t i) const = 0;
  // Whether no other decomposition, with the given parameters, can hold more accurate models than
  // the last; and what forbids them, a parameter or the data.
  virtual bool complete() const = 0;
  virtual std::string bound() const = 0;
  // Decompositions that it took.
  virtual std::size_t decompositions() const { return 1; }
  // Whether a decomposition of fewer numbers holds better models of so many than this one's cuts.
  virtual bool cuts_lose() const { return false; }
  // What a larger decomposition of the same data need not find again; null where there is nothing.
  virtual std::shared_ptr<const ModeSpectra> spectra() const { return nullptr; }
};

}  // namespace weft
