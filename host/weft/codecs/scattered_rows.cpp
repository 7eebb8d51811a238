#include "weft/codecs/scattered_rows.hpp"

#include <algorithm>
#include <utility>

namespace weft {
namespace {

// That are gathered at a time.
constexpr std::size_t most_values = std::size_t{8} << 20;

}  // namespace

ScatteredRows::~ScatteredRows() {
  if (copied_.valid()) copied_.wait();
}

void ScatteredRows::add(Device& device, const Buffer& tile, std::size_t rows, std::size_t count,
                        std::size_t first) {
  const std::size_t values = rows * count;
  if (gathered_[current_].used > 0 && gathered_[current_].used + values > most_values) send();
  Gathered& gathered = gathered_[current_];
  if (gathered.values.size() < gathered.used + values) {
    FloatStore larger(std::max(std::min(most_values, to_.size()), gathered.used + values));
    std::copy_n(gathered.values.begin(), gathered.used, larger.begin());
    gathered.values = std::move(larger);
  }
  gathered.rows = rows;
  gathered.runs.push_back({first, count, gathered.used});
  device.read(tile, std::span(gathered.values).subspan(gathered.used, values));
  gathered.used += values;
}

std::size_t ScatteredRows::bytes(std::size_t values, std::size_t tile) {
  return 2 * std::max(std::min(most_values, values), tile) * sizeof(float);
}

void ScatteredRows::finish() {
  send();
  copied_.get();
}

void ScatteredRows::send() {
  if (copied_.valid()) copied_.get();
  copied_ =
      std::async(std::launch::async, [this, &gathered = gathered_[current_]] { copy(gathered); });
  current_ = 1 - current_;
}

void ScatteredRows::copy(Gathered& gathered) {
  for (std::size_t row = 0; row < gathered.rows; ++row) {
    for (const Run& run : gathered.runs) {
      const float* from = gathered.values.data() + run.from + row * run.count;
      std::copy_n(from, run.count, to_.begin() + row * length_ + run.first);
    }
  }
  gathered.runs.clear();
  gathered.used = 0;
  to_.release();
}

}  // namespace weft
