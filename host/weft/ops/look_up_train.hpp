// Look-ups in tensor trains: kernels/look_up_train.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/model/tt.hpp"
#include "weft/ops/look_up_factors.hpp"

namespace weft::ops {

// The cores of a model on a device, laid out for look-ups.
class TrainCores {
 public:
  TrainCores(Device& device, const TtModel& model);

  // Device memory of it.
  static std::size_t bytes(const TtModel& model);

 private:
  friend void look_up_train(Device& device, const LookupBatch& batch, const TrainCores& cores);

  std::size_t left_steps_ = 0;
  std::size_t right_steps_ = 0;
  std::size_t left_rank_ = 1;
  std::size_t right_rank_ = 1;
  std::size_t channel_core_ = 0;
  std::size_t longest_ = 64;
  unsigned left_groups_ = 0;
  unsigned right_groups_ = 0;
  Buffer cores_;
  Buffer steps_;
};

// `count` records into out, [count][C].
void look_up_train(Device& device, const LookupBatch& batch, const TrainCores& cores);

}  // namespace weft::ops
