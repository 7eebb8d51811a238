#include "weft/reference/tt.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <vector>

#include "weft/error.hpp"
#include "weft/reference/tile.hpp"

namespace weft::reference {
namespace {
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// How far apart neighbours along each mode are in a row-major tensor of the given order.
std::array<std::size_t, mode_count> strides_of(const BtfShape& shape, const ModeOrder& order) {
  std::array<std::size_t, mode_count> strides{};
  std::size_t stride = 1;
  for (std::size_t n = mode_count; n-- > 0;) {
    strides[index_of(order[n])] = stride;
    stride *= mode_size(shape, order[n]);
  }
  return strides;
}

bool is_slice(Mode mode) {
  return mode == Mode::view || mode == Mode::light;
}

// Values as rows of `columns`.
Eigen::Map<const RowMajor> view(const std::vector<double>& values, std::size_t columns) {
  return {values.data(), static_cast<Eigen::Index>(values.size() / columns),
          static_cast<Eigen::Index>(columns)};
}

// A core as a matrix of so many rows.
RowMajor core_of(const TtModel& model, std::size_t n, std::size_t rows) {
  return Eigen::Map<const Eigen::Matrix<float, -1, -1, Eigen::RowMajor>>(
             model.cores[n].data(), static_cast<Eigen::Index>(rows),
             static_cast<Eigen::Index>(model.cores[n].size() / rows))
      .cast<double>();
}

}  // namespace

TrainFit encode_tt(TileSource& source, const ModeOrder& order, const TrainRequest& request,
                   Job& job) {
  const BtfShape& shape = source.info().shape;
  MemoryPlan plan;
  // the tensor, its copy in each SVD, and the factors of that
  plan.add("tensor and factors", 5 * shape.values() * sizeof(double));
  job.plan(plan);

  std::vector<double> tensor(shape.values());
  {
    const StageTimer timer(job, "read", 0, static_cast<double>(source.info().bytes()));
    const auto strides = strides_of(shape, order);
    std::vector<double> image(shape.image_values());
    for (std::size_t i = 0; i < shape.images(); ++i) {
      check_interrupt();
      read_tile(source, i, 1, job.nan_zero, image);
      double* to = tensor.data() + i / shape.lights * strides[index_of(Mode::view)] +
                   i % shape.lights * strides[index_of(Mode::light)];
      for (std::size_t j = 0; j < image.size(); ++j) {
        const std::size_t c = j % shape.channels;
        const std::size_t x = j / shape.channels % shape.width;
        const std::size_t y = j / shape.channels / shape.width;
        to[y * strides[index_of(Mode::row)] + x * strides[index_of(Mode::column)] +
           c * strides[index_of(Mode::channel)]] = image[j];
      }
      job.advance("read", i + 1, shape.images());
    }
  }
  std::array<std::size_t, mode_count> sizes{};
  for (std::size_t n = 0; n < mode_count; ++n) sizes[n] = mode_size(shape, order[n]);
  const StageTimer timer(job, "TT-SVD");
  return tt_svd(sizes, tensor, request);
}

TtImages::TtImages(const TtModel& model) : model_(model) {
  while (shared_ < mode_count && !is_slice(model.order[shared_])) {
    const RowMajor next =
        view(product_, model.ranks[shared_]) * core_of(model, shared_, model.ranks[shared_]);
    product_.assign(next.data(), next.data() + next.size());
    ++shared_;
  }
}

// The image with its texels' modes in the model's order.
std::vector<double> TtImages::image_rows(std::size_t image_view, std::size_t light) const {
  const auto slice = [&](std::size_t n) -> RowMajor {
    const std::size_t i = model_.order[n] == Mode::view ? image_view : light;
    const auto right = static_cast<Eigen::Index>(model_.ranks[n + 1]);
    return core_of(model_, n, model_.ranks[n])
        .middleCols(static_cast<Eigen::Index>(i) * right, right);
  };
  if (shared_ == 0) {
    // from the left, where the slices are
    std::vector<double> product{1.0};
    for (std::size_t n = 0; n < mode_count; ++n) {
      const RowMajor next =
          view(product, model_.ranks[n]) *
          (is_slice(model_.order[n]) ? slice(n) : core_of(model_, n, model_.ranks[n]));
      product.assign(next.data(), next.data() + next.size());
    }
    return product;
  }
  // from the right up to what is shared
  RowMajor right = RowMajor::Ones(1, 1);
  for (std::size_t n = mode_count; n-- > shared_;) {
    if (is_slice(model_.order[n])) {
      right = (slice(n) * right).eval();
      continue;
    }
    const RowMajor next = core_of(model_, n, model_.ranks[n] * model_.size(n)) * right;
    right = Eigen::Map<const RowMajor>(next.data(), static_cast<Eigen::Index>(model_.ranks[n]),
                                       next.size() / static_cast<Eigen::Index>(model_.ranks[n]));
  }
  const RowMajor image = view(product_, model_.ranks[shared_]) * right;
  return {image.data(), image.data() + image.size()};
}

void TtImages::decode(std::size_t first, std::size_t count, std::span<double> out) const {
  const BtfShape& shape = model_.info.btf.shape;
  // steps along y, x and c in the model's order
  std::array<std::size_t, mode_count> steps{};
  std::size_t step = 1;
  for (std::size_t n = mode_count; n-- > 0;) {
    if (is_slice(model_.order[n])) continue;
    steps[index_of(model_.order[n])] = step;
    step *= model_.size(n);
  }
  double* to = out.data();
  for (std::size_t image = first; image < first + count; ++image) {
    const std::vector<double> values = image_rows(image / shape.lights, image % shape.lights);
    for (std::size_t y = 0; y < shape.height; ++y) {
      for (std::size_t x = 0; x < shape.width; ++x) {
        for (std::size_t c = 0; c < shape.channels; ++c) {
          *to++ = values[y * steps[index_of(Mode::row)] + x * steps[index_of(Mode::column)] +
                         c * steps[index_of(Mode::channel)]];
        }
      }
    }
  }
}

}  // namespace weft::reference
