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

// Neighbours on the device: where they lie if it can read them there, else in `copy`, which is then
// large enough.
Buffer on_device(Device& device, std::span<const float> values, std::size_t most, Buffer& copy) {
  if (device.limits().unified_memory) {
    return Buffer::wrap(device, std::as_bytes(values), "block of a tensor");
  }
  if (!copy) copy = Buffer(device, most * sizeof(float), "block of a tensor");
  device.write(copy, values);
  return Buffer::part(device, copy, 0, values.size_bytes(), "block of a tensor");
}

// Gives back a file's pages now and then, as a pass goes over it.
class PageRelease {
 public:
  explicit PageRelease(const FloatStore& values) : values_(values) {}
  void passed(std::size_t count) {
    constexpr std::size_t most = std::size_t{16} << 20;
    passed_ += count;
    if (passed_ < most) return;
    values_.release();
    passed_ = 0;
  }

 private:
  const FloatStore& values_;
  std::size_t passed_ = 0;
};

}  // namespace

HeldTensor::HeldTensor(std::vector<std::size_t> tensor_sizes, FloatStore::Place place)
    : sizes(std::move(tensor_sizes)), values(product(sizes), place) {}

std::vector<double> HeldTensor::gram(Device& device, std::size_t mode,
                                     Arithmetic arithmetic) const {
  const Blocks blocks(ops::mode_view(sizes, mode));
  const bool whole = blocks.inner == blocks.view.inner;
  Buffer copy;
  if (!whole) copy = Buffer(device, blocks.values() * sizeof(float), "block of a tensor");
  std::vector<float> block(whole ? 0 : blocks.values());
  ops::ModeGram gram(device, sizes[mode], arithmetic);
  PageRelease pages(values);
  blocks.for_each([&](std::size_t o, std::size_t outer, std::size_t i, std::size_t inner) {
    const ops::ModeView view{outer, blocks.view.size, inner};
    if (whole) {
      const std::span<const float> part =
          std::span(values).subspan(o * view.size * inner, view.elements());
      gram.add(on_device(device, part, blocks.values(), copy), view);
    } else {
      for_each_row(blocks, view.size, o, outer, i, inner,
                   [&](std::size_t from, std::size_t to, std::size_t run) {
                     std::copy_n(values.begin() + at(from), run, block.begin() + at(to));
                   });
      device.write(copy, std::span<const float>(block).first(view.elements()));
      gram.add(copy, view);
    }
    pages.passed(view.elements());
  });
  return gram.matrix();
}

void HeldTensor::project(Device& device, std::size_t mode, std::size_t rank,
                         const std::vector<float>& U) {
  const Blocks blocks(ops::mode_view(sizes, mode));
  Buffer factor(device, U.size() * sizeof(float), "factor");
  device.write(factor, std::span<const float>(U));
  Buffer out(device, blocks.outer * rank * blocks.inner * sizeof(float), "projected block");
  if (blocks.inner == blocks.view.inner) {
    project_slabs(device, blocks.view, blocks.outer, rank, factor, out);
  } else {
    project_parts(device, blocks.view, blocks.inner, rank, factor, out);
  }
  sizes[mode] = rank;
  values.shrink(product(sizes));
}

HeldTensor HeldTensor::projected(Device& device, std::size_t mode, std::size_t rank,
                                 const std::vector<float>& U) const {
  const ops::ModeView view = ops::mode_view(sizes, mode);
  if (!device.limits().unified_memory || view.elements() > block_values) {
    HeldTensor copy = *this;
    copy.project(device, mode, rank, U);
    return copy;
  }
  std::vector<std::size_t> after = sizes;
  after[mode] = rank;
  HeldTensor result(std::move(after), FloatStore::Place::memory);
  Buffer factor(device, U.size() * sizeof(float), "factor");
  device.write(factor, std::span<const float>(U));
  const std::span<float> to(result.values);
  Buffer out = Buffer::wrap_writable(device, std::as_writable_bytes(to), "projected tensor");
  ops::mode_product(device, view, Buffer::wrap(device, std::as_bytes(std::span(values)), "tensor"),
                    ops::ModeProduct::project, factor, rank, out);
  device.read(out, to);
  return result;
}

// Whole slabs: a result is written over what was read.
void HeldTensor::project_slabs(Device& device, const ops::ModeView& view, std::size_t at_once,
                               std::size_t rank, const Buffer& factor, Buffer& out) {
  const std::size_t slab = view.size * view.inner;
  Buffer copy;
  PageRelease pages(values);
  for (std::size_t o = 0; o < view.outer; o += at_once) {
    check_interrupt();
    const std::size_t outer = std::min(at_once, view.outer - o);
    const Buffer in =
        on_device(device, std::span(values).subspan(o * slab, outer * slab), at_once * slab, copy);
    ops::mode_product(device, {outer, view.size, view.inner}, in, ops::ModeProduct::project, factor,
                      rank, out);
    device.read(out, std::span(values).subspan(o * rank * view.inner, outer * rank * view.inner));
    pages.passed(outer * slab);
  }
}

// Slabs of more values than a block: parts of a slab's rows at a time. They would be written over
// what is still to be read, unless there is but one slab: else the slab's result waits.
void HeldTensor::project_parts(Device& device, const ops::ModeView& view, std::size_t at_once,
                               std::size_t rank, const Buffer& factor, Buffer& out) {
  const bool waits = view.outer > 1;
  std::vector<float> slab(waits ? rank * view.inner : 0);
  std::vector<float> block(std::max(view.size, rank) * at_once);
  Buffer in(device, view.size * at_once * sizeof(float), "block of a tensor");
  PageRelease pages(values);
  for (std::size_t o = 0; o < view.outer; ++o) {
    for (std::size_t i = 0; i < view.inner; i += at_once) {
      check_interrupt();
      const std::size_t inner = std::min(at_once, view.inner - i);
      for (std::size_t j = 0; j < view.size; ++j) {
        std::copy_n(values.begin() + at((o * view.size + j) * view.inner + i), inner,
                    block.begin() + at(j * inner));
      }
      device.write(in, std::span<const float>(block).first(view.size * inner));
      ops::mode_product(device, {1, view.size, inner}, in, ops::ModeProduct::project, factor, rank,
                        out);
      device.read(out, std::span(block).first(rank * inner));
      for (std::size_t r = 0; r < rank; ++r) {
        std::copy_n(block.begin() + at(r * inner), inner,
                    (waits ? slab.data() : values.data()) + r * view.inner + i);
      }
      pages.passed(view.size * inner);
    }
    if (waits) std::copy(slab.begin(), slab.end(), values.begin() + at(o * rank * view.inner));
  }
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
