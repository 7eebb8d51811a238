// Mode products and Gram matrices against the reference, for modes first, in the middle and last,
// at sizes about the panel and the rows that a work-item packs.
#include "weft/ops/mode_product.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/reference/mode_product.hpp"

namespace weft::test {
namespace {

using Tensor = std::vector<std::size_t>;

std::vector<float> product_on_device(const Tensor& sizes, std::size_t mode,
                                     const std::vector<float>& T, ops::ModeProduct kind,
                                     const std::vector<float>& U, std::size_t other) {
  Device& device = shared_device();
  const ops::ModeView view = ops::mode_view(sizes, mode);
  GuardedBuffer in(device, std::span<const float>(T), "T");
  GuardedBuffer factor(device, std::span<const float>(U), "U");
  GuardedBuffer out(device, view.outer * other * view.inner * sizeof(float), "product");
  ops::mode_product(device, view, in.buffer(), kind, factor.buffer(), other, out.buffer());
  const std::vector<float> values = out.values<float>();
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(in.intact());
  return values;
}

void expect_product(const Tensor& sizes, std::size_t mode, std::size_t rank) {
  SCOPED_TRACE(testing::PrintToString(sizes) + " mode " + std::to_string(mode) + " rank " +
               std::to_string(rank));
  const std::size_t n = sizes[mode];
  const std::vector<float> U = random_floats(n * rank, 7, -1, 1);  // [n][rank]
  for (const ops::ModeProduct kind : {ops::ModeProduct::project, ops::ModeProduct::expand}) {
    const bool projects = kind == ops::ModeProduct::project;
    Tensor from = sizes;
    from[mode] = projects ? n : rank;
    const std::vector<float> T = random_floats(reference::elements_of(from), 5, -1, 1);
    const std::size_t rows = projects ? rank : n;
    const auto expected = [&](const std::vector<double>& t, const std::vector<double>& u) {
      return reference::mode_product(from, mode, t, rows,
                                     projects ? reference::transposed(n, rank, u) : u);
    };
    const std::vector<double> bounds = expected(magnitudes(T), magnitudes(U));
    const std::vector<double> wanted = expected(widened(T), widened(U));
    const std::vector<float> found = product_on_device(from, mode, T, kind, U, rows);
    const double terms =
        gamma(static_cast<double>(ops::product_terms(shared_device(), from[mode])), 0x1p-24);
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      ASSERT_NEAR(double{found[i]}, wanted[i], terms * bounds[i]) << "at " << i;
    }
  }
}

void expect_gram(const Tensor& sizes, std::size_t mode, Arithmetic arithmetic) {
  SCOPED_TRACE(testing::PrintToString(sizes) + " mode " + std::to_string(mode));
  Device& device = shared_device();
  const std::vector<float> T = random_floats(reference::elements_of(sizes), 5, -1, 1);
  GuardedBuffer in(device, std::span<const float>(T), "T");
  ops::ModeGram gram(device, sizes[mode], arithmetic);
  const ops::ModeView view = ops::mode_view(sizes, mode);
  // twice: parts are added
  gram.add(in.buffer(), view);
  gram.add(in.buffer(), view);
  EXPECT_TRUE(in.intact());
  const std::vector<double> wanted = reference::mode_gram(sizes, mode, widened(T));
  const std::vector<double> bounds = reference::mode_gram(sizes, mode, magnitudes(T));
  ops::ProductOptions options;
  options.arithmetic = arithmetic;
  const double n =
      static_cast<double>(ops::product_terms(device, view.outer * view.inner, options) + 1);
  const double unit = arithmetic == Arithmetic::f32 ? 0x1p-24 : 0x1p-53;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    ASSERT_NEAR(gram.matrix()[i], 2 * wanted[i], 2 * n * unit / (1 - n * unit) * bounds[i])
        << "at " << i;
  }
}

TEST(ModeProduct, SmallTensors) {
  for (const Tensor& sizes : {Tensor{1, 1, 1}, Tensor{2, 3, 4}, Tensor{5, 9, 7}}) {
    for (std::size_t mode = 0; mode < 3; ++mode) {
      expect_product(sizes, mode, 1);
      expect_product(sizes, mode, 2);
      expect_gram(sizes, mode, Arithmetic::f32);
    }
  }
}

