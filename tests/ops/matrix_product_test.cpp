// General products against the reference, in float and double and in both families of kernels:
// every transpose, leading dimensions, scalars, batches, both triangles; at sizes about the
// micro-tile, the panel and the tile in local memory (64 x 64, depth 16, blocks of 512).
#include "weft/ops/matrix_product.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include "ops/matrices.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/gemm_tiled.hpp"
#include "weft/reference/gemm.hpp"

namespace weft::test {
namespace {

using ops::Family;
using ops::Transpose;
using ops::Triangle;

struct Case {
  std::size_t M = 1;
  std::size_t N = 1;
  std::size_t K = 1;
  bool a_transposed = false;
  bool b_transposed = false;
  double alpha = 1;
  double beta = 0;
  std::size_t batch = 1;
};

std::ostream& operator<<(std::ostream& out, const Case& c) {
  return out << "M " << c.M << " N " << c.N << " K " << c.K << (c.a_transposed ? ", A^T" : "")
             << (c.b_transposed ? ", B^T" : "") << ", alpha " << c.alpha << ", beta " << c.beta
             << ", batch " << c.batch;
}

Transpose transpose_if(bool yes) {
  return yes ? Transpose::yes : Transpose::no;
}

// Matrices of a batch, one after the other: rows x columns at a leading dimension of 3 more, behind
// 5 unused values each.
template <typename Real>
class GuardedBatch {
 public:
  GuardedBatch(const std::vector<Real>& values, std::size_t rows, std::size_t columns,
               std::size_t batch)
      : leading(columns + 3), stride(rows * leading + 5), rows_(rows), columns_(columns) {
    stored.assign(batch * stride, Real{unused});
    for (std::size_t b = 0; b < batch; ++b) {
      for (std::size_t i = 0; i < rows * columns; ++i) {
        stored[at(b, i)] = values[b * rows * columns + i];
      }
    }
    // nothing follows the last value
    if (rows * columns > 0 && batch > 0) stored.resize(at(batch - 1, rows * columns - 1) + 1);
    if (stored.empty()) stored.resize(1, Real{unused});
    buffer =
        std::make_unique<GuardedBuffer>(shared_device(), std::span<const Real>(stored), "matrices");
  }
  std::size_t at(std::size_t b, std::size_t i) const {
    return 5 + b * stride + i / columns_ * leading + i % columns_;
  }
  ops::ConstMatrix view() { return {buffer->buffer(), leading, 5, stride}; }
  ops::Matrix result() { return {buffer->buffer(), leading, 5, stride}; }
  // The matrices as they are now; what lies between them has to be as it was.
  std::vector<Real> values(std::size_t batch) {
    std::vector<Real> now = buffer->template values<Real>();
    std::vector<Real> result(batch * rows_ * columns_);
    for (std::size_t b = 0; b < batch; ++b) {
      for (std::size_t i = 0; i < rows_ * columns_; ++i) {
        result[b * rows_ * columns_ + i] = now[at(b, i)];
        now[at(b, i)] = stored[at(b, i)];
      }
    }
    EXPECT_TRUE(same_bits(now, stored));
    EXPECT_TRUE(buffer->intact());
    return result;
  }

  std::size_t leading;
  std::size_t stride;
  std::vector<Real> stored;
  std::unique_ptr<GuardedBuffer> buffer;

 private:
  std::size_t rows_;
  std::size_t columns_;
};

template <typename Real_, Family family_>
struct Form {
  using Real = Real_;
  static constexpr Family family = family_;
};

template <typename F>
class MatrixProduct : public testing::Test {
 public:
  using Real = typename F::Real;
  static constexpr double roundoff = sizeof(Real) == 4 ? float_roundoff : double_roundoff;

  // The simulator is given small tiles, of which a work-group of 16 still waits at barriers.
  void SetUp() override {
    if (F::family == Family::tiles && is_simulator(shared_device())) {
      shared_device().tune(tunables::gemm_tiled, {16, 16, 8, 4, 4, 2, 2}, "test");
    }
  }

