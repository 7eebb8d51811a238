// Dissimilarities of windows and of code-vectors against structural similarity itself, and the
// device's search against the reference's at sizes about the vector width, the run and the
// percentile's rank.
#include "weft/ops/similar_code_vector.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/metrics/ssim.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/local_moments.hpp"
#include "weft/reference/vq_code_books.hpp"

namespace weft::test {
namespace {

// The window about a texel, and what is left of its similarity when the texel changes.
TEST(WindowDissimilarity, IsThatOfTheImages) {
  const std::size_t n = ssim_window;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Random random(seed);
    std::vector<double> x(n * n);
    for (double& value : x) value = 0.5 + (seed % 4 == 0 ? 0.01 : 0.4) * random.uniform(-1, 1);
    std::vector<double> y = x;
    const std::size_t centre = n * n / 2;
    y[centre] = random.uniform(-0.5, 1.5);
    LocalMoments moments(n, n, 1);
    moments.take_row(x, 0, n / 2);
    float mean = 0, deviation = 0;
    moments.about(n / 2, {&mean, 1}, {&deviation, 1});
    const double expected = 1 - ssim(n, n, 1, x, y, 1.0);
    // the moments are rounded to float: the dissimilarity's derivatives are below 2 / C2 of them
    EXPECT_NEAR(reference::window_dissimilarity(similarity_constants(), x[centre], double{mean},
                                                double{deviation}, y[centre]),
                expected, 4 * float_roundoff / similarity_constants().c2)
        << seed;
  }
}

// Beyond its edges an image goes on as in a mirror, also one that is smaller than the window.
TEST(LocalMoments, MirrorEdges) {
  const std::array<double, ssim_window> weights = ssim_weights();
  for (const auto& [height, width] :
       {std::pair<std::size_t, std::size_t>{1, 1}, {2, 3}, {5, 6}, {7, 12}, {13, 1}}) {
    const std::size_t channels = 2;
    const std::vector<float> floats = random_floats(height * width * channels, height, -1, 1);
    const std::vector<double> image(floats.begin(), floats.end());
    LocalMoments moments(height, width, channels);
    const auto mirrored = [](std::ptrdiff_t at, std::size_t size) {
      const auto last = static_cast<std::ptrdiff_t>(size) - 1;
      while (last > 0 && (at < 0 || at > last)) at = at < 0 ? -at : 2 * last - at;
      return last > 0 ? static_cast<std::size_t>(at) : 0;
    };
    for (std::size_t y = 0; y < height; ++y) {
      const LocalMoments::Band band = moments.band(y, y + 1);
      moments.take_row(std::span(image).subspan(band.first * width * channels,
                                                (band.end - band.first) * width * channels),
                       band.first, y);
      for (std::size_t x = 0; x < width; ++x) {
        std::array<float, 2> means{}, deviations{};
        moments.about(x, means, deviations);
        for (std::size_t c = 0; c < channels; ++c) {
          double mean = 0, square = 0;
          for (std::size_t t = 0; t < ssim_window * ssim_window; ++t) {
            const std::size_t row = mirrored(static_cast<std::ptrdiff_t>(y + t / ssim_window) -
                                                 static_cast<std::ptrdiff_t>(ssim_window / 2),
                                             height);
            const std::size_t column = mirrored(static_cast<std::ptrdiff_t>(x + t % ssim_window) -
                                                    static_cast<std::ptrdiff_t>(ssim_window / 2),
                                                width);
            const double weight = weights[t / ssim_window] * weights[t % ssim_window];
            const double value = image[(row * width + column) * channels + c];
            mean += weight * value;
            square += weight * value * value;
          }
          EXPECT_NEAR(means[c], mean, float_roundoff);
          // a root of what cancels
          EXPECT_NEAR(deviations[c], std::sqrt(std::max(square - mean * mean, 0.0)), 1e-7);
        }
      }
    }
  }
}

struct Problem {
  VectorShape shape;
  std::vector<float> rows, scales, means, deviations, code_vectors;
  ScaledVectors vectors() const { return {rows, scales, means, deviations}; }
};

// Code-vectors that are a few vectors, without their scale, and noise.
Problem random_problem(const VectorShape& shape, std::size_t vectors, std::size_t code_vectors,
                       std::uint64_t seed) {
  const std::size_t width = shape.values();
  Problem problem;
  problem.shape = shape;
  problem.rows = random_floats(vectors * width, seed, 0, 1);
  problem.means = random_floats(vectors * width, seed + 1, 0, 1);
  problem.deviations = random_floats(vectors * width, seed + 2, 0, 0.2);
  raise_deviations(problem.rows, problem.means, problem.deviations);
  for (std::size_t i = 0; i < vectors; ++i) {
    problem.scales.push_back(
        mean_magnitude(std::span(problem.rows).subspan(i * width, shape.luminances)));
  }
  const std::vector<float> noise = random_floats(code_vectors * width, seed + 3, -0.1, 0.1);
  for (std::size_t j = 0; j < code_vectors; ++j) {
    const std::size_t like = j % vectors;
    for (std::size_t k = 0; k < width; ++k) {
      const float scale = k < shape.luminances ? problem.scales[like] : 1.0F;
      const float value =
          problem.rows[like * width + k] + static_cast<float>(j) * noise[j * width + k];
      problem.code_vectors.push_back(value / std::max(scale, 1e-3F));
    }
  }
  return problem;
}

double dissimilarity(const Problem& problem, std::size_t vector, std::size_t code_vector,
                     double most = any_distance) {
  return reference::code_vector_dissimilarity(
      problem.shape, problem.vectors().vector(problem.shape, vector),
      problem.code_vectors.data() + code_vector * problem.shape.values(), most);
}

void expect_similar(const Problem& problem, ops::DeviceSimilarSearch& search,
                    double most = any_distance) {
  search.set(problem.shape, problem.code_vectors);
  const std::vector<std::uint32_t> found = search.nearest(problem.vectors(), most);
  reference::PlainSimilarSearch plain;
  plain.set(problem.shape, problem.code_vectors);
  const std::vector<std::uint32_t> expected = plain.nearest(problem.vectors(), any_distance);
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_LT(found[i], problem.code_vectors.size() / problem.shape.values()) << "vector " << i;
    const double least = dissimilarity(problem, i, expected[i]);
    if (least > most) continue;
    // of magnitudes of 1, a dozen roundings of what is divided by C1 C2 or more
    EXPECT_LE(dissimilarity(problem, i, found[i]),
              least + gamma(24, float_roundoff) * (least + 1 / 9e-4))
        << "vector " << i << ": " << found[i] << " instead of " << expected[i];
  }
}

