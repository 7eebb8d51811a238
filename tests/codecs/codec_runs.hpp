// A codec of the table run either way, on the device or by the reference, for tests that hold for
// every codec.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "support/shared_device.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/codecs/compress.hpp"
#include "weft/codecs/measure.hpp"

namespace weft::test {

struct CodecRun {
  std::string codec;
  bool on_device = true;

  const Codec& get() const { return find_codec(codec); }

  std::unique_ptr<Model> encode(TileSource& source, const Parameters& parameters, Storage storage,
                                Job& job) const {
    return on_device ? get().encode(shared_device(), source, parameters, storage, job)
                     : get().encode_reference(source, parameters, storage, job);
  }
  std::unique_ptr<Model> encode(TileSource& source, const Parameters& parameters,
                                Storage storage) const {
    Job job;
    return encode(source, parameters, storage, job);
  }

  // The model that meets a goal, found as for `weft compress --target`.
  std::unique_ptr<Model> meet(TileSource& source, const std::string& target,
                              const Parameters& parameters = {},
                              Storage storage = Storage::f16) const {
    CompressRequest request;
    request.codec = &get();
    request.parameters = parameters;
    request.storage = storage_request(storage == Storage::f16 ? "f16" : "f32");
    request.goal = parse_goal(target, source.info());
    Job job;
    return compress(on_device ? &shared_device() : nullptr, source, request, job).model;
  }

  ErrorSums measure(const Model& model, TileSource& source, bool nan_zero = false) const {
    Job job;
    job.nan_zero = nan_zero;
    if (on_device) {
      return measure_errors(shared_device(), *get().decoder(shared_device(), model), source, job);
    }
    return measure_errors(*get().reference_decoder(model), source, job);
  }

  // All values of a model, decoded in runs of `run` images.
  std::vector<double> decode(const Model& model, std::size_t run) const {
    const BtfShape& shape = model.info.btf.shape;
    std::vector<double> values(shape.values());
    Buffer buffer(shared_device(), run * shape.image_values() * sizeof(float), "decoded");
    const auto device_decoder = on_device ? get().decoder(shared_device(), model) : nullptr;
    const auto reference = get().reference_decoder(model);
    for (std::size_t first = 0; first < shape.images(); first += run) {
      const std::size_t count = std::min(run, shape.images() - first);
      const std::span<double> out =
          std::span(values).subspan(first * shape.image_values(), count * shape.image_values());
      if (device_decoder) {
        std::vector<float> floats(out.size());
        device_decoder->decode(first, count, buffer);
        shared_device().read(buffer, std::span<float>(floats));
        std::copy(floats.begin(), floats.end(), out.begin());
      } else {
        reference->decode(first, count, out);
      }
    }
    return values;
  }
};

inline void PrintTo(const CodecRun& run, std::ostream* out) {
  *out << run.codec << (run.on_device ? " on the device" : " by the reference");
}

// Every codec of the table, both ways.
inline std::vector<CodecRun> every_run() {
  std::vector<CodecRun> runs;
  for (const Codec* codec : codecs()) {
    for (const bool on_device : {true, false}) {
      runs.push_back({std::string(codec->name()), on_device});
    }
  }
  return runs;
}

// The name of a run among a test's parameters.
inline std::string run_name(const testing::TestParamInfo<CodecRun>& info) {
  std::string name = info.param.codec + (info.param.on_device ? "_Device" : "_Reference");
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

// The bytes of all tensors of a model.
inline std::vector<std::byte> tensor_bytes(const Model& model) {
  std::vector<std::byte> bytes;
  for (const ModelTensor& tensor : model.tensors()) {
    bytes.insert(bytes.end(), tensor.values.begin(), tensor.values.end());
  }
  return bytes;
}

// Relative Frobenius error.
inline double relative(const ErrorSums& sums) {
  return std::sqrt(sums.square_difference / sums.square_reference);
}

}  // namespace weft::test
