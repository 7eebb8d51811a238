// Matrix products and packing against the reference, in every layout, at sizes about the micro-tile
// (4 x 24, or 8 x 48 on wider vectors; half as wide in double), the macro-tile (96 rows, up to 8
// panels), the depth of a block (384) and the rows that one work-item packs (64).
#include "weft/ops/gemm.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <ostream>
#include <string>
#include <vector>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/gemm.hpp"

namespace weft::test {
namespace {

enum class Layout { row_major, transposed, panelled };

struct Case {
  std::size_t M = 1;
  std::size_t N = 1;
  std::size_t K = 1;
  Layout a = Layout::row_major;
  Layout b = Layout::row_major;
  bool c_in_panels = false;
  double alpha = 1.0;
  double beta = 0.0;
};

std::ostream& operator<<(std::ostream& out, const Case& c) {
  const char* names[] = {"row-major", "transposed", "panelled"};
  return out << "M " << c.M << " N " << c.N << " K " << c.K << ", A "
             << names[static_cast<int>(c.a)] << ", B " << names[static_cast<int>(c.b)] << ", C "
             << (c.c_in_panels ? "in panels" : "row-major") << ", alpha " << c.alpha << ", beta "
             << c.beta;
}

template <typename Real>
constexpr Arithmetic arithmetic_of = sizeof(Real) == sizeof(float) ? Arithmetic::f32
                                                                   : Arithmetic::f64;

// A matrix as an operand in guarded memory, with unused room wherever the layout allows it.
template <typename Real>
class GuardedOperand {
 public:
  GuardedOperand(Device& device, const std::vector<Real>& matrix, std::size_t rows,
                 std::size_t columns, Layout layout)
      : buffer_(device, std::span<const Real>(stored(device, matrix, rows, columns, layout)),
                "operand") {
    switch (layout) {
      case Layout::row_major:
        operand = ops::row_major(device, buffer_.buffer(), columns + 3, 5, arithmetic_of<Real>);
        break;
      case Layout::transposed:
        operand = ops::transposed(device, buffer_.buffer(), rows + 3, 5, arithmetic_of<Real>);
        break;
      case Layout::panelled:
        operand = ops::panelled(device, buffer_.buffer(), rows, arithmetic_of<Real>);
    }
  }
  bool intact() { return static_cast<bool>(buffer_.intact()); }

  ops::Operand operand;

 private:
  static std::vector<Real> stored(Device& device, const std::vector<Real>& matrix, std::size_t rows,
                                  std::size_t columns, Layout layout) {
    if (layout == Layout::row_major) return with_leading(matrix, rows, columns, columns + 3, 5);
    if (layout == Layout::transposed) {
      return with_leading(transpose(matrix, rows, columns), columns, rows, rows + 3, 5);
    }
    return panels_of(matrix, rows, columns, ops::panel_width(device, arithmetic_of<Real>),
                     Real{unused});
  }

