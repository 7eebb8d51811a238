// Nearest code-vectors at sizes about the panel of vectors, the group of code-vectors and the run
// of values: the device's is as near as the reference's, within the rounding of scores.
#include "weft/ops/nearest_code_vector.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <string>
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

// The kernels between guard zones: rows about the panel, values about the run, code-vectors about a
// group and a block, packed in an order that is not theirs.
TEST(NearestCodeVector, SmallBuffersAreKept) {
  Device& device = shared_device();
  const std::size_t lanes = ops::panel_width(device);
  const std::size_t group = ops::vector_width(device) == 16 ? 8 : 4;
  const std::size_t block = 8 * group;
  const std::string options = ops::vector_option(device);
  const auto kernel = [&](const char* name) {
    return device.kernel(kernel_sources::nearest_code_vector, options, name);
  };
  const auto word = [](std::size_t size) { return static_cast<std::uint32_t>(size); };
  for (const std::size_t values : Sizes{1, 15, 17, 255, 256, 257}) {
    if (is_simulator(device) && values > 17) continue;
    for (const std::size_t count : Sizes{1, block - 1, block, block + 1}) {
      if (is_simulator(device) && count < block && count > 1) continue;
      const std::size_t luminances = values - values / 3;
      const std::size_t vectors = count % 2 == 0 ? lanes : lanes - 1;
      const Problem problem = random_problem({luminances, values / 3}, vectors, count, values);
      const auto packed_rows = [&](const std::vector<float>& rows, const std::vector<float>& scales,
                                   std::size_t width, GuardedBuffer& packed) {
        const std::size_t here = rows.size() / values;
        std::vector<std::uint32_t> reversed(here);
        for (std::size_t i = 0; i < here; ++i) reversed[i] = word(here - 1 - i);
        std::vector<float> in_order(scales.rbegin(), scales.rend());
        GuardedBuffer raw(device, std::span<const float>(rows), "rows");
        GuardedBuffer factors(device, std::span<const float>(in_order), "scales");
        GuardedBuffer numbers(device, std::span<const std::uint32_t>(reversed), "numbers");
        set_arguments(kernel("pack_vectors"), std::uint64_t{luminances}, std::uint64_t{values},
                      std::uint64_t{here}, std::uint64_t{width}, std::uint32_t{1}, raw.buffer(),
                      factors.buffer(), numbers.buffer(), packed.buffer());
        ops::launch_items(device, kernel("pack_vectors"), ops::ceil_div(values, 256),
                          ops::ceil_div(here, width));
        for (GuardedBuffer* buffer : {&raw, &factors, &numbers, &packed}) {
          EXPECT_TRUE(buffer->intact());
        }
      };
      // vectors, in the reverse order, padded with zeros
      GuardedBuffer packed(device, lanes * values * sizeof(float), "vectors");
      packed_rows(problem.rows, problem.scales, lanes, packed);
      const std::vector<float> laid = packed.values<float>();
      for (std::size_t lane = 0; lane < lanes; ++lane) {
        for (std::size_t k = 0; k < values; ++k) {
          const std::size_t i = vectors - 1 - lane;
          const float x = lane < vectors ? problem.rows[i * values + k] : 0;
          const float scale = lane < vectors ? problem.scales[i] : 0;
          EXPECT_FLOAT_EQ(laid[k * lanes + lane], k < luminances ? scale * (x - scale) : x);
        }
      }
      // half the squares of code-vectors
      const std::vector<float> ones(count, 1.0F);
      GuardedBuffer rows(device, std::span<const float>(problem.code_vectors), "code-vectors");
      GuardedBuffer squares(device, 2 * count * sizeof(float), "squares");
      GuardedBuffer unit(device, std::span<const float>(ones), "ones");
      set_arguments(kernel("half_squares"), std::uint64_t{luminances}, std::uint64_t{values},
                    std::uint32_t{0}, rows.buffer(), unit.buffer(), squares.buffer());
      ops::launch_items(device, kernel("half_squares"), count);
      EXPECT_TRUE(rows.intact());
      EXPECT_TRUE(squares.intact());
      const std::vector<float> halves = squares.values<float>();
      for (std::size_t j = 0; j < count; ++j) {
        std::array<double, 2> expected{};
        for (std::size_t k = 0; k < values; ++k) {
          const double x = problem.code_vectors[j * values + k] - (k < luminances ? 1.0 : 0.0);
          expected[k < luminances ? 0 : 1] += 0.5 * x * x;
        }
        for (std::size_t part = 0; part < 2; ++part) {
          // of differences that are rounded once, squares and sums of at most a run
          EXPECT_NEAR(
              halves[2 * j + part], expected[part],
              gamma(static_cast<double>(values) + 4, float_roundoff) * (expected[part] + 1));
        }
      }
      // the search, in the order of the numbers
      const std::size_t groups = ops::ceil_div(count, group);
      GuardedBuffer code_vectors(device, groups * group * values * sizeof(float), "packed");
      packed_rows(problem.code_vectors, ones, group, code_vectors);
      std::vector<float> padded(groups * group * 2, 1e30F);
      std::vector<std::uint32_t> numbers(groups * group, 0);
      for (std::size_t j = 0; j < count; ++j) {
        numbers[j] = word(count - 1 - j);
        std::copy_n(halves.begin() + static_cast<std::ptrdiff_t>(2 * (count - 1 - j)), 2,
                    padded.begin() + static_cast<std::ptrdiff_t>(2 * j));
      }
      std::vector<float> scales(problem.scales.rbegin(), problem.scales.rend());
      scales.resize(lanes, 0);
      const auto guarded = [&](const auto& contents, const char* what) {
        return GuardedBuffer(device, std::span(contents), what);
      };
      GuardedBuffer padded_squares = guarded(padded, "squares");
      GuardedBuffer order = guarded(numbers, "numbers");
      GuardedBuffer factors = guarded(scales, "scales");
      const std::vector<float> nothing(2 * lanes, 0.0F);
      GuardedBuffer norms = guarded(nothing, "norms");
      const std::vector<std::uint32_t> zero{0};
      GuardedBuffer start = guarded(zero, "start");
      const std::vector<float> none(8, 0.0F);
      GuardedBuffer ranges = guarded(none, "ranges");
      const std::vector<float> worst(lanes, -std::numeric_limits<float>::infinity());
      GuardedBuffer best = guarded(worst, "best");
      const std::vector<std::uint32_t> first(lanes, 0);
      GuardedBuffer index = guarded(first, "index");
      set_arguments(kernel("nearest_code_vector"), std::uint64_t{values}, std::uint64_t{groups},
                    std::uint32_t{100}, std::uint32_t{0}, packed.buffer(), factors.buffer(),
                    norms.buffer(), start.buffer(), code_vectors.buffer(), padded_squares.buffer(),
                    order.buffer(), ranges.buffer(), best.buffer(), index.buffer());
      ops::launch_items(device, kernel("nearest_code_vector"), 1);
      for (GuardedBuffer* buffer : {&packed, &factors, &norms, &start, &code_vectors,
                                    &padded_squares, &order, &ranges, &best, &index}) {
        EXPECT_TRUE(buffer->intact());
      }
      const std::vector<std::uint32_t> found = index.values<std::uint32_t>();
      const std::vector<std::uint32_t> expected = reference::nearest_code_vectors(
          problem.shape, {problem.rows, problem.scales}, problem.code_vectors);
      for (std::size_t lane = 0; lane < vectors; ++lane) {
        const std::size_t i = vectors - 1 - lane;
        ASSERT_GE(found[lane], 100U);
        ASSERT_LT(found[lane], 100U + count);
        const auto distance = [&](std::uint32_t j) {
          return reference::code_vector_distance(
              problem.shape, problem.rows.data() + i * values, problem.scales[i],
              problem.code_vectors.data() + j * values, any_distance);
        };
        const double n = static_cast<double>(values);
        EXPECT_LE(distance(found[lane] - 100),
                  distance(expected[i]) + 16 * n * gamma(n + 4, float_roundoff));
      }
    }
  }
}

}  // namespace
}  // namespace weft::test
