// Errors are measured, not estimated: a model, as stored, is decoded and compared with its input.
#pragma once

#include "weft/codecs/codec.hpp"
#include "weft/metrics/error_sums.hpp"

namespace weft {

// Decodes all images on the device and compares them with `raw`, of the same shape, in one
// streaming pass; sums pooled over all values. Float inputs are scanned for their range first.
ErrorSums measure_errors(Device& device, DeviceDecoder& decoder, TileSource& raw, Job& job);

// The same by the reference.
ErrorSums measure_errors(ReferenceDecoder& decoder, TileSource& raw, Job& job);

// The peak that PSNR refers to: 1 for 8-bit data, the largest magnitude for float data (1 where
// that is zero).
double psnr_peak(const BtfInfo& info, const ErrorSums& sums);

}  // namespace weft
