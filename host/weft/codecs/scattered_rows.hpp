// Rows of blocks of texels on their way into a tensor in host memory: gathered until a run of each
// fills pages, and copied by a thread of its own while the device works on the next.
#pragma once

#include <cstddef>
#include <future>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/tensor/float_store.hpp"

namespace weft {

class ScatteredRows {
 public:
  // Into a tensor of rows that are `length` long.
  ScatteredRows(FloatStore& to, std::size_t length) : to_(to), length_(length) {}
  ~ScatteredRows();
  ScatteredRows(const ScatteredRows&) = delete;
  ScatteredRows& operator=(const ScatteredRows&) = delete;

  // Rows [rows][count] of a tile, to [first, first + count) of each. Waits for the device.
  void add(Device& device, const Buffer& tile, std::size_t rows, std::size_t count,
           std::size_t first);
  // Until all are there.
  void finish();

  // Host memory that it takes beside a tensor of at most so many values, in tiles of so many.
  static std::size_t bytes(std::size_t values, std::size_t tile);

 private:
  struct Run {
    std::size_t first;
    std::size_t count;
    std::size_t from;  // in the gathered values
  };
  struct Gathered {
    std::vector<Run> runs;
    FloatStore values;
    std::size_t used = 0;
    std::size_t rows = 0;
  };

  void send();
  void copy(Gathered& gathered);

  FloatStore& to_;
  std::size_t length_;
  Gathered gathered_[2];
  std::size_t current_ = 0;  // the one that is filled; the other may be copied
  std::future<void> copied_;
};

}  // namespace weft
