// The codec `pca` in Eigen, in double: the truth that the device is checked against.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/pca.hpp"
#include "weft/reference/truncated_svd.hpp"

namespace weft::reference {

// A truncated SVD as `request` asks for, its own noise, constant and seed set here; streams the
// source by runs of images, or by blocks of texels where gram and qr have fewer images' channels
// than texels. The tensors of the result are float; info holds nothing yet. Throws as the device
// encoder does.
struct PcaFit {
  std::unique_ptr<PcaModel> model;
  SvdMethod method = SvdMethod::automatic;  // which ran
  std::size_t passes = 0;
  double squares = 0;   // |T|^2, with the mean
  double residual = 0;  // |A - A_k|, A the data without the mean
};
PcaFit encode_pca(TileSource& source, SvdRequest request, Job& job);

// Images [first, first + count) as [count][P][C].
void decode_pca(const PcaModel& model, std::size_t first, std::size_t count, std::span<double> out);

}  // namespace weft::reference
