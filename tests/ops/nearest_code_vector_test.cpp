// Nearest code-vectors at sizes about the panel of vectors, the group of code-vectors and the run
// of values: the device's is as near as the reference's, within the rounding of scores.
#include "weft/ops/nearest_code_vector.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/vq_code_books.hpp"

namespace weft::test {
namespace {

struct Problem {
  VectorShape shape;
  std::vector<float> rows, scales, code_vectors;
};

// Luminances of the code-vectors have a mean magnitude of 1, those of vectors one that is their
// scale.
Problem random_problem(const VectorShape& shape, std::size_t vectors, std::size_t code_vectors,
                       std::uint64_t seed) {
  Problem problem{shape,
                  random_floats(vectors * shape.values(), seed, 0, 1),
                  {},
                  random_floats(code_vectors * shape.values(), seed + 1, 0, 1)};
  for (std::size_t i = 0; i < vectors; ++i) {
    problem.scales.push_back(
        mean_magnitude(std::span(problem.rows).subspan(i * shape.values(), shape.luminances)));
  }
  for (std::size_t j = 0; j < code_vectors; ++j) {
    const std::span<float> luminances =
        std::span(problem.code_vectors).subspan(j * shape.values(), shape.luminances);
    const float scale = mean_magnitude(luminances);
    for (float& value : luminances) value /= scale;
  }
  return problem;
}

void expect_nearest(const Problem& problem, NearestSearch& search) {
  const VectorShape& shape = problem.shape;
  search.set(shape, problem.code_vectors);
  const ScaledVectors vectors{problem.rows, problem.scales};
  const std::vector<std::uint32_t> found = search.nearest(vectors);
  const std::vector<std::uint32_t> expected =
      reference::nearest_code_vectors(shape, vectors, problem.code_vectors);
  ASSERT_EQ(found.size(), expected.size());
  const double infinity = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_LT(found[i], problem.code_vectors.size() / shape.values()) << "vector " << i;
    const auto distance = [&](std::uint32_t j) {
      return reference::code_vector_distance(
          shape, problem.rows.data() + i * shape.values(), problem.scales[i],
          problem.code_vectors.data() + j * shape.values(), infinity);
    };
    // a score is a sum of n products of magnitudes of 2 at most, in runs of 256, and of half as
    // much of squares; distances hold twice the score of either
    const double n = static_cast<double>(shape.values());
    const double terms = std::min(n, 256.0) + n / 256 + 4;
    EXPECT_LE(distance(found[i]), distance(expected[i]) + 4 * gamma(terms, float_roundoff) * 4 * n)
        << "vector " << i << ": " << found[i] << " instead of " << expected[i];
  }
}

TEST(NearestCodeVector, SmallSizesOfEveryKind) {
  Device& device = shared_device();
  const std::size_t lanes = ops::panel_width(device);
  ops::DeviceNearestSearch search(device);
  for (const VectorShape& shape : {VectorShape{1, 0}, VectorShape{0, 2}, VectorShape{11, 0},
                                   VectorShape{5, 10}, VectorShape{0, 257}, VectorShape{255, 3}}) {
    for (const std::size_t vectors : Sizes{1, lanes - 1, lanes + 1}) {
      for (const std::size_t code_vectors : Sizes{1, 7, 8, 9, 65}) {
        if (is_simulator(device) && (shape.values() > 20 || code_vectors == 65)) continue;
        expect_nearest(random_problem(shape, vectors, code_vectors, vectors + code_vectors),
                       search);
      }
    }
  }
}

TEST(NearestCodeVector, ManyVectorsAndLongOnes) {
  ops::DeviceNearestSearch search(shared_device());
  expect_nearest(random_problem({121, 242}, 1000, 300, 3), search);
  expect_nearest(random_problem({3000, 1100}, 100, 130, 4), search);
  // several buffers of code-vectors: 128 MiB hold 32 of them
  expect_nearest(random_problem({1 << 20, 0}, 3, 40, 5), search);
}

// Clusters of vectors, of very different contrast, near one code-vector each.
Problem clustered_problem(const VectorShape& shape, std::size_t vectors, std::size_t code_vectors,
                          std::uint64_t seed) {
  Problem problem = random_problem(shape, vectors, code_vectors, seed);
  const std::size_t width = shape.values();
  const std::vector<float> noise = random_floats(vectors * width, seed + 7, -0.02, 0.02);
  for (std::size_t j = 0; j < code_vectors; ++j) {
    for (std::size_t k = 0; k < width; ++k) {
      float& value = problem.code_vectors[j * width + k];
      const float contrast = 4.0F * static_cast<float>(j) / static_cast<float>(code_vectors);
      value = k < shape.luminances ? 1 + contrast * (value - 1) : contrast * value;
    }
  }
  for (std::size_t i = 0; i < vectors; ++i) {
    const std::size_t like = i * 7 % code_vectors;
    problem.scales[i] = 0.2F + 0.01F * static_cast<float>(i % 50);
    for (std::size_t k = 0; k < width; ++k) {
      const float scale = k < shape.luminances ? problem.scales[i] : 1.0F;
      problem.rows[i * width + k] =
          scale * problem.code_vectors[like * width + k] + noise[i * width + k];
    }
  }
  return problem;
}

// Code-vectors that are skipped are none that would be found.
TEST(NearestCodeVector, SkippingChangesNothing) {
  Device& device = shared_device();
  ops::DeviceNearestSearch pruned(device);
  ops::DeviceNearestSearch whole(device, false);
  for (const VectorShape& shape : {VectorShape{11, 0}, VectorShape{0, 2}, VectorShape{0, 22},
                                   VectorShape{121, 242}, VectorShape{1000, 24}}) {
    for (const bool clustered : {true, false}) {
      Problem problem =
          clustered ? clustered_problem(shape, 700, 900, 8) : random_problem(shape, 300, 500, 6);
      // equal ones, and one without luminance
      const auto width = static_cast<std::ptrdiff_t>(shape.values());
      std::copy_n(problem.code_vectors.begin() + 5 * width, width,
                  problem.code_vectors.begin() + 400 * width);
      std::fill_n(problem.rows.begin(), shape.luminances, 0.0F);
      problem.scales[0] = 0;
      const ScaledVectors vectors{problem.rows, problem.scales};
      pruned.set(shape, problem.code_vectors);
      whole.set(shape, problem.code_vectors);
      EXPECT_EQ(pruned.nearest(vectors, any_distance), whole.nearest(vectors, any_distance));
    }
  }
  expect_nearest(clustered_problem({11, 0}, 300, 500, 4), pruned);
}

// What is there comes back, the first of equal ones.
TEST(NearestCodeVector, FindsItself) {
  Problem problem = random_problem({64, 128}, 1, 200, 9);
  const std::size_t width = problem.shape.values();
  std::copy_n(problem.code_vectors.begin() + 17 * static_cast<std::ptrdiff_t>(width), width,
              problem.code_vectors.begin() + 90 * static_cast<std::ptrdiff_t>(width));
  ops::DeviceNearestSearch search(shared_device());
  search.set(problem.shape, problem.code_vectors);
  const std::vector<float> ones(200, 1.0f);
  const std::vector<std::uint32_t> found =
      search.nearest({problem.code_vectors, ones}, any_distance);
  for (std::uint32_t i = 0; i < 200; ++i) EXPECT_EQ(found[i], i == 90 ? 17 : i);
}

// A vector of no luminance is compared by its chromaticities.
TEST(NearestCodeVector, DarkVectors) {
  Problem problem = random_problem({6, 4}, 30, 20, 5);
  for (std::size_t i = 0; i < 30; ++i) {
    std::fill_n(problem.rows.begin() + static_cast<std::ptrdiff_t>(i * 10), 6, 0.0f);
    problem.scales[i] = 0;
  }
  ops::DeviceNearestSearch search(shared_device());
  expect_nearest(problem, search);
}

}  // namespace
}  // namespace weft::test
