#include "weft/codecs/tt_decoder.hpp"

#include <algorithm>
#include <utility>

#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/ops/permute.hpp"
#include "weft/tensor/permute.hpp"

namespace weft {
namespace {

constexpr std::size_t slices = 2;  // modes of an image: view and light

bool is_slice(Mode mode) {
  return mode == Mode::view || mode == Mode::light;
}

// Whether the slices' modes are the first two or the last two of the order.
bool slices_first(const TtModel& model) {
  return is_slice(model.order[0]) && is_slice(model.order[1]);
}
bool slices_last(const TtModel& model) {
  return is_slice(model.order[mode_count - 1]) && is_slice(model.order[mode_count - 2]);
}

Buffer core_buffer(Device& device, const TtModel& model, std::size_t n) {
  Buffer buffer(device, model.cores[n].size() * sizeof(float), "core of a train");
  device.write(buffer, std::span<const float>(model.cores[n]));
  return buffer;
}

// Indices of cores [first, last).
std::size_t indices_of(const TtModel& model, std::size_t first, std::size_t last) {
  std::size_t product = 1;
  for (std::size_t n = first; n < last; ++n) product *= model.size(n);
  return product;
}

// The product of cores [first, last), [R_first][indices][R_last]; R_first is 1, or R_last is.
Buffer chain(Device& device, const TtModel& model, std::size_t first, std::size_t last) {
  const bool from_left = first == 0;
  Buffer product = core_buffer(device, model, from_left ? first : last - 1);
  for (std::size_t step = 1; step < last - first; ++step) {
    const std::size_t n = from_left ? first + step : last - 1 - step;
    const Buffer core = core_buffer(device, model, n);
    const std::size_t left = model.ranks[n];
    const std::size_t right = model.ranks[n + 1];
    const std::size_t size = model.size(n);
    const std::size_t others =
        from_left ? indices_of(model, first, n) : indices_of(model, n + 1, last);
    const std::size_t rows = from_left ? others : left * size;
    const std::size_t columns = from_left ? size * right : others;
    Buffer next(device, rows * columns * sizeof(float), "product of cores");
    if (from_left) {
      ops::gemm(device, ops::Transpose::no, ops::Transpose::no, rows, columns, left, 1,
                {product, left}, {core, columns}, 0, {next, columns});
    } else {
      ops::gemm(device, ops::Transpose::no, ops::Transpose::no, rows, columns, right, 1,
                {core, right}, {product, columns}, 0, {next, columns});
    }
    device.finish();
    product = std::move(next);
  }
  return product;
}

// A chain of some modes and one bond with its modes in storage order, as floats on the host: the
// bond first, or last.
std::vector<float> sorted_chain(Device& device, const TtModel& model, std::size_t first,
                                std::size_t last, bool bond_first) {
  const Buffer product = chain(device, model, first, last);
  std::vector<float> values(product.size() / sizeof(float));
  device.read(product, std::span<float>(values));
  const bool bond_was_first = first > 0;
  const std::size_t rank = bond_was_first ? model.ranks[first] : model.ranks[last];
  std::vector<std::size_t> sizes;
  if (bond_was_first) sizes.push_back(rank);
  for (std::size_t n = first; n < last; ++n) sizes.push_back(model.size(n));
  if (!bond_was_first) sizes.push_back(rank);
  const std::size_t bond = bond_was_first ? 0 : last - first;
  std::vector<std::size_t> axes;
  if (bond_first) axes.push_back(bond);
  for (const Mode mode : all_modes) {
    const std::size_t n = model.position(mode);
    if (n >= first && n < last) axes.push_back(n - first + (bond_was_first ? 1 : 0));
  }
  if (!bond_first) axes.push_back(bond);
  return permuted(std::span<const float>(values), sizes, axes);
}

class SeparatedDecoder final : public DeviceDecoder {
 public:
  SeparatedDecoder(Device& device, const TtModel& model)
      : device_(device), values_(model.info.btf.shape.image_values()) {
    const bool first = slices_first(model);
    const std::size_t bond = first ? slices : mode_count - slices;
    rank_ = model.ranks[bond];
    const std::vector<float> images = first ? sorted_chain(device, model, 0, bond, false)
                                            : sorted_chain(device, model, bond, mode_count, false);
    images_ = Buffer(device, images.size() * sizeof(float), "products of views and lights");
    device.write(images_, std::span<const float>(images));

    const std::vector<float> texels = first ? sorted_chain(device, model, bond, mode_count, true)
                                            : sorted_chain(device, model, 0, bond, true);
    Buffer rows(device, texels.size() * sizeof(float), "products of texels");
    device.write(rows, std::span<const float>(texels));
    texels_ = Buffer(device, ops::packed_elements(device, rank_, values_) * sizeof(float),
                     "products of texels");
    ops::pack_panels(device, ops::row_major(device, rows, values_), rank_, values_, texels_);
    device.finish();
  }

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    ops::gemm_packed(device_, count, values_, rank_, 1.0,
                     ops::row_major(device_, images_, rank_, first * rank_), texels_, 0.0,
                     ops::to_row_major(device_, out, values_));
  }

  double image_flops() const override {
    return 2.0 * static_cast<double>(values_) * static_cast<double>(rank_);
  }

