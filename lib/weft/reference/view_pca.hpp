// The codec `view-pca` in Eigen, in double: a PCA of every view by itself.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/view_pca.hpp"
#include "weft/reference/truncated_svd.hpp"

namespace weft::reference {

// Every view as `request` asks; info holds nothing yet. Throws input errors and unmet goals as the
// device encoder does.
struct ViewPcaFit {
  std::unique_ptr<ViewPcaModel> model;
  SvdMethod method = SvdMethod::automatic;  // which ran for the first view: all have one shape
  std::size_t passes = 0;                   // the most that a view took
  double residual_squares = 0;              // |T - T'|^2
};
ViewPcaFit encode_view_pca(TileSource& source, const SvdRequest& request, Job& job);

// Images [first, first + count) as [count][P][C].
void decode_view_pca(const ViewPcaModel& model, std::size_t first, std::size_t count,
                     std::span<double> out);

}  // namespace weft::reference
