// What the decoders of Tucker models share: how a core lies for them, and the factors of texels.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/model/tucker.hpp"

namespace weft {

// A core as decoders take it, [views][lights][slice], where views that are merged with lights are
// lights, and a slice is of texels:
//
//   [channels][rows][columns]    channels 1 where they are with the lights or with the texels,
//                                rows 1 where those are one mode with the columns
struct TuckerCore {
  bool views_alone = false;
  std::size_t views = 1;              // R of the views' mode
  std::size_t lights = 1;             // R of the lights' mode
  std::size_t light_group = 0;        // its number
  std::size_t light_channels = 1;     // channels that are in it
  bool channels_alone = false;        // channels are a mode of their own, before the texels
  std::size_t channels = 1;           // its R
  std::size_t rows = 1, columns = 1;  // R of the texels' modes
  std::size_t height = 1, width = 1;  // their sizes; a width counts channels that are in it
  const std::vector<float>* of_channels = nullptr;  // factors; null for an identity
  const std::vector<float>* of_rows = nullptr;
  const std::vector<float>* of_columns = nullptr;

  explicit TuckerCore(const TuckerModel& model);

  std::size_t slice() const { return channels * rows * columns; }
  std::size_t expanded() const { return channels * height * width; }
};

// The factors of texels on a device, which turn slices into images with the channels still to come:
//
//   [count][channels][rows][columns] -> [count][channels][height][width]
class TexelFactors {
 public:
  TexelFactors(Device& device, const TuckerCore& core);

  // Whether there is a factor at all.
  bool any() const { return rows_ || columns_; }
  // `count` slices from an offset of one buffer to an offset of another, a few at a time. The
  // values of a slice depend on nothing but it.
  void expand(const Buffer& from, std::size_t offset, std::size_t count, Buffer& to,
              std::size_t to_offset);

  // Flops and values moved for one slice.
  static double flops(const TuckerCore& core);
  static double traffic(const TuckerCore& core);
  // Bytes that it holds.
  static std::size_t bytes(const TuckerCore& core);

 private:
  Device& device_;
  std::size_t channels_, a_, b_, A_, B_;  // rows and columns, before and after
  Buffer rows_;                           // U [A][a], or U^T in panels where rows come first
  Buffer columns_;                        // U^T [b][B] in panels
  bool rows_first_;
  Buffer between_;  // slices that went through one of two factors
};

}  // namespace weft