TEST(ModeProduct, SizesAboutThePanel) {
  const std::size_t width = ops::panel_width(shared_device());
  for (const std::size_t n : {width - 1, width, width + 1, 3 * width + 5}) {
    for (const Tensor& sizes : {Tensor{n, 5, 7}, Tensor{3, n, 7}, Tensor{3, 5, n}, Tensor{2, n, n},
                                Tensor{4, 1, n}, Tensor{n, 1, 1}}) {
      for (std::size_t mode = 0; mode < 3; ++mode) {
        for (const std::size_t rank : {std::size_t{1}, n / 2, n + 1}) {
          expect_product(sizes, mode, rank);
        }
      }
    }
  }
}

// Neighbours behind the mode from fewer to more than a panel's vectors and a work-item's strips;
// modes deeper than a block of the sum.
TEST(ModeProduct, SizesAboutStrips) {
  const std::size_t lanes = ops::vector_width(shared_device());
  const std::size_t width = ops::panel_width(shared_device());
  for (const std::size_t inner : {2 * lanes - 1, 2 * lanes, 2 * lanes + 1, width + lanes,
                                  width + 2 * lanes, 8 * width - 1, 8 * width, 8 * width + 1}) {
    for (const std::size_t n : {std::size_t{7}, std::size_t{9}}) {
      expect_product({3, n, inner}, 1, n - 1);
      expect_gram({3, n, inner}, 1, Arithmetic::f32);
    }
  }
  for (const std::size_t n : {std::size_t{383}, std::size_t{385}, std::size_t{800}}) {
    expect_product({2, n, 65}, 1, 9);
  }
}

// Panels as they are packed, zeros past the last column too, which no product shows.
TEST(PackMode, SmallPanelsArePaddedWithZeros) {
  Device& device = shared_device();
  const std::size_t width = ops::panel_width(device);
  const Tensor sizes{2, width + 2, 11};
  const std::vector<float> T = random_floats(reference::elements_of(sizes), 5, 1, 2);
  GuardedBuffer in(device, std::span<const float>(T), "T");
  for (const std::size_t inner : {std::size_t{1}, std::size_t{3}, std::size_t{11}}) {
    // the same values as [outer][n][inner]
    const std::size_t n = sizes[1];
    const std::size_t rows = T.size() / n / inner * inner;
    const std::size_t panels = ops::ceil_div(n, width);
    GuardedBuffer out(device, panels * rows * width * sizeof(float), "panels");
    const cl_kernel kernel = device.kernel(kernel_sources::pack_mode,
                                           ops::vector_option(device) + " -DROWS=5", "pack_mode");
    set_arguments(kernel, in.buffer(), ops::ulong(n), ops::ulong(inner), ops::ulong(0),
                  ops::ulong(rows), out.buffer());
    ops::launch_items(device, kernel, panels, ops::ceil_div(rows, 5));
    const std::vector<float> found = out.values<float>();
    EXPECT_TRUE(out.intact());
    for (std::size_t i = 0; i < found.size(); ++i) {
      const std::size_t j = i / (rows * width) * width + i % width;
      const std::size_t k = i / width % rows;
      const float wanted = j < n ? T[(k / inner * n + j) * inner + k % inner] : 0.0f;
      ASSERT_EQ(found[i], wanted) << "inner " << inner << " at " << i;
    }
  }
}

TEST(ModeProduct, FourAndFiveModes) {
  const Tensor sizes{4, 3, 5, 6, 2};
  for (std::size_t mode = 0; mode < sizes.size(); ++mode) {
    expect_product(sizes, mode, 3);
    expect_gram(sizes, mode, Arithmetic::f32);
  }
}

TEST(ModeGram, SizesAboutPanelsAndPackedRows) {
  const std::size_t width = ops::panel_width(shared_device());
  std::vector<Arithmetic> arithmetics{Arithmetic::f32};
  if (shared_device().limits().has_fp64) arithmetics.push_back(Arithmetic::f64);
  for (const Arithmetic arithmetic : arithmetics) {
    for (const std::size_t n : {std::size_t{3}, width - 1, width, width + 1}) {
      // 511 to 1025 rows in items of 512; rows that begin and end inside a tensor's row
      for (const Tensor& sizes : {Tensor{n, 511, 1}, Tensor{n, 512, 1}, Tensor{513, n, 1},
                                  Tensor{1, n, 1025}, Tensor{9, n, 77}, Tensor{64, n, 8}}) {
        expect_gram(sizes, sizes[0] == n && sizes[2] == 1 ? 0 : 1, arithmetic);
      }
    }
  }
}

// More rows than are packed at a time: 8 MiB of panels.
TEST(ModeGram, ManyRows) {
  expect_gram({7, 20, 8000}, 1, Arithmetic::f32);
  expect_gram({50000, 20, 1}, 1, Arithmetic::f32);
}

}  // namespace
}  // namespace weft::test
