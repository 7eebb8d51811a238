// Which codec to take for a goal, `--codec auto`: all of them are tried on a part of the source,
// and what came of it is foreseen for the whole.
//
// The part is the middle of the texels, at most 64 x 64 of them, under every n-th view and every
// n-th light, n the smallest that leaves no more than 2^21 values. A model of the whole is foreseen
// with the ranks, clusters and atoms of the part's: each of its tensors as much larger as the modes
// that it has; and its encoding with time in proportion to the values. Ranks grow with the
// directions: of goals by errors the middle quarter of the texels is tried as well, under those
// directions and under more of them, and what is foreseen from both tells the power of the images'
// number that the size grows with besides.
//
// The whole decides. Codecs that miss the goal there give way to the next, and so may the one that
// meets it: while a later one is foreseen to be smaller (or, of a goal that says the file's size,
// more accurate) than what was made, that one is made too, up to three in all.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "weft/codecs/compress.hpp"

namespace weft {

// What of the codecs that meet a goal is wanted first: a small file (or, of a goal that says the
// file's size, small errors), fast random look-ups, or fast encoding.
enum class Preference { size, decode, encode };

// "size" "decode" "encode".
std::string_view name_of(Preference preference);

struct CodecTrial {
  const Codec* codec = nullptr;
  bool met = false;           // the goal, by a model of the part
  double reached = 0;         // there, in the goal's kind; nan where nothing was
  double snr = 0;             // of that model, dB
  double bytes = 0;           // of a model of the whole, foreseen
  double encode_seconds = 0;  // of the whole, foreseen
  double lookups = 0;         // random ones per second, of that model
  std::string outcome;        // what came of it
};

struct CodecChoice {
  std::string part;                // "12 views x 12 lights x 64 x 64 texels"
  std::vector<CodecTrial> trials;  // of all codecs, those to be taken first before others
  CompressResult result;           // of the first of them, which was taken
};

// Throws the unmet goal, with what each codec reached, where none meets it.
CodecChoice compress_by_best(Device* device, TileSource& source, const CompressRequest& request,
                             Preference preference, Job& job);

// The bytes of a model with the ranks of `part` of a BTF of this shape.
double grown_bytes(const Model& part, const BtfShape& whole);

}  // namespace weft