  GuardedBuffer buffer_;
};

template <typename Real>
struct Product {
  std::vector<Real> C;       // M x N
  std::vector<Real> stored;  // as it lies in the buffer
};

constexpr float untouched = -12345.0f;

template <typename Real>
Product<Real> multiply(const Case& c, const std::vector<Real>& A, const std::vector<Real>& B,
                       const std::vector<Real>& C) {
  Device& device = shared_device();
  const std::size_t width = ops::panel_width(device, arithmetic_of<Real>);
  GuardedOperand<Real> a(device, A, c.M, c.K, c.a);
  GuardedOperand<Real> b(device, B, c.K, c.N, c.b);
  GuardedBuffer packed(device,
                       ops::packed_elements(device, c.K, c.N, arithmetic_of<Real>) * sizeof(Real),
                       "packed B");
  ops::pack_panels(device, b.operand, c.K, c.N, packed.buffer());

  // C with room that has to stay as it is: past the rows' ends, or columns past the last panel's
  const std::size_t leading = c.N + 2;
  const std::size_t offset = 7;
  std::vector<Real> before = c.c_in_panels ? panels_of(C, c.M, c.N, width, Real{untouched})
                                           : with_leading(C, c.M, c.N, leading, offset);
  for (Real& value : before) {
    if (c.beta != 0 && std::isnan(value)) value = untouched;
  }
  GuardedBuffer out(device, std::span<const Real>(before), "C");
  ops::gemm_packed(device, c.M, c.N, c.K, c.alpha, a.operand, packed.buffer(), c.beta,
                   c.c_in_panels ? ops::to_panels(device, out.buffer(), c.M, arithmetic_of<Real>)
                                 : ops::to_row_major(device, out.buffer(), leading, offset,
                                                     arithmetic_of<Real>));

  Product<Real> result;
  result.stored = out.template values<Real>();
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(packed.intact());
  EXPECT_TRUE(a.intact());
  EXPECT_TRUE(b.intact());
  // what is not C is as before
  std::vector<Real> around = result.stored;
  if (c.c_in_panels) {
    result.C = from_panels(result.stored, c.M, c.N, width);
    for (std::size_t i = 0; i < c.M; ++i) {
      for (std::size_t j = 0; j < c.N; ++j) {
        const std::size_t at = (j / width * c.M + i) * width + j % width;
        around[at] = before[at];
      }
    }
  } else {
    result.C.resize(c.M * c.N);
    for (std::size_t i = 0; i < c.M; ++i) {
      for (std::size_t j = 0; j < c.N; ++j) {
        const std::size_t at = offset + i * leading + j;
        result.C[i * c.N + j] = result.stored[at];
        around[at] = before[at];
      }
    }
  }
  EXPECT_TRUE(same_bits(around, before));
  return result;
}

// Every product of small integers is exact, whatever the order of its sums.
template <typename Real>
void expect_exact_in(const Case& c) {
  const std::vector<Real> A = values_as<Real>(widened(random_integers(c.M * c.K, 1)));
  const std::vector<Real> B = values_as<Real>(widened(random_integers(c.K * c.N, 2)));
  // Where beta is 0, C holds NaN: it must not be read.
  const std::vector<Real> C = c.beta == 0 ? std::vector<Real>(c.M * c.N, Real{unused})
                                          : values_as<Real>(widened(random_integers(c.M * c.N, 3)));
  std::vector<double> expected(C.begin(), C.end());
  reference::gemm(c.M, c.N, c.K, c.alpha, std::vector<double>(A.begin(), A.end()),
                  std::vector<double>(B.begin(), B.end()), c.beta, expected);
  EXPECT_TRUE(all_equal(multiply(c, A, B, C).C, expected));
}
void expect_exact(const Case& c) {
  SCOPED_TRACE(testing::Message() << c);
  expect_exact_in<float>(c);
  expect_exact_in<double>(c);
}

TEST(Gemm, SmallInEveryLayout) {
  for (const Layout a : {Layout::row_major, Layout::transposed, Layout::panelled}) {
    for (const Layout b : {Layout::row_major, Layout::transposed}) {
      expect_exact({5, 27, 26, a, b, false, 2.0f, 0.0f});
      expect_exact({7, 24, 3, a, b, true, -1.0f, 0.5f});
    }
  }
}

TEST(Gemm, StraddlesTheMicroTile) {
  for (const std::size_t M : Sizes{1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17}) {
    for (const std::size_t N :
         Sizes{1, 7, 8, 9, 15, 16, 17, 23, 24, 25, 31, 32, 33, 47, 48, 49, 97}) {
      for (const Layout a : {Layout::row_major, Layout::transposed, Layout::panelled}) {
        expect_exact({M, N, 5, a, Layout::row_major, false, 1.0f, 0.0f});
        expect_exact({M, N, 5, a, Layout::row_major, true, 1.0f, 1.0f});
      }
    }
  }
}

TEST(Gemm, StraddlesTheMacroTile) {
  for (const std::size_t M : Sizes{95, 96, 97, 191, 193}) {
    for (const std::size_t N : Sizes{95, 96, 97, 200}) {
      for (const Layout a : {Layout::row_major, Layout::transposed, Layout::panelled}) {
        expect_exact({M, N, 31, a, Layout::row_major, false, 1.0f, -1.0f});
        expect_exact({M, N, 31, a, Layout::transposed, true, 1.0f, 0.0f});
      }
    }
  }
  // several tiles of the widest kind
  expect_exact({3, 4001, 30, Layout::row_major, Layout::row_major, false, 1.0f, 0.0f});
  expect_exact({3, 4001, 30, Layout::transposed, Layout::row_major, true, 1.0f, 1.0f});
  expect_exact({1000, 1, 30, Layout::panelled, Layout::row_major, false, 1.0f, 0.0f});
}

TEST(Gemm, StraddlesTheDepthOfABlock) {
  for (const std::size_t K : Sizes{1, 2, 23, 24, 25, 48, 49, 383, 384, 385, 409, 768, 769, 1000}) {
    for (const Layout a : {Layout::row_major, Layout::transposed, Layout::panelled}) {
      expect_exact({9, 25, K, a, Layout::row_major, false, 1.0f, 0.0f});
      expect_exact({9, 25, K, a, Layout::row_major, true, 0.5f, 2.0f});
    }
  }
}

TEST(Gemm, RoundingErrorIsBounded) {
  for (const std::size_t K : Sizes{1, 24, 384, 385, 2000}) {
    for (const Layout a : {Layout::row_major, Layout::transposed, Layout::panelled}) {
      const Case c{37, 50, K, a, Layout::row_major, false, -0.75, 1.25};
      SCOPED_TRACE(testing::Message() << c);
      const std::vector<float> A = random_floats(c.M * K, 4, -1.0, 1.0);
      const std::vector<float> B = random_floats(K * c.N, 5, -1.0, 1.0);
      const std::vector<float> C = random_floats(c.M * c.N, 6, -1.0, 1.0);
      std::vector<double> expected = widened(C);
      reference::gemm(c.M, c.N, K, c.alpha, widened(A), widened(B), c.beta, expected);
      std::vector<double> size = magnitudes(C);
      reference::gemm(c.M, c.N, K, std::abs(c.alpha), magnitudes(A), magnitudes(B),
                      std::abs(c.beta), size);
      EXPECT_TRUE(all_near(multiply(c, A, B, C).C, expected, [&](std::size_t i) {
        return gamma(static_cast<double>(ops::gemm_terms(shared_device(), K)), float_roundoff) *
               size[i];
      }));
    }
  }
}

TEST(Gemm, KeepsTheRangeOfFloat) {
  // 2^-140 is subnormal, 2^100 2^-130 is not, 2^120 2^7 is near the largest
  const std::vector<float> A{0x1p-140f, 0x1p100f, 0x1p120f, -0x1p-149f, 1e30f, 0.0f};
  const std::vector<float> B{1.0f, 0x1p-130f, 0x1p7f, 1e-30f};
  for (const Layout a : {Layout::row_major, Layout::transposed, Layout::panelled}) {
    const Case c{6, 4, 1, a, Layout::row_major, false, 1.0f, 0.0f};
    const Product<float> product = multiply(c, A, B, std::vector<float>(24, unused));
    for (std::size_t i = 0; i < 6; ++i) {
      for (std::size_t j = 0; j < 4; ++j) {
        EXPECT_EQ(product.C[i * 4 + j], A[i] * B[j]) << A[i] << " x " << B[j];
      }
    }
  }
}

// A NaN or an infinity in row i of A or column j of B reaches that row or column of C, and no
// other.
TEST(Gemm, NonFiniteValuesStayInTheirRowAndColumn) {
  for (const Layout a : {Layout::row_major, Layout::transposed, Layout::panelled}) {
    for (const float bad : {unused, std::numeric_limits<float>::infinity()}) {
      const Case c{11, 30, 26, a, Layout::row_major, false, 1.0f, 0.0f};
      std::vector<float> A = random_floats(c.M * c.K, 7, 0.5, 1.0);
      std::vector<float> B = random_floats(c.K * c.N, 8, 0.5, 1.0);
      A[9 * c.K + 25] = bad;
      B[3 * c.N + 28] = bad;
      const Product<float> product = multiply(c, A, B, std::vector<float>(c.M * c.N, unused));
      for (std::size_t i = 0; i < c.M; ++i) {
        for (std::size_t j = 0; j < c.N; ++j) {
          EXPECT_EQ(std::isfinite(product.C[i * c.N + j]), i != 9 && j != 28) << i << ", " << j;
        }
      }
    }
  }
}

TEST(Gemm, TheSameBitsWhateverTheTiles) {
  Device& device = shared_device();
  const std::size_t M = 203;
  const std::size_t N = 75;
  const std::size_t K = 500;
  const std::vector<float> A = random_floats(M * K, 9, -1.0, 1.0);
  const std::vector<float> B = random_floats(K * N, 10, -1.0, 1.0);
  GuardedBuffer a(device, std::span<const float>(A), "A");
  GuardedBuffer b(device, std::span<const float>(B), "B");
  const auto product = [&](std::size_t rows_at_once) {
    GuardedBuffer c(device, M * N * sizeof(float), "C");
    for (std::size_t i = 0; i < M; i += rows_at_once) {
      const std::size_t rows = std::min(rows_at_once, M - i);
      ops::gemm(device, rows, N, K, 0.75, ops::row_major(device, a.buffer(), K, i * K),
                ops::row_major(device, b.buffer(), N), 0.0f,
                ops::to_row_major(device, c.buffer(), N, i * N));
    }
    std::vector<float> values = c.values<float>();
    EXPECT_TRUE(c.intact());
    return values;
  };
  const std::vector<float> whole = product(M);
  EXPECT_TRUE(same_bits(product(M), whole));
  for (const std::size_t rows : Sizes{1, 50, 96, 97}) EXPECT_TRUE(same_bits(product(rows), whole));
}

// One packed matrix for a whole batch, or one for each, behind something else: the bits of single
// products.
TEST(Gemm, PackedMatricesOfABatchLieBehindAnOffsetOrAreShared) {
  Device& device = shared_device();
  const std::size_t M = 9, N = 50, K = 21, batch = 3;
  const std::vector<float> A = random_floats(batch * M * K, 9, -1.0, 1.0);
  const std::vector<float> B = random_floats((batch + 1) * K * N, 10, -1.0, 1.0);
  GuardedBuffer a(device, std::span<const float>(A), "A");
  GuardedBuffer b(device, std::span<const float>(B), "B");
  const std::size_t packed_values = ops::packed_elements(device, K, N);
  GuardedBuffer packed(device, (batch + 1) * packed_values * sizeof(float), "packed");
  ops::Operand all = ops::row_major(device, b.buffer(), N);
  all.batch = K * N;
  ops::pack_panels(device, all, K, N, packed.buffer(), batch + 1);
  for (const bool shared : {false, true}) {
    GuardedBuffer c(device, batch * M * N * sizeof(float), "C");
    ops::Operand rows = ops::row_major(device, a.buffer(), K);
    rows.batch = M * K;
    ops::Result result = ops::to_row_major(device, c.buffer(), N);
    result.batch = M * N;
    ops::gemm_packed(device, M, N, K, 1, rows, {packed.buffer(), packed_values, shared}, 0, result,
                     batch);
    const std::vector<float> found = c.values<float>();
    EXPECT_TRUE(c.intact());
    for (std::size_t i = 0; i < batch; ++i) {
      GuardedBuffer one(device, M * N * sizeof(float), "C");
      ops::gemm(device, M, N, K, 1, ops::row_major(device, a.buffer(), K, i * M * K),
                ops::row_major(device, b.buffer(), N, (shared ? 1 : i + 1) * K * N), 0,
                ops::to_row_major(device, one.buffer(), N));
      EXPECT_TRUE(all_equal(one.values<float>(), std::span(found).subspan(i * M * N, M * N)))
          << i << (shared ? ", shared" : "");
    }
  }
}

TEST(PackPanels, LayoutIsExactAndPaddedWithZero) {
  Device& device = shared_device();
  const std::size_t width = ops::panel_width(device);
  for (const std::size_t K : Sizes{1, 2, 63, 64, 65, 129}) {
    for (const std::size_t N : Sizes{1, 7, 23, 24, 25, 48, 50}) {
      for (const Layout layout : {Layout::row_major, Layout::transposed}) {
        SCOPED_TRACE(testing::Message() << "K " << K << " N " << N);
        const std::vector<float> B = random_floats(K * N, 11, -1.0, 1.0);
        GuardedOperand<float> b(device, B, K, N, layout);
        GuardedBuffer packed(device, ops::packed_elements(device, K, N) * sizeof(float), "packed");
        ops::pack_panels(device, b.operand, K, N, packed.buffer());
        EXPECT_TRUE(same_bits(packed.values<float>(), panels_of(B, K, N, width, 0.0f)));
        EXPECT_TRUE(packed.intact());
      }
    }
  }
}

}  // namespace
}  // namespace weft::test
