// Tucker decompositions end to end in double, of tensors that fit in memory: the truth that
// host/weft/codecs/fit_tucker.hpp is checked against.
//
//   hosvd     U_n: leading left singular vectors of each unfolding of D (Vasilescu & Terzopoulos
//             2004, section 2; De Lathauwer et al. 2000)
//   sthosvd   the same of the tensor as projected so far, mode by mode (Vannieuwenhoven et al.
//   2012) hooi      from either, alternating: each mode's vectors of D projected onto all other
//   modes
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/tucker.hpp"
#include "weft/model/tucker_ranks.hpp"

namespace weft {

enum class TuckerMethod { hosvd, sthosvd, hooi };

// "hosvd" "sthosvd" "hooi".
std::string_view name_of(TuckerMethod method);

struct TuckerRequest {
  ModeGroups groups;
  std::vector<std::size_t> most;  // per mode: the rank, the most with a goal; its size for whole
  TuckerMethod method = TuckerMethod::sthosvd;
  TuckerMethod start = TuckerMethod::sthosvd;  // of hooi
  std::size_t iterations = 3;
  // A goal's models are cut of the fit, see ranks_to_goal(), which has room for them to differ:
  double relative = 0;    // |D - D'| / |D| of the factors before they are stored; 0: none
  std::size_t bytes = 0;  // of the file; 0: none
  // Bytes of a file beside core and factors, of these ranks and modes with factors.
  std::function<std::size_t(std::span<const std::size_t>, std::span<const std::uint8_t>)> header;
  Storage storage = Storage::f16;

  bool has_goal() const { return relative > 0 || bytes > 0; }
  // Whether mode n is to be cut: given a rank, or of a goal and not too long for its Gram matrix.
  bool cuts(std::size_t n) const;
  // Whether mode n takes a factor at this rank: where it is cut, or where the goal's cuts may yet
  // cut it, giving up the direction of `least` squares with `room` left for what is lost.
  bool takes_factor(std::size_t n, std::size_t rank, double least, double room) const;
};

// Modes up to this long are cut by a goal, and by Gram matrices.
inline constexpr std::size_t longest_gram_mode = 4096;

// What a fit says of itself. Squares are of the data as it is.
struct TuckerErrors {
  double squares = 0;       // |D|^2
  double core_squares = 0;  // |Z|^2: |D|^2 - |Z|^2 is what orthonormal factors lose
  double bound = 0;         // hosvd: the sum of discarded squared singular values, eq. (4)
  double discarded = 0;     // sthosvd: the same of the tensors as projected, which is the error
};

struct TuckerFit {
  std::unique_ptr<TuckerModel> model;
  TuckerErrors errors;
};

// The order in which `modes` are cut to these ranks at least cost, by flops of Gram matrices and
// products.
std::vector<std::size_t> cheapest_cuts(std::span<const std::size_t> sizes,
                                       std::span<const std::size_t> ranks,
                                       std::vector<std::size_t> modes);

// Bytes of a file, as the request stores it; the request must outlive it.
TuckerBytes tucker_bytes(const TuckerRequest& request, std::span<const std::uint8_t> factors);

// The ranks that a model with orthonormal factors is cut to by the request's goal, and what squared
// norm is lost with them; `lost`: what is lost already.
RankChoice ranks_to_goal(const TuckerModel& model, const TuckerRequest& request, double squares,
                         double lost);
// The model with these ranks, none above its own: core, factors and groups, without info.
std::unique_ptr<TuckerModel> leading_model(const TuckerModel& model,
                                           std::span<const std::size_t> ranks);

namespace reference {

TuckerFit encode_tucker(TileSource& source, const TuckerRequest& request, Job& job);

// Images [first, first + count), [count][Y][X][C].
void decode_tucker(const TuckerModel& model, std::size_t first, std::size_t count,
                   std::span<double> out);

}  // namespace reference
}  // namespace weft