 private:
  Device& device_;
  std::size_t values_;
  std::size_t rank_ = 1;
  Buffer images_;  // W [V L][R]
  Buffer texels_;  // M in panels
};

class ChainDecoder final : public DeviceDecoder {
 public:
  ChainDecoder(Device& device, const TtModel& model)
      : device_(device), shape_(model.info.btf.shape), order_(model.order), ranks_(model.ranks) {
    for (std::size_t n = 0; n < mode_count; ++n) {
      sizes_[n] = model.size(n);
      cores_[n] = core_buffer(device, model, n);
    }
    while (!is_slice(order_[shared_])) ++shared_;
    if (shared_ > 0) {
      shared_rows_ = indices_of(model, 0, shared_);
      product_ = chain(device, model, 0, shared_);
    }
    // The largest of what stands between two steps, and the flops.
    std::size_t largest = 1;
    walk([&](std::size_t, bool, std::size_t rows, std::size_t columns, std::size_t inner) {
      largest = std::max(largest, rows * columns);
      flops_ += 2.0 * static_cast<double>(rows) * static_cast<double>(columns) *
                static_cast<double>(inner);
    });
    for (Buffer& step : steps_) step = Buffer(device, largest * sizeof(float), "part of a train");
    const float one = 1.0f;
    one_ = Buffer(device, sizeof(float), "one");
    device.write(one_, std::span<const float>(&one, 1));
    // steps of y, x and c in the order of the train
    std::size_t step = 1;
    std::array<std::size_t, mode_count> steps{};
    for (std::size_t n = mode_count; n-- > 0;) {
      if (is_slice(order_[n])) continue;
      steps[index_of(order_[n])] = step;
      step *= sizes_[n];
    }
    image_steps_ = {steps[index_of(Mode::row)], steps[index_of(Mode::column)],
                    steps[index_of(Mode::channel)]};
  }

  void decode(std::size_t first, std::size_t count, Buffer& out) override {
    for (std::size_t i = 0; i < count; ++i) {
      const std::array<std::size_t, slices> index{(first + i) / shape_.lights,
                                                  (first + i) % shape_.lights};
      const Buffer* from = &one_;
      std::size_t turn = 0;
      walk([&](std::size_t n, bool from_left, std::size_t rows, std::size_t columns,
               std::size_t inner) {
        Buffer& to = steps_[turn];
        const ops::Transpose no = ops::Transpose::no;
        if (n == mode_count) {
          ops::gemm(device_, no, no, rows, columns, inner, 1, {product_, inner}, {*from, columns},
                    0, {to, columns});
        } else {
          const bool slice = is_slice(order_[n]);
          const std::size_t right = ranks_[n + 1];
          const std::size_t at = slice ? index[index_of(order_[n])] * right : 0;
          // [left][size][right] as left rows, or as left size rows
          const std::size_t leading = slice || from_left ? sizes_[n] * right : right;
          const ops::ConstMatrix core{cores_[n], leading, at};
          if (from_left) {
            ops::gemm(device_, no, no, rows, columns, inner, 1, {*from, inner}, core, 0,
                      {to, columns});
          } else {
            ops::gemm(device_, no, no, rows, columns, inner, 1, core, {*from, columns}, 0,
                      {to, columns});
          }
        }
        from = &to;
        turn = 1 - turn;
      });
      ops::permute(device_, {shape_.height, shape_.width, shape_.channels}, image_steps_, *from,
                   i * shape_.image_values(), out);
    }
  }

  double image_flops() const override { return flops_; }

 private:
  // Calls step(core, from the left?, M, N, K) for every product of an image in order; core
  // mode_count is what is shared.
  template <typename Step>
  void walk(const Step& step) const {
    std::size_t others = 1;  // indices so far
    if (shared_ == 0) {
      for (std::size_t n = 0; n < mode_count; ++n) {
        const std::size_t kept = is_slice(order_[n]) ? 1 : sizes_[n];
        step(n, true, others, kept * ranks_[n + 1], ranks_[n]);
        others *= kept;
      }
      return;
    }
    for (std::size_t n = mode_count; n-- > shared_;) {
      const std::size_t kept = is_slice(order_[n]) ? 1 : sizes_[n];
      step(n, false, ranks_[n] * kept, others, ranks_[n + 1]);
      others *= kept;
    }
    step(mode_count, false, shared_rows_, others, ranks_[shared_]);
  }

  Device& device_;
  BtfShape shape_;
  ModeOrder order_;
  std::array<std::size_t, mode_count + 1> ranks_;
  std::array<std::size_t, mode_count> sizes_{};
  std::array<Buffer, mode_count> cores_;
  std::size_t shared_ = 0;
  std::size_t shared_rows_ = 1;
  Buffer product_;
  std::array<Buffer, 2> steps_;
  Buffer one_;
  std::array<std::size_t, 3> image_steps_{};
  double flops_ = 0;
};

}  // namespace

std::unique_ptr<DeviceDecoder> tt_decoder(Device& device, const TtModel& model) {
  if (slices_first(model) || slices_last(model)) {
    return std::make_unique<SeparatedDecoder>(device, model);
  }
  return std::make_unique<ChainDecoder>(device, model);
}

std::size_t tt_decoder_bytes(const TtModel& model) {
  const BtfShape& shape = model.info.btf.shape;
  std::size_t largest = 1;
  for (const std::size_t rank : model.ranks) largest = std::max(largest, rank);
  constexpr std::size_t widest_panel = 48;
  if (slices_first(model) || slices_last(model)) {
    const std::size_t rank = model.ranks[slices_first(model) ? slices : mode_count - slices];
    // the product here twice, on the device, and in panels; before it that of one core less
    return (4 * rank * (shape.image_values() + widest_panel) + shape.texels() * largest +
            3 * rank * shape.images() + model.coefficients()) *
           sizeof(float);
  }
  return (2 * model.coefficients() + 4 * shape.image_values() * largest) * sizeof(float);
}

}  // namespace weft
