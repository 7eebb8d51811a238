// K-clustered tensor approximation (Tsai & Shih 2012, Algorithm 1) end to end in double, of tensors
// that fit in memory: the truth that host/weft/codecs/fit_kcta.hpp is checked against. Equation
// numbers are the paper's.
//
//   clustering stage   for every slice along mode m the K clusters of (9) and (13), one after the
//                      other, and its mixing coefficients (15)
//   update stage       cluster by cluster, the N-mode SVD of its slices less what the others make
//   of
//                      them (20), from the bases that it has
//
// until the sum of the cores' norms stays, or the error grows: the result before is then restored.
// With K = 1 it is clustered tensor approximation (Tsai & Shih 2006).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/kcta.hpp"
#include "weft/reference/kcta_start.hpp"

namespace weft {

struct KctaRequest {
  ModeGroups groups;
  std::size_t mode = 0;  // m, a number of a group
  std::size_t clusters = 1;
  std::size_t mixtures = 1;
  std::vector<std::size_t> ranks;         // R_n of each group; its size for whole
  std::vector<std::uint8_t> global_mode;  // whether group n has one basis for all clusters (23)
  KctaStart start = KctaStart::directions;
  std::size_t iterations = 10;
  double least_change = 1e-4;  // of the sum of the cores' norms, relative
  // Side N of a grid of views that are resampled (view_grid.hpp), or 0; of clusters of views.
  std::size_t grid_side = 0;

  // Whether mode n has a factor of its own beside the clustered one.
  bool cuts(std::size_t n) const { return n != mode && ranks[n] < groups.groups()[n].size; }
};

// Bases of modes longer than this have no Gram matrix.
inline constexpr std::size_t longest_kcta_mode = 4096;

// Iterations of alternating least squares in an update stage: of a cluster that has bases already,
// and of one that has none.
inline constexpr std::size_t warm_sweeps = 1;
inline constexpr std::size_t cold_sweeps = 2;

// What a fit says of itself. Squares are of the data as it is.
struct KctaErrors {
  double squares = 0;           // |D|^2
  double lost = 0;              // by global bases
  std::vector<double> history;  // what is lost beside, after the start and every iteration
  bool restored = false;        // whether the last iteration was given up
};

struct KctaFit {
  std::unique_ptr<KctaModel> model;
  KctaErrors errors;
};

// A fit that keeps A_G of (23), to be fitted again with smaller ranks.
class KctaEncoder {
 public:
  virtual ~KctaEncoder() = default;
  // With the ranks of the request. Called first, and once.
  virtual KctaFit fit() = 0;
  // With the ranks of a model that was cut of that fit, orthonormal bases among it, and from its
  // clusters on. At least one iteration.
  virtual KctaFit refit(const KctaModel& start, std::size_t iterations) = 0;
};

// Bytes that making a grid of views takes, and the grid.
std::size_t grid_bytes(const KctaRequest& request);

namespace reference {

// The squared singular values of modes of the data as it is, descending; none for other modes.
std::vector<std::vector<double>> mode_spectra(TileSource& source, const ModeGroups& groups,
                                              std::span<const std::size_t> modes, Job& job);

KctaFit encode_kcta(TileSource& source, const KctaRequest& request, Job& job);
// The same, to be fitted again.
std::unique_ptr<KctaEncoder> kcta_encoder(TileSource& source, const KctaRequest& request, Job& job);

// Images [first, first + count), [count][Y][X][C].
void decode_kcta(const KctaModel& model, std::size_t first, std::size_t count,
                 std::span<double> out);

}  // namespace reference
}  // namespace weft
