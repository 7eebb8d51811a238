// Codecs from end to end, beside what their flops and bytes would cost at the machine's peaks.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "report.hpp"
#include "selection_options.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/device/device.hpp"
#include "weft/ops/peak.hpp"

namespace weft {

struct CodecBenchOptions {
  std::string filter;          // codecs whose row "codec NAME" contains it
  std::string input;           // a raw BTF; empty: a small weave is synthesised
  std::string rank;            // of codecs that have one; empty: their default
  SelectionOptions selection;  // of the input
  std::size_t memory = 0;
};

// The codecs whose row "codec NAME" contains the filter.
std::vector<const Codec*> codecs_matching(const std::string& filter);

// Adds the table `codecs`: encoding and measuring, three runs of each codec; and `codec_stages`,
// what each stage of a run took beside its bound.
void bench_codecs(Device& device, const ops::Peaks& peaks, const CodecBenchOptions& options,
                  Report& report);

}  // namespace weft
