// The search for the smallest model that meets a goal by its errors, or the most accurate one that
// meets it by its size. Models are cut of one decomposition (nested_models.hpp): the errors that it
// foresees say where to look, and models are stored and measured until one meets the goal and the
// next smaller one misses it. Where the largest misses, a larger decomposition follows. Where steps
// of quantisation are searched for too, larger models with coarser steps may take fewer bytes, or
// err less in as many: some are tried (least_error.hpp).
#pragma once

#include <cstddef>
#include <functional>
#include <limits>
#include <memory>
#include <string>

#include "weft/codecs/codec.hpp"
#include "weft/codecs/goal.hpp"
#include "weft/codecs/nested_models.hpp"
#include "weft/metrics/error_sums.hpp"
#include "weft/model/file_sizer.hpp"

namespace weft {

struct MeasuredModel {
  ErrorReport errors;
  double lowest_ssim = std::numeric_limits<double>::quiet_NaN();  // of the images, where measured
};

// What a compression does, step by step; see compress.hpp.
struct GoalSteps {
  // A decomposition; null where the codec's models are not nested.
  std::function<std::unique_ptr<NestedModels>(const NestedRequest& request)> decompose;
  // A model of the codec by its own search, of the parameter target=TARGET.
  std::function<std::unique_ptr<Model>(const std::string& target)> encode;
  // Makes a model what its file will give back, stored as `storage` where that is its user's
  // choice.
  std::function<void(Model& model, Storage storage)> store;
  // Where steps of quantisation are searched for and the goal says a squared error, else null: the
  // same with as coarse steps as the goal allows, and in float, which says whether there are any.
  std::function<void(Model& model)> store_to_goal = nullptr;
  std::function<void(Model& model)> store_floats = nullptr;
  // Where steps are searched for and the goal is a size, else null: the same with as fine steps as
  // its bytes allow; false where they do not allow any.
  std::function<bool(Model& model)> store_to_size = nullptr;
  // Errors of a stored model that the goal is about.
  std::function<MeasuredModel(const Model& model)> measure;
  FileSizer* sizer = nullptr;  // of the models' files; null: one of the search's own
};

struct GoalSource {
  std::size_t bytes = 0;           // of the raw tensor
  double squares = 0;              // |T|^2
  double root_mean_square = 0;     // of T
  double peak = 1;                 // of the PSNR
  Storage storage = Storage::f16;  // that models are fitted for
  double value_bytes = 2;          // of a number in the file, about
  std::size_t storing_bytes = 0;   // of memory, that storing a number takes beside the number
  bool may_widen = false;          // whether float may take the place of half that misses the goal
};

struct GoalResult {
  std::unique_ptr<Model> model;  // stored
  MeasuredModel measured;
  double reached = 0;              // in the goal's kind
  std::size_t decompositions = 0;  // that were made
  std::size_t trials = 0;          // models that were measured
  double decompose_seconds = 0;    // of the last decomposition
};

// Throws the unmet goal, with what was reached and what forbids more.
GoalResult meet_goal(const Goal& goal, const GoalSource& source, const GoalSteps& steps, Job& job);

}  // namespace weft
