#include "weft/model/tensor_train.hpp"

#include <algorithm>
#include <cmath>

#include "weft/model/storage.hpp"

namespace weft {
namespace {

// |T' - T''|^2 of a train T' of which core n alone is changed by `change`. The cores on either side
// are orthonormal but for one bond, where they have the lengths of the singular values.
double change_squares(const TensorTrain& train, std::size_t n, const std::vector<double>& change) {
  const std::size_t right = train.ranks[n + 1];
  const std::size_t row = train.sizes[n] * right;
  double sum = 0;
  for (std::size_t i = 0; i < change.size(); ++i) {
    double length = 1;
    if (n < train.center) length = train.values[n][i % right];
    if (n > train.center) length = train.values[n - 1][i / row];
    sum += std::pow(length * change[i], 2);
  }
  return sum;
}

}  // namespace

std::size_t TensorTrain::coefficients() const {
  std::size_t sum = 0;
  for (std::size_t n = 0; n < mode_count; ++n) sum += ranks[n] * sizes[n] * ranks[n + 1];
  return sum;
}

std::unique_ptr<TtModel> store_train(const TensorTrain& train, const ModeOrder& order,
                                     const BtfInfo& info, Storage storage, double allowed_squares) {
  auto model = std::make_unique<TtModel>();
  model->info.codec = "tt";
  model->info.storage = storage;
  model->info.btf = info;
  model->order = order;
  model->ranks = train.ranks;
  model->stored.fill(storage);
  for (std::size_t n = 0; n < mode_count; ++n) {
    model->cores[n].assign(train.cores[n].begin(), train.cores[n].end());
  }
  if (storage == Storage::f32) return model;

  round_to_storage(*model);
  std::array<double, mode_count> squares{};
  double sum = 0;
  for (std::size_t n = 0; n < mode_count; ++n) {
    std::vector<double> change(train.cores[n]);
    for (std::size_t i = 0; i < change.size(); ++i) change[i] -= double{model->cores[n][i]};
    squares[n] = change_squares(train, n, change);
    sum += squares[n];
  }
  while (sum > allowed_squares) {
    const auto density = [&](std::size_t n) {
      return squares[n] / static_cast<double>(train.cores[n].size());
    };
    std::size_t worst = 0;
    for (std::size_t n = 1; n < mode_count; ++n) {
      if (density(n) > density(worst)) worst = n;
    }
    if (squares[worst] == 0) break;
    sum -= squares[worst];
    squares[worst] = 0;
    model->stored[worst] = Storage::f32;
    model->cores[worst].assign(train.cores[worst].begin(), train.cores[worst].end());
  }
  return model;
}

}  // namespace weft