  static ops::ProductOptions options(std::size_t batch = 1) {
    return {sizeof(Real) == 4 ? Arithmetic::f32 : Arithmetic::f64, F::family, batch};
  }

  // `matrix` as it is stored.
  static std::vector<Real> stored(const std::vector<Real>& matrix, std::size_t rows,
                                  std::size_t columns, std::size_t batch, bool transposed) {
    if (!transposed) return matrix;
    std::vector<Real> result;
    for (std::size_t b = 0; b < batch; ++b) {
      const std::vector<Real> one = transpose(
          std::span<const Real>(matrix).subspan(b * rows * columns, rows * columns), rows, columns);
      result.insert(result.end(), one.begin(), one.end());
    }
    return result;
  }

  // op(A), op(B) and C of each matrix of the batch, one after the other.
  static std::vector<Real> multiply(const Case& c, const std::vector<Real>& A,
                                    const std::vector<Real>& B, const std::vector<Real>& C) {
    GuardedBatch<Real> a(stored(A, c.M, c.K, c.batch, c.a_transposed), c.a_transposed ? c.K : c.M,
                         c.a_transposed ? c.M : c.K, c.batch);
    GuardedBatch<Real> b(stored(B, c.K, c.N, c.batch, c.b_transposed), c.b_transposed ? c.N : c.K,
                         c.b_transposed ? c.K : c.N, c.batch);
    GuardedBatch<Real> out(C, c.M, c.N, c.batch);
    ops::gemm(shared_device(), transpose_if(c.a_transposed), transpose_if(c.b_transposed), c.M, c.N,
              c.K, c.alpha, a.view(), b.view(), c.beta, out.result(), options(c.batch));
    EXPECT_TRUE(a.buffer->intact());
    EXPECT_TRUE(b.buffer->intact());
    return out.values(c.batch);
  }

  static std::vector<double> expected(const Case& c, const std::vector<double>& A,
                                      const std::vector<double>& B, const std::vector<double>& C) {
    std::vector<double> result;
    for (std::size_t b = 0; b < c.batch; ++b) {
      const auto part = [&](const std::vector<double>& X, std::size_t size) {
        return std::span<const double>(X).subspan(b * size, size);
      };
      std::vector<double> one(c.M * c.N);
      std::ranges::copy(part(C, c.M * c.N), one.begin());
      reference::gemm(c.M, c.N, c.K, c.alpha, part(A, c.M * c.K), part(B, c.K * c.N), c.beta, one);
      result.insert(result.end(), one.begin(), one.end());
    }
    return result;
  }

  static void expect_exact(const Case& c) {
    SCOPED_TRACE(testing::Message() << c);
    const std::vector<double> A = widened(random_integers(c.batch * c.M * c.K, 1));
    const std::vector<double> B = widened(random_integers(c.batch * c.K * c.N, 2));
    // Where beta is 0, C holds NaN: it must not be read.
    const std::vector<double> C = c.beta == 0
                                      ? std::vector<double>(c.batch * c.M * c.N, double{unused})
                                      : widened(random_integers(c.batch * c.M * c.N, 3));
    EXPECT_TRUE(all_equal(multiply(c, values_as<Real>(A), values_as<Real>(B), values_as<Real>(C)),
                          expected(c, A, B, C)));
  }

  // C = alpha op(A) op(A)^T + beta C with op(A): M x K.
  static std::vector<Real> square(const Case& c, Triangle triangle, const std::vector<Real>& A,
                                  const std::vector<Real>& C) {
    GuardedBatch<Real> a(stored(A, c.M, c.K, c.batch, c.a_transposed), c.a_transposed ? c.K : c.M,
                         c.a_transposed ? c.M : c.K, c.batch);
    GuardedBatch<Real> out(C, c.M, c.M, c.batch);
    ops::syrk(shared_device(), triangle, transpose_if(c.a_transposed), c.M, c.K, c.alpha, a.view(),
              c.beta, out.result(), options(c.batch));
    EXPECT_TRUE(a.buffer->intact());
    return out.values(c.batch);
  }

