#include "weft/reference/similar_code_vector.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "weft/metrics/ssim.hpp"

namespace weft {

SimilarityConstants similarity_constants() {
  static const double centre = ssim_weights()[ssim_window / 2];
  return {0.01 * 0.01, 0.03 * 0.03, centre * centre};
}

void raise_deviations(std::span<const float> rows, std::span<const float> means,
                      std::span<float> deviations) {
  const double w = similarity_constants().centre;
  const auto factor = static_cast<float>(std::sqrt(w / (1 - w)));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    deviations[i] = std::max(deviations[i], factor * std::abs(rows[i] - means[i]));
  }
}

double SimilarSearch::distance(const VectorShape& shape, const ScaledVectors& vector,
                               const float* code_vector, double most) const {
  return reference::code_vector_dissimilarity(shape, vector, code_vector, most);
}

double SimilarSearch::distance_of(double threshold, const VectorShape& /*shape*/) const {
  return threshold;
}

namespace reference {

double window_dissimilarity(const SimilarityConstants& constants, double x, double mean,
                            double deviation, double y) {
  const double w = constants.centre;
  const double d = y - x;
  const double p = w * w * d * d;
  const double q = w * (1 - w) * d * d;
  const double n = 2 * mean * (mean + w * d) + constants.c1;
  const double m = 2 * (deviation * deviation + w * d * (x - mean)) + constants.c2;
  return std::max((p * (m + q) + q * n) / ((n + p) * (m + q)), 0.0);
}

double code_vector_dissimilarity(const VectorShape& shape, const ScaledVectors& vector,
                                 const float* code_vector, double most) {
  const SimilarityConstants constants = similarity_constants();
  const std::size_t outliers = similarity_outliers(shape.values());
  const auto at = [&](std::size_t i) {
    const double scale = i < shape.luminances ? double{vector.scales[0]} : 1.0;
    return window_dissimilarity(constants, double{vector.rows[i]}, double{vector.means[i]},
                                double{vector.deviations[i]}, scale * double{code_vector[i]});
  };
  if (outliers == 0) {
    double largest = 0;
    for (std::size_t i = 0; i < shape.values() && largest <= most; ++i) {
      largest = std::max(largest, at(i));
    }
    return largest <= most ? largest : std::numeric_limits<double>::infinity();
  }
  // the outliers and the percentile, as a heap with the least in front
  std::vector<double> largest;
  largest.reserve(outliers + 1);
  for (std::size_t i = 0; i < shape.values(); ++i) {
    const double dissimilarity = at(i);
    if (largest.size() > outliers) {
      if (dissimilarity <= largest.front()) continue;
      std::pop_heap(largest.begin(), largest.end(), std::greater<>());
      largest.back() = dissimilarity;
    } else {
      largest.push_back(dissimilarity);
    }
    std::push_heap(largest.begin(), largest.end(), std::greater<>());
    if (largest.size() > outliers && largest.front() > most) {
      return std::numeric_limits<double>::infinity();
    }
  }
  return largest.front();
}

void PlainSimilarSearch::set(const VectorShape& shape, std::span<const float> code_vectors) {
  shape_ = shape;
  code_vectors_.assign(code_vectors.begin(), code_vectors.end());
}

std::vector<std::uint32_t> PlainSimilarSearch::nearest(const ScaledVectors& vectors, double most) {
  const std::size_t width = shape_.values();
  std::vector<std::uint32_t> nearest(vectors.scales.size(), 0);
  for (std::size_t i = 0; i < nearest.size(); ++i) {
    const ScaledVectors vector = vectors.vector(shape_, i);
    double least = most;
    bool found = false;
    for (std::size_t j = 0; j * width < code_vectors_.size(); ++j) {
      const double distance =
          code_vector_dissimilarity(shape_, vector, code_vectors_.data() + j * width, least);
      if (distance > least || (found && distance == least)) continue;
      least = distance;
      found = true;
      nearest[i] = static_cast<std::uint32_t>(j);
    }
  }
  return nearest;
}

}  // namespace reference
}  // namespace weft
