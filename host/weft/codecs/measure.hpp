// Errors are measured, not estimated: a model, as stored, is decoded and compared with its input.
#pragma once

#include "weft/btf/weights.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/metrics/error_sums.hpp"
#include "weft/metrics/ssim.hpp"

namespace weft {

// Structural similarity, where it is asked for besides the errors.
struct SimilarityRequest {
  double peak = 0;  // L; 0: psnr_peak of the data, for which float data is scanned first
  SsimSums sums;    // the answer, over all images
};

// Errors with weights, where they are asked for besides the plain ones.
struct WeightedErrors {
  const Weights& weights;  // of the source, each mode's of mean 1
  // The answer: sums of w T^2 and of w (T - T')^2, and the values' number, which is the sum of w.
  // The maxima know no weights.
  ErrorSums sums;
};

// Decodes all images on the device and compares them with `raw`, of the same shape, in one
// streaming pass; sums pooled over all values. 32-bit inputs are scanned for their range first.
ErrorSums measure_errors(Device& device, DeviceDecoder& decoder, TileSource& raw, Job& job,
                         SimilarityRequest* similarity = nullptr,
                         WeightedErrors* weighted = nullptr);

// The same by the reference.
ErrorSums measure_errors(ReferenceDecoder& decoder, TileSource& raw, Job& job,
                         SimilarityRequest* similarity = nullptr,
                         WeightedErrors* weighted = nullptr);

// Adds the errors of `images` images from the `first` on, both [images][P][C], by the reference.
void add_weighted_errors(const BtfShape& shape, std::size_t first, std::size_t images,
                         std::span<const double> raw, std::span<const double> decoded,
                         WeightedErrors& weighted);

// The sums of `raw` alone, in one pass; by the reference if the device is null. Throws the input
// error that names the first value that is NaN or infinite.
ErrorSums sums_of(Device* device, TileSource& raw, Job& job, WeightedErrors* weighted = nullptr);

// Adds the similarities of `images` decoded images to the raw ones, both [images][P][C], by the
// reference; `similarity.peak` is set.
void add_similarities(const BtfShape& shape, std::size_t images, std::span<const double> raw,
                      std::span<const double> decoded, SimilarityRequest& similarity);

// The peak that PSNR refers to: 1 for 8-bit data, the largest magnitude for float data (1 where
// that is zero).
double psnr_peak(const BtfInfo& info, const ErrorSums& sums);

}  // namespace weft
