// A model's real-valued tensors rounded to what its file will give back, so that the model in
// memory is the one that is read again, bit for bit.
#pragma once

#include <string>
#include <string_view>

#include "weft/model/model.hpp"

namespace weft {

// How a model is to be stored: `--storage f16|f32|q=BITS|auto[=SLACK]`.
struct StorageRequest {
  enum class Kind { half, single, bits, automatic };
  Kind kind = Kind::half;
  unsigned bits = 0;  // of every real-valued tensor
  // automatic: the relative error may be that of half storage times 1 + slack
  double slack = 0.01;

  // What an encoder rounds to before the model is stored like this.
  Storage fitted() const { return kind == Kind::half ? Storage::f16 : Storage::f32; }
};

// Throws an input error that names the option and the value.
StorageRequest storage_request(std::string_view text);

// What was done to a model: "f16", "f32", "q=8", or "q=5-11" for the least and the most bits.
std::string storage_text(const ModelInfo& info);

// All real-valued tensors are to be stored like this, none quantised.
void set_storage(Model& model, Storage storage);

// Rounds each tensor to half or float, as it is to be stored; see component_scale.hpp.
void round_to_storage(Model& model);

// Quantises every real-valued tensor to so many bits, each component by its largest magnitude.
void quantise_all(Model& model, unsigned bits);
// Those that are not quantised yet.
void quantise_others(Model& model, unsigned bits);

// Quantises one tensor, of the index n among the real-valued ones, with steps of its components, or
// the least of 16 bits where these are larger.
void quantise_tensor(Model& model, std::size_t n, std::span<const float> steps);

}  // namespace weft
