#include "weft/codecs/held_tensor.hpp"

#include <algorithm>
#include <utility>

#include "weft/error.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

// Values of a block: few enough to stay in a large cache. A function of nothing.
constexpr std::size_t block_values = std::size_t{4} << 20;

// A tensor [outer][size][inner] in blocks of whole `outer`, or of parts of `inner` where one of
// `outer` is too large.
struct Blocks {
  ops::ModeView view;
  std::size_t outer = 1;
  std::size_t inner = 1;

  explicit Blocks(const ops::ModeView& of) : view(of) {
    const std::size_t slab = view.size * view.inner;
    outer = std::clamp<std::size_t>(block_values / slab, 1, view.outer);
    inner = std::clamp<std::size_t>(block_values / view.size, 1, view.inner);
    if (outer > 1 || slab <= block_values) inner = view.inner;
  }
  std::size_t values() const { return outer * view.size * inner; }

  // Calls use(first outer, count, first inner, count).
  template <typename Use>
  void for_each(const Use& use) const {
    for (std::size_t o = 0; o < view.outer; o += outer) {
      for (std::size_t i = 0; i < view.inner; i += inner) {
        check_interrupt();
        use(o, std::min(outer, view.outer - o), i, std::min(inner, view.inner - i));
      }
    }
  }
};

// Rows of a block from or to a tensor of the given size in the mode.
template <typename Copy>
void for_each_row(const Blocks& blocks, std::size_t size, std::size_t o, std::size_t outer,
                  std::size_t i, std::size_t inner, const Copy& copy) {
  if (inner == blocks.view.inner) {
    copy(o * size * inner, 0, outer * size * inner);
    return;
  }
  for (std::size_t row = 0; row < outer * size; ++row) {
    copy((o * size + row) * blocks.view.inner + i, row * inner, inner);
  }
}

std::ptrdiff_t at(std::size_t i) {
  return static_cast<std::ptrdiff_t>(i);
}

}  // namespace

HeldTensor::HeldTensor(std::vector<std::size_t> tensor_sizes)
    : sizes(std::move(tensor_sizes)), values(product(sizes)) {}

std::vector<double> HeldTensor::gram(Device& device, std::size_t mode,
                                     Arithmetic arithmetic) const {
  const Blocks blocks(ops::mode_view(sizes, mode));
  Buffer buffer(device, blocks.values() * sizeof(float), "block of a tensor");
  std::vector<float> block(blocks.inner < blocks.view.inner ? blocks.values() : 0);
  ops::ModeGram gram(device, sizes[mode], arithmetic);
  blocks.for_each([&](std::size_t o, std::size_t outer, std::size_t i, std::size_t inner) {
    const std::size_t count = outer * blocks.view.size * inner;
    if (block.empty()) {
      device.write(buffer, std::span(values).subspan(o * blocks.view.size * inner, count));
    } else {
      for_each_row(blocks, blocks.view.size, o, outer, i, inner,
                   [&](std::size_t from, std::size_t to, std::size_t run) {
                     std::copy_n(values.begin() + at(from), run, block.begin() + at(to));
                   });
      device.write(buffer, std::span<const float>(block).first(count));
    }
    gram.add(buffer, {outer, blocks.view.size, inner});
  });
  return gram.matrix();
}

void HeldTensor::project(Device& device, std::size_t mode, std::size_t rank,
                         const std::vector<float>& U) {
  const Blocks blocks(ops::mode_view(sizes, mode));
  const std::size_t size = blocks.view.size;
  Buffer factor(device, U.size() * sizeof(float), "factor");
  device.write(factor, std::span<const float>(U));
  Buffer in(device, blocks.values() * sizeof(float), "block of a tensor");
  Buffer out(device, blocks.outer * rank * blocks.inner * sizeof(float), "projected block");
  std::vector<float> block(std::max(blocks.values(), blocks.outer * rank * blocks.inner));
  // Blocks that are parts of a slab are written over what is still to be read, unless there is but
  // one slab: then the slab's result waits.
  const bool waits = blocks.inner < blocks.view.inner && blocks.view.outer > 1;
  std::vector<float> slab(waits ? rank * blocks.view.inner : 0);
  blocks.for_each([&](std::size_t o, std::size_t outer, std::size_t i, std::size_t inner) {
    for_each_row(blocks, size, o, outer, i, inner,
                 [&](std::size_t from, std::size_t to, std::size_t run) {
                   std::copy_n(values.begin() + at(from), run, block.begin() + at(to));
                 });
    device.write(in, std::span<const float>(block).first(outer * size * inner));
    ops::mode_product(device, {outer, size, inner}, in, ops::ModeProduct::project, factor, rank,
                      out);
    device.read(out, std::span(block).first(outer * rank * inner));
    std::vector<float>& to_values = waits ? slab : values;
    for_each_row(blocks, rank, waits ? 0 : o, outer, i, inner,
                 [&](std::size_t to, std::size_t from, std::size_t run) {
                   std::copy_n(block.begin() + at(from), run, to_values.begin() + at(to));
                 });
    if (waits && i + inner == blocks.view.inner) {
      std::copy(slab.begin(), slab.end(), values.begin() + at(o * slab.size()));
    }
  });
  sizes[mode] = rank;
  values.resize(blocks.view.outer * rank * blocks.view.inner);
}

double HeldTensor::squares() const {
  double sum = 0;
  for (const float value : values) sum += double{value} * double{value};
  return sum;
}

std::size_t HeldTensor::working_bytes(const Device& device, std::size_t values, std::size_t longest,
                                      Arithmetic arithmetic) {
  const std::size_t block = std::min(values, std::max(block_values, longest));
  // Products pack up to 8 MiB, or one panel, which pads what is narrower.
  const std::size_t packed =
      std::min<std::size_t>(std::size_t{16} << 20, 64 * block * sizeof(float));
  // blocks in, out and here, a waiting slab, and what the products hold
  return 4 * block * sizeof(float) + packed +
         ops::ModeGram::bytes(device, std::min<std::size_t>(longest, 4096), block, arithmetic);
}

}  // namespace weft
