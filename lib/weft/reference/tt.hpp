// The codec `tt` in Eigen, in double: the truth that the device is checked against.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/tt.hpp"
#include "weft/reference/tensor_train.hpp"

namespace weft::reference {

// TT-SVD of a source in an order of modes, held in memory as a whole. Throws input errors for NaN
// and for what does not fit.
TrainFit encode_tt(TileSource& source, const ModeOrder& order, const TrainRequest& request,
                   Job& job);

// Decodes images of a model, which must outlive it. The cores of the texels' modes that the order
// begins with are multiplied once; the rest is multiplied for each image, its slices first.
class TtImages {
 public:
  explicit TtImages(const TtModel& model);

  // Images [first, first + count) as [count][P][C].
  void decode(std::size_t first, std::size_t count, std::span<double> out) const;

 private:
  std::vector<double> image_rows(std::size_t view, std::size_t light) const;

  const TtModel& model_;
  std::size_t shared_ = 0;            // cores that are in the product below
  std::vector<double> product_{1.0};  // [their indices][R]
};

}  // namespace weft::reference