// The 98th percentile: one value in fifty may be anything.
TEST(SimilarCodeVector, OutliersAreLeftOut) {
  const std::size_t width = 120;
  Problem problem = random_problem({width, 0}, 1, 1, 3);
  const double before = dissimilarity(problem, 0, 0);
  for (const std::size_t outliers : Sizes{1, 2, 3}) {
    problem.code_vectors[outliers * 7] = 1000;
    if (outliers <= 2) {
      EXPECT_LE(dissimilarity(problem, 0, 0), before + 0.01);
    } else {
      EXPECT_GT(dissimilarity(problem, 0, 0), 0.5);
      EXPECT_EQ(dissimilarity(problem, 0, 0, 0.5), any_distance);
    }
  }
  problem = random_problem({49, 0}, 1, 1, 3);
  problem.code_vectors[48] = 1000;
  EXPECT_GT(dissimilarity(problem, 0, 0), 0.5);
}

// The same difference counts less where the texture is rough.
TEST(SimilarCodeVector, RoughTextureMasks) {
  Problem problem = random_problem({30, 30}, 1, 1, 5);
  for (float& value : problem.code_vectors) value += 0.1F;
  std::fill(problem.deviations.begin(), problem.deviations.end(), 0.02F);
  raise_deviations(problem.rows, problem.means, problem.deviations);
  const double smooth = dissimilarity(problem, 0, 0);
  std::fill(problem.deviations.begin(), problem.deviations.end(), 0.4F);
  EXPECT_LT(dissimilarity(problem, 0, 0), 0.5 * smooth);
}

TEST(SimilarCodeVector, SmallSizesOfEveryKind) {
  Device& device = shared_device();
  const std::size_t lanes = ops::vector_width(device);
  ops::DeviceSimilarSearch search(device);
  for (const VectorShape& shape :
       {VectorShape{1, 0}, VectorShape{0, 2}, VectorShape{11, 0}, VectorShape{20, 29},
        VectorShape{25, 25}, VectorShape{lanes * 16, 0}, VectorShape{0, 257},
        VectorShape{lanes * 4 - 1, lanes * 12 + 2}}) {
    for (const std::size_t vectors : Sizes{1, lanes - 1, lanes, lanes + 1}) {
      for (const std::size_t code_vectors : Sizes{1, 2, 9, 40}) {
        if (is_simulator(device) &&
            (shape.values() > 60 || code_vectors == 40 || vectors > lanes)) {
          continue;
        }
        expect_similar(random_problem(shape, vectors, code_vectors, vectors + code_vectors),
                       search);
      }
    }
  }
}

TEST(SimilarCodeVector, ManyVectorsAndLongOnes) {
  ops::DeviceSimilarSearch search(shared_device());
  expect_similar(random_problem({121, 242}, 200, 60, 3), search);
  // several buffers of code-vectors: 64 MiB hold 16 of them
  expect_similar(random_problem({1 << 20, 0}, 2, 18, 5), search);
}

// What is not allowed need not be found; what is allowed is.
TEST(SimilarCodeVector, FindsWhatIsWithinALimit) {
  ops::DeviceSimilarSearch search(shared_device());
  for (const VectorShape& shape : {VectorShape{11, 0}, VectorShape{60, 80}}) {
    const Problem problem = random_problem(shape, 40, 60, 7);
    for (const double most : {0.0, 0.1, 0.5}) expect_similar(problem, search, most);
  }
}