  static std::vector<double> expected_square(const Case& c, Triangle triangle,
                                             const std::vector<double>& A,
                                             const std::vector<double>& C) {
    std::vector<double> transposed;
    for (std::size_t b = 0; b < c.batch; ++b) {
      const std::vector<double> one =
          transpose(std::span<const double>(A).subspan(b * c.M * c.K, c.M * c.K), c.M, c.K);
      transposed.insert(transposed.end(), one.begin(), one.end());
    }
    std::vector<double> result =
        expected({c.M, c.M, c.K, false, false, c.alpha, c.beta, c.batch}, A, transposed, C);
    // the other triangle stays as it was
    for (std::size_t at = 0; at < result.size(); ++at) {
      const std::size_t i = at / c.M % c.M;
      const std::size_t j = at % c.M;
      if (triangle == Triangle::lower ? j > i : j < i) result[at] = C[at];
    }
    return result;
  }

  static void expect_exact_square(const Case& c, Triangle triangle) {
    SCOPED_TRACE(testing::Message() << c << (triangle == Triangle::lower ? ", lower" : ", upper"));
    const std::vector<double> A = widened(random_integers(c.batch * c.M * c.K, 4));
    std::vector<double> C = widened(random_integers(c.batch * c.M * c.M, 5));
    std::vector<double> result = expected_square(c, triangle, A, C);
    if (c.beta == 0) {
      for (std::size_t at = 0; at < C.size(); ++at) {
        const std::size_t i = at / c.M % c.M;
        const std::size_t j = at % c.M;
        if (triangle == Triangle::lower ? j <= i : j >= i) C[at] = double{unused};
      }
    }
    EXPECT_TRUE(all_equal(square(c, triangle, values_as<Real>(A), values_as<Real>(C)), result));
  }

  static void expect_exact_everywhere(const Case& c) {
    for (const bool a : {false, true}) {
      for (const bool b : {false, true}) {
        expect_exact({c.M, c.N, c.K, a, b, c.alpha, c.beta, c.batch});
      }
    }
  }

