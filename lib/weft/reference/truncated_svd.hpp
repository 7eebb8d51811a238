// Truncated SVD of a matrix that is read block of rows by block of rows, in double: the truth that
// host/weft/codecs/streamed_svd.hpp is checked against, in the same three ways and by the same
// goals.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace weft {

// gram: eigenvectors of the Gram matrix of the short side, one pass and a projection; loses
// singular values below about sqrt(eps) of the largest. randomized: block Krylov iteration, a few
// passes. qr: QR of all rows, then an SVD of R: accurate to eps, and slower.
enum class SvdMethod { automatic, gram, randomized, qr };

// "auto" "gram" "randomized" "qr".
std::string_view name_of(SvdMethod method);

}  // namespace weft

namespace weft::reference {

struct SvdRequest {
  SvdMethod method = SvdMethod::qr;  // automatic: qr up to 512 columns, randomized beyond
  std::size_t rank = 0;              // most components; 0: as many as the goals ask for
  double tolerance = 0;              // wanted |X - X_k| / sqrt(|X|^2 + constant_squares); 0: none
  double energy = 0;                 // wanted |X_k|^2 / |X|^2; 0: none
  double constant_squares = 0;
  double noise = 0;  // directions shorter than this are rounding of the input
  // The same as a part of the mean's norm, where a mean is removed first.
  double mean_noise = 0x1p-24;
  std::uint64_t seed = 0;

  bool has_goal() const { return tolerance > 0 || energy > 0; }
};

// Calls use(first row, rows as row-major [count][m]) for all rows of X, in order.
using UseRows = std::function<void(std::size_t first, std::span<const double> rows)>;
using EachRows = std::function<void(const std::string& stage, const UseRows& use)>;

struct TruncatedSvd {
  std::size_t rank = 0;        // k
  std::vector<double> values;  // k, descending
  std::vector<double> V;       // m x k, orthonormal columns
  std::vector<double> XV;      // K x k
  std::size_t passes = 0;
  SvdMethod method = SvdMethod::qr;
};

// Throws unmet_goal, saying what was reached, where the goals are out of reach.
TruncatedSvd truncated_svd(std::size_t K, std::size_t m, const EachRows& each,
                           const SvdRequest& request);

}  // namespace weft::reference