// What is there comes back, the first of equal ones.
TEST(SimilarCodeVector, FindsItself) {
  for (const VectorShape& shape : {VectorShape{11, 0}, VectorShape{64, 128}}) {
    Problem problem = random_problem(shape, 60, 60, 9);
    const std::size_t width = shape.values();
    std::copy_n(problem.code_vectors.begin() + 17 * static_cast<std::ptrdiff_t>(width), width,
                problem.code_vectors.begin() + 50 * static_cast<std::ptrdiff_t>(width));
    problem.rows = problem.code_vectors;
    std::fill(problem.scales.begin(), problem.scales.end(), 1.0F);
    raise_deviations(problem.rows, problem.means, problem.deviations);
    ops::DeviceSimilarSearch search(shared_device());
    search.set(shape, problem.code_vectors);
    const std::vector<std::uint32_t> found = search.nearest(problem.vectors(), any_distance);
    for (std::uint32_t i = 0; i < 60; ++i) EXPECT_EQ(found[i], i == 50 ? 17 : i);
  }
}

// The kernels between guard zones.
TEST(SimilarCodeVector, SmallBuffersAreKept) {
  Device& device = shared_device();
  const std::size_t lanes = ops::vector_width(device);
  const SimilarityConstants constants = similarity_constants();
  const auto c1 = static_cast<float>(constants.c1);
  const auto centre = static_cast<float>(constants.centre);
  for (const bool is_short : {true, false}) {
    const std::size_t values = is_short ? 11 : 4 * lanes;
    const std::size_t count = 5;
    const Problem problem = random_problem({values, 0}, lanes, count, 4);
    std::vector<float> infinity(lanes, static_cast<float>(any_distance));
    const auto guarded = [&](const std::vector<float>& floats, const char* what) {
      return GuardedBuffer(device, std::span<const float>(floats), what);
    };
    const auto plane = [&](const std::vector<float>& rows) {
      return is_short ? transpose(std::span<const float>(rows), lanes, values) : rows;
    };
    GuardedBuffer x = guarded(plane(problem.rows), "vectors");
    std::vector<float> twice_means, twice_squares;
    for (const float mean : problem.means) {
      twice_means.push_back(static_cast<float>(2 * constants.centre * double{mean}));
    }
    for (const float deviation : problem.deviations) {
      twice_squares.push_back(
          static_cast<float>(2 * double{deviation} * double{deviation} + constants.c2));
    }
    GuardedBuffer means = guarded(plane(twice_means), "means");
    GuardedBuffer deviations = guarded(plane(twice_squares), "deviations");
    GuardedBuffer scales = guarded(problem.scales, "scales");
    GuardedBuffer code_vectors = guarded(problem.code_vectors, "code-vectors");
    GuardedBuffer best = guarded(infinity, "best");
    GuardedBuffer room(device, lanes * values * sizeof(float), "room");
    const std::vector<std::uint32_t> none(lanes, 0xffffffffU);
    GuardedBuffer index(device, std::span<const std::uint32_t>(none), "index");
    const cl_kernel kernel =
        device.kernel(kernel_sources::similar_code_vector, ops::vector_option(device),
                      is_short ? "similar_short_vector" : "similar_code_vector");
    if (is_short) {
      set_arguments(kernel, std::uint32_t{11}, std::uint32_t{11}, std::uint32_t{count},
                    std::uint32_t{3}, c1, centre, x.buffer(), means.buffer(), deviations.buffer(),
                    scales.buffer(), code_vectors.buffer(), best.buffer(), index.buffer());
      ops::launch_items(device, kernel, 1);
    } else {
      set_arguments(kernel, std::uint64_t{4}, std::uint64_t{4},
                    static_cast<std::uint32_t>(similarity_outliers(values)), std::uint32_t{count},
                    std::uint32_t{3}, c1, centre, x.buffer(), means.buffer(), deviations.buffer(),
                    scales.buffer(), code_vectors.buffer(), room.buffer(), best.buffer(),
                    index.buffer());
      ops::launch_items(device, kernel, lanes);
    }
    device.finish();
    for (GuardedBuffer* buffer :
         {&x, &means, &deviations, &scales, &code_vectors, &best, &room, &index}) {
      EXPECT_TRUE(buffer->intact());
    }
    const std::vector<std::uint32_t> found = index.values<std::uint32_t>();
    const std::vector<float> least = best.values<float>();
    for (std::size_t i = 0; i < lanes; ++i) {
      ASSERT_GE(found[i], 3U);
      ASSERT_LT(found[i], 3U + count);
      EXPECT_NEAR(least[i], dissimilarity(problem, i, found[i] - 3),
                  gamma(24, float_roundoff) / 9e-4)
          << i;
    }
  }
}

}  // namespace
}  // namespace weft::test
