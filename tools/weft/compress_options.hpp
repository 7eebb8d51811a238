// What `weft compress` is asked for.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common.hpp"
#include "occlusion_options.hpp"
#include "report.hpp"
#include "selection_options.hpp"
#include "transform_options.hpp"
#include "weft/codecs/codec.hpp"

namespace weft {

struct CompressOptions {
  std::vector<std::string> inputs;
  std::string output;
  std::string into;   // the data base that materials are added to
  std::string names;  // of the materials of a data base; those of the files if empty
  std::string codec = "pca";
  Parameters parameters;
  std::string target;
  std::string prefer;   // size where nothing is given
  std::string storage;  // f16 where nothing is given
  TransformOptions transform;
  std::string nan = "error";
  std::uint64_t seed = 0;
  double peak = 0;  // 0: by the data's type
  bool ssim = false;
  std::string weights;
  bool log_error = false;
  OcclusionOptions occlusion;
  SelectionOptions selection;
  DeviceOptions device;
  OutputOptions report;
};

// Where there are several inputs, or materials have names: a data base.
inline bool makes_data_base(const CompressOptions& options) {
  return options.inputs.size() > 1 || !options.into.empty() || !options.names.empty();
}
void run_compress_base(const CompressOptions& options);

// The output's name, which ends in .weft, in a folder that is there.
void check_model_output(const std::string& output, const char* option);

}  // namespace weft
