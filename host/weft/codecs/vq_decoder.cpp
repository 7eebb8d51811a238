#include "weft/codecs/vq_decoder.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "weft/device/tile_stream.hpp"
#include "weft/ops/decode_vq.hpp"
#include "weft/reference/vq.hpp"

namespace weft {
namespace {

class VqDeviceDecoder final : public DeviceDecoder {
 public:
  VqDeviceDecoder(Device& device, const VqModel& model) : device_(device), tables_(device, model) {}

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    const std::size_t bytes = ops::vq_entry_floats(tables_, count) * sizeof(float);
    if (entries_.size() < bytes) {
      device_.finish();
      entries_ = Buffer();
      entries_ = Buffer(device_, bytes, "apparent BRDFs in some images");
    }
    ops::decode_vq(device_, tables_, first, count, entries_, out);
  }

  double image_flops() const override {
    return ops::vq_entry_flops(tables_) * static_cast<double>(tables_.size) +
           static_cast<double>(tables_.shape.texels());
  }

 private:
  Device& device_;
  ops::VqTables tables_;
  Buffer entries_;
};

class VqDeviceSampler final : public DeviceSampler {
 public:
  VqDeviceSampler(Device& device, const VqModel& model)
      : device_(device), tables_(device, model), takes_directions_(model.takes_directions()) {}

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    validate(lookup, tables_.shape, takes_directions_);
    ops::look_up_vq(device_, {lookup, tables_.shape, count, lookups, out}, tables_);
  }

  double lookup_flops(const LookupShape& lookup) const override {
    const std::size_t taps = lookup.texels * lookup.views * lookup.lights;
    return static_cast<double>(taps) *
           (ops::vq_entry_flops(tables_) + 2.0 * static_cast<double>(tables_.shape.channels));
  }

 private:
  Device& device_;
  ops::VqTables tables_;
  bool takes_directions_;
};

class VqReferenceDecoder final : public ReferenceDecoder {
 public:
  explicit VqReferenceDecoder(const VqModel& model) : model_(model) {}
  void decode(std::size_t first, std::size_t count, std::span<double> out) override {
    reference::decode_vq(model_, first, count, out);
  }

 private:
  const VqModel& model_;
};

// The largest magnitude of each row of a code-book, from those of the rows below.
std::vector<double> largest_of_rows(const VqCodeBook& book, std::size_t width,
                                    const std::vector<double>& below) {
  std::vector<double> largest(book.scales.size() / width, 0.0);
  for (std::size_t i = 0; i < book.scales.size(); ++i) {
    double& of_row = largest[i / width];
    of_row = std::max(of_row, std::abs(double{book.scales[i]}) * below[book.entries[i]]);
  }
  return largest;
}

}  // namespace

std::unique_ptr<DeviceDecoder> vq_decoder(Device& device, const VqModel& model) {
  return std::make_unique<VqDeviceDecoder>(device, model);
}

std::size_t vq_decoder_bytes(const VqModel& model) {
  return ops::VqTables::bytes(model) + image_granule(model.info.btf.shape) * model.sizes.p4 *
                                           (1 + model.chromaticities) * sizeof(float);
}

std::unique_ptr<DeviceSampler> vq_sampler(Device& device, const VqModel& model) {
  return std::make_unique<VqDeviceSampler>(device, model);
}

std::size_t vq_sampler_bytes(const VqModel& model) {
  return ops::VqTables::bytes(model);
}

std::unique_ptr<ReferenceDecoder> vq_reference_decoder(const VqModel& model) {
  return std::make_unique<VqReferenceDecoder>(model);
}

// A value is a sum of 16 terms at most, with weights that sum to 1. A term is a product of 4
// weights, each of which is rounded and taken from 1, 4 scales and a value, and the 16 are summed:
// fewer than 40 roundings of what the largest value is. Products of subnormal numbers may round by
// half a step of 2^-149 beside, which the texel's scale multiplies.
double vq_decode_tolerance(const VqModel& model) {
  std::vector<double> slices(model.sizes.p1, 0.0);
  const std::size_t n_beta = model.grid.sizes.beta;
  for (std::size_t i = 0; i < model.p1.size(); ++i) {
    slices[i / n_beta] = std::max(slices[i / n_beta], std::abs(double{model.p1[i]}));
  }
  const std::vector<double> p2 = largest_of_rows(model.p2, model.grid.sizes.alpha, slices);
  const std::size_t per_pair = model.chromaticities > 0 ? 2 : 1;
  std::vector<double> pairs(model.sizes.m);
  for (std::size_t i = 0; i < pairs.size(); ++i) pairs[i] = p2[model.m[i * per_pair]];
  const std::vector<double> p3 = largest_of_rows(model.p3, model.grid.sizes.theta, pairs);
  const std::vector<double> p4 = largest_of_rows(model.p4, model.grid.sizes.phi, p3);
  double largest = 0;
  double largest_scale = 0;
  for (std::size_t p = 0; p < model.p6.scales.size(); ++p) {
    const double scale = std::abs(double{model.p6.scales[p]});
    largest = std::max(largest, scale * p4[model.p6.entries[p]]);
    largest_scale = std::max(largest_scale, scale);
  }
  for (const float value : model.c) largest = std::max(largest, std::abs(double{value}));
  constexpr double roundings = 40;
  constexpr double unit = 0x1p-24;
  return roundings * unit / (1 - roundings * unit) * largest +
         roundings * (1 + largest_scale) * 0x1p-149;
}

}  // namespace weft
