// Weights as they are given to the program, `--weights cos,views=FILE.npy,texels=FILE.npy`, and as
// a model's metadata says which they were.
#pragma once

#include <string>
#include <string_view>

#include "weft/btf/weights.hpp"

namespace weft {

// Parts divided by commas, whose product is taken: `cos` (see cosine_weights) and NPY files of
// uint8, float16, float32 or float64, `views=FILE` [V], `lights=FILE` [L], `texels=FILE` [Y, X] of
// the BTF that `info` is of. Values are at least 0. Throws input errors that name --weights and the
// part, the file, the index and the value.
Weights read_weights(std::string_view text, const BtfInfo& info);

// {"given":"cos,texels=roi.npy","checksum":"..."}: the text without the files' folders, and 16 hex
// digits of XXH3-64 over the weights, which are those of a selection.
std::string weights_json(std::string_view text, const Weights& weights);

// What was given. Throws an input error that names `where` for text that weights_json did not make.
std::string given_weights(std::string_view json, std::string_view where);

// Whether weights of a selection are those that the text is of.
bool are_given(const Weights& weights, std::string_view json, std::string_view where);

}  // namespace weft