  static void expect_exact_squares(const Case& c) {
    for (const bool a : {false, true}) {
      for (const Triangle triangle : {Triangle::lower, Triangle::upper}) {
        expect_exact_square({c.M, c.M, c.K, a, false, c.alpha, c.beta, c.batch}, triangle);
      }
    }
  }
};

using Forms = testing::Types<Form<float, Family::panels>, Form<double, Family::panels>,
                             Form<float, Family::tiles>, Form<double, Family::tiles>>;
TYPED_TEST_SUITE(MatrixProduct, Forms);

TYPED_TEST(MatrixProduct, SmallInEveryTranspose) {
  this->expect_exact_everywhere({5, 27, 18, false, false, 2, 0});
  this->expect_exact_everywhere({9, 3, 9, false, false, -1, 0.5, 2});
}

TYPED_TEST(MatrixProduct, SmallSquares) {
  this->expect_exact_squares({5, 5, 9, false, false, 2, 0});
  this->expect_exact_squares({26, 26, 17, false, false, -1, 0.5, 2});
}

TYPED_TEST(MatrixProduct, StraddlesTiles) {
  for (const std::size_t M : Sizes{1, 7, 8, 9, 63, 64, 65, 130}) {
    for (const std::size_t N : Sizes{1, 23, 24, 25, 47, 48, 49, 63, 64, 65, 130}) {
      this->expect_exact_everywhere({M, N, 5, false, false, 1, 0});
    }
  }
  this->expect_exact_everywhere({97, 400, 33, false, false, 1, 1});
}

TYPED_TEST(MatrixProduct, StraddlesDepths) {
  for (const std::size_t K :
       Sizes{1, 2, 7, 8, 9, 15, 16, 17, 63, 64, 65, 383, 385, 511, 512, 513, 1025, 4000}) {
    this->expect_exact_everywhere({9, 50, K, false, false, 1, 0});
    this->expect_exact_everywhere({9, 50, K, false, false, 0.5, 2});
  }
}

TYPED_TEST(MatrixProduct, SquaresStraddleTiles) {
  for (const std::size_t n :
       Sizes{1, 2, 3, 4, 7, 8, 9, 23, 24, 25, 47, 48, 49, 63, 64, 65, 97, 193, 400}) {
    this->expect_exact_squares({n, n, 5, false, false, 1, 0});
    this->expect_exact_squares({n, n, 19, false, false, 0.5, -2});
  }
}

TYPED_TEST(MatrixProduct, SquaresStraddleDepths) {
  for (const std::size_t K : Sizes{1, 239, 240, 241, 480, 481, 512, 513, 3839, 3840, 3841, 20000}) {
    this->expect_exact_squares({11, 11, K, false, false, 1, 0});
    this->expect_exact_squares({60, 60, K, false, false, 1, 1});
  }
}

TYPED_TEST(MatrixProduct, Batches) {
  for (const std::size_t batch : Sizes{1, 2, 7, 300}) {
    this->expect_exact_everywhere({6, 25, 13, false, false, 1, 0, batch});
    this->expect_exact_squares({6, 6, 13, false, false, 1, 0.5, batch});
  }
}

// Long enough that panels are packed part by part.
TYPED_TEST(MatrixProduct, PartsOfLargeMatrices) {
  this->expect_exact({2, 700, 12000, false, false, 1, 0});
  this->expect_exact({2, 50, 90000, false, true, 1, 1, 2});
  this->expect_exact_square({250, 250, 30000, false, false, 1, 0}, Triangle::lower);
}

TYPED_TEST(MatrixProduct, EmptySizesAndZeroScalars) {
  for (const bool transposed : {false, true}) {
    this->expect_exact({0, 5, 3, transposed, transposed, 1, 2});
    this->expect_exact({5, 0, 3, transposed, transposed, 1, 2});
    this->expect_exact({5, 4, 3, transposed, transposed, 1, 2, 0});
    // a sum of nothing
    this->expect_exact({5, 4, 0, transposed, transposed, 1, 0, 2});
    this->expect_exact({5, 4, 0, transposed, transposed, 1, 2, 2});
    this->expect_exact({5, 4, 3, transposed, transposed, 0, 0});
    this->expect_exact({5, 4, 3, transposed, transposed, 0, 2});
  }
  for (const std::size_t n : Sizes{0, 5}) {
    this->expect_exact_squares({n, n, 0, false, false, 1, 2, 2});
    this->expect_exact_squares({n, n, 0, false, false, 1, 0});
    this->expect_exact_squares({n, n, 3, false, false, 0, 2});
  }
}

TYPED_TEST(MatrixProduct, RoundingErrorIsBounded) {
  using Real = typename TestFixture::Real;
  for (const std::size_t K : Sizes{1, 17, 500, 3000, 30000}) {
    const Case c{20, 30, K, false, true, -0.75, 1.25};
    SCOPED_TRACE(testing::Message() << c);
    const std::vector<Real> A = values_as<Real>(random_values(c.M * K, 6, -1.0, 1.0));
    const std::vector<Real> B = values_as<Real>(random_values(K * c.N, 7, -1.0, 1.0));
    const std::vector<Real> C = values_as<Real>(random_values(c.M * c.N, 8, -1.0, 1.0));
    const auto wide = [](const std::vector<Real>& X) {
      return std::vector<double>(X.begin(), X.end());
    };
    Case absolute = c;
    absolute.alpha = 0.75;
    const std::vector<double> size =
        this->expected(absolute, magnitudes(A), magnitudes(B), magnitudes(C));
    const double terms =
        static_cast<double>(ops::product_terms(shared_device(), K, this->options()));
    const double bound =
        gamma(terms, this->roundoff) + gamma(static_cast<double>(K) + 2, double_roundoff);
    EXPECT_TRUE(all_near(this->multiply(c, A, B, C), this->expected(c, wide(A), wide(B), wide(C)),
                         [&](std::size_t i) { return bound * size[i]; }));
    // long sums don't pile up their errors
    EXPECT_LE(terms, 700 + static_cast<double>(K) / 120);

    const Case s{20, 20, K, false, false, -0.75, 1.25};
    absolute = s;
    absolute.alpha = 0.75;
    const std::vector<Real> S(C.begin(), C.begin() + 400);
    const std::vector<double> square_size =
        this->expected_square(absolute, Triangle::lower, magnitudes(A), magnitudes(S));
    EXPECT_TRUE(all_near(this->square(s, Triangle::lower, A, S),
                         this->expected_square(s, Triangle::lower, wide(A), wide(S)),
                         [&](std::size_t i) { return bound * square_size[i]; }));
  }
}

// A NaN or an infinity in row i of A or column j of B reaches that row or column of C, and no
// other.
TYPED_TEST(MatrixProduct, NonFiniteValuesStayInTheirRowAndColumn) {
  using Real = typename TestFixture::Real;
  for (const double bad : {double{unused}, std::numeric_limits<double>::infinity()}) {
    const Case c{70, 66, 600, true, false, 1, 0};
    std::vector<double> A = random_values(c.M * c.K, 9, 0.5, 1.0);
    std::vector<double> B = random_values(c.K * c.N, 10, 0.5, 1.0);
    A[65 * c.K + 599] = bad;
    B[3 * c.N + 64] = bad;
    const std::vector<Real> C = this->multiply(c, values_as<Real>(A), values_as<Real>(B),
                                               std::vector<Real>(c.M * c.N, Real{unused}));
    std::size_t wrong = 0;
    for (std::size_t i = 0; i < c.M; ++i) {
      for (std::size_t j = 0; j < c.N; ++j) {
        wrong += std::isfinite(C[i * c.N + j]) != (i != 65 && j != 64);
      }
    }
    EXPECT_EQ(wrong, 0U);
  }
}

TYPED_TEST(MatrixProduct, OneMatrixForAWholeBatch) {
  using Real = typename TestFixture::Real;
  const std::size_t batch = 3;
  const Case c{6, 10, 7, false, false, 1, 0, batch};
  const std::vector<double> A = widened(random_integers(batch * 42, 11));
  const std::vector<double> one = widened(random_integers(70, 12));
  std::vector<double> B;
  for (std::size_t b = 0; b < batch; ++b) B.insert(B.end(), one.begin(), one.end());
  GuardedBatch<Real> a(values_as<Real>(A), 6, 7, batch);
  GuardedBatch<Real> b(values_as<Real>(one), 7, 10, 1);
  GuardedBatch<Real> out(std::vector<Real>(batch * 60, Real{unused}), 6, 10, batch);
  ops::ConstMatrix shared = b.view();
  shared.stride = 0;
  ops::gemm(shared_device(), Transpose::no, Transpose::no, 6, 10, 7, 1, a.view(), shared, 0,
            out.result(), this->options(batch));
  EXPECT_TRUE(
      all_equal(out.values(batch), this->expected(c, A, B, std::vector<double>(batch * 60))));
}

TYPED_TEST(MatrixProduct, TheSameBitsAgain) {
  using Real = typename TestFixture::Real;
  const Case c{100, 120, 900, false, false, 1, 0};
  const std::vector<Real> A = values_as<Real>(random_values(c.M * c.K, 13, -1.0, 1.0));
  const std::vector<Real> B = values_as<Real>(random_values(c.K * c.N, 14, -1.0, 1.0));
  const std::vector<Real> C(c.M * c.N, Real{0});
  EXPECT_TRUE(same_bits(this->multiply(c, A, B, C), this->multiply(c, A, B, C)));
}

TYPED_TEST(MatrixProduct, MatricesThatDoNotFitAreRefused) {
  using Real = typename TestFixture::Real;
  Device& device = shared_device();
  Buffer small(device, 12 * sizeof(Real), "small");
  const auto multiply = [&](const ops::ConstMatrix& A, std::size_t M, std::size_t batch = 1) {
    Buffer C(device, 12 * sizeof(Real), "C");
    ops::gemm(device, Transpose::no, Transpose::no, M, 3, 4, 1, A, {small, 3}, 0, {C, 3},
              this->options(batch));
  };
  multiply({small, 4}, 3);
  const std::size_t huge = std::numeric_limits<std::size_t>::max();
  expect_error(ErrorKind::input, {"matrix A"}, [&] { multiply({small, 3}, 3); });
  expect_error(ErrorKind::input, {"matrix A"}, [&] { multiply({small, 4, 1}, 3); });
  expect_error(ErrorKind::input, {"matrix A"}, [&] { multiply({small, huge}, 3); });
  expect_error(ErrorKind::input, {"matrix A"}, [&] { multiply({small, 4, huge}, 3); });
  expect_error(ErrorKind::input, {"matrix A"}, [&] { multiply({small, 4, 0, huge}, 3, 2); });
  expect_error(ErrorKind::input, {"matrix A"}, [&] { multiply({small, 4}, 4); });
}

// Every way to share a tile among work-items and vectors.
TEST(TileMacros, GiveTheSameProduct) {
  Device& device = shared_device();
  const std::vector<std::size_t> before = device.tuning().values(tunables::gemm_tiled);
  using Float = MatrixProduct<Form<float, Family::tiles>>;
  using Double = MatrixProduct<Form<double, Family::tiles>>;
  const std::vector<std::vector<std::size_t>> tiles = {
      {16, 16, 8, 4, 4, 4, 1}, {16, 32, 16, 8, 4, 1, 8}, {8, 32, 8, 8, 16, 1, 2}};
  for (const std::vector<std::size_t>& tile : tiles) {
    SCOPED_TRACE(testing::PrintToString(tile));
    device.tune(tunables::gemm_tiled, tile, "test");
    Float::expect_exact({67, 131, 37, true, false, 2, 1});
    Float::expect_exact_square({131, 131, 37, false, false, 1, 1}, Triangle::upper);
    Double::expect_exact({67, 131, 37, false, true, 1, 0});
  }
  device.tune(tunables::gemm_tiled, before, "test");
}

TEST(TileMacros, FitTheDevice) {
  const ops::TileMacros tile{128, 128, 32, 16, 16, 4, 4};
  EXPECT_EQ(ops::fitted(tile, 256, 64 << 10, Arithmetic::f32), tile);
  for (const std::size_t items : Sizes{1, 8, 32, 64, 100, 128, 1024}) {
    for (const std::size_t memory : Sizes{8 << 10, 16 << 10, 32 << 10, 48 << 10}) {
      for (const Arithmetic arithmetic : {Arithmetic::f32, Arithmetic::f64}) {
        const ops::TileMacros fit = ops::fitted(tile, items, memory, arithmetic);
        EXPECT_LE(fit.MDIMC * fit.NDIMC, items);
        EXPECT_LE(ops::local_bytes(fit, arithmetic), memory);
        EXPECT_EQ(fit.MWG % (fit.MDIMC * fit.VWM), 0U);
        EXPECT_EQ(fit.NWG % (fit.NDIMC * fit.VWN), 0U);
        EXPECT_EQ(fit.KWG % fit.VWM, 0U);
        EXPECT_EQ(fit.KWG % fit.VWN, 0U);
        EXPECT_GE(fit.MWG, 1U);
      }
    }
  }
}

}  // namespace
}  // namespace weft::test
