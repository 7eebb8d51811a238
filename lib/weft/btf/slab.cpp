#include "weft/btf/slab.hpp"

#include <array>
#include <cstring>
#include <vector>

#include "weft/error.hpp"

namespace weft {
namespace {

using Sizes = std::array<std::size_t, mode_count>;  // by mode

// Values of an image that lie side by side in both layouts: all of some inner modes.
std::size_t common_run(const BtfShape& shape, const Sizes& taken, const Sizes& steps) {
  std::size_t run = 1;
  for (const Mode mode : {Mode::channel, Mode::column, Mode::row}) {
    const std::size_t i = index_of(mode);
    if (taken[i] > 1 && steps[i] != run) return run;
    run *= taken[i];
    if (taken[i] != mode_size(shape, mode)) return run;
  }
  return run;
}

template <typename T>
void scatter(const T* from, std::size_t run, std::size_t count, std::size_t step, T* to) {
  if (run == 1) {
    for (std::size_t i = 0; i < count; ++i) to[i * step] = from[i];
  } else {
    for (std::size_t i = 0; i < count; ++i) {
      std::memcpy(to + i * step, from + i * run, run * sizeof(T));
    }
  }
}

// The part of one image, [Y][X][C] from its first wanted value, into its place.
template <typename T>
void copy_image(const BtfShape& shape, const Sizes& taken, const Sizes& steps, std::size_t run,
                const T* from, T* to) {
  const std::size_t x_from = shape.channels;
  const std::size_t y_from = shape.width * shape.channels;
  const std::size_t rows = taken[index_of(Mode::row)];
  const std::size_t columns = taken[index_of(Mode::column)];
  const std::size_t channels = taken[index_of(Mode::channel)];
  if (run == rows * columns * channels) {
    std::memcpy(to, from, run * sizeof(T));
    return;
  }
  for (std::size_t y = 0; y < rows; ++y) {
    const T* row = from + y * y_from;
    T* row_to = to + y * steps[index_of(Mode::row)];
    if (run == columns * channels) {
      std::memcpy(row_to, row, run * sizeof(T));
    } else if (run == channels && channels == shape.channels) {
      scatter(row, run, columns, steps[index_of(Mode::column)], row_to);
    } else {
      for (std::size_t x = 0; x < columns; ++x) {
        scatter(row + x * x_from, std::size_t{1}, channels, steps[index_of(Mode::channel)],
                row_to + x * steps[index_of(Mode::column)]);
      }
    }
  }
}

}  // namespace

void read_slab(TileSource& source, const Slab& slab, const ModeOrder& order,
               std::span<std::byte> out) {
  const BtfInfo& info = source.info();
  const BtfShape& shape = info.shape;
  Sizes first{};
  Sizes taken{};
  for (const Mode mode : all_modes) taken[index_of(mode)] = mode_size(shape, mode);
  const std::size_t whole = taken[index_of(slab.mode)];
  first[index_of(slab.mode)] = slab.first;
  taken[index_of(slab.mode)] = slab.count;
  Sizes steps{};
  std::size_t values = 1;
  for (std::size_t n = mode_count; n-- > 0;) {
    steps[index_of(order[n])] = values;
    values *= taken[index_of(order[n])];
  }
  const std::size_t bytes = size_of(info.dtype);
  if (slab.first > whole || slab.count > whole - slab.first || out.size() != values * bytes) {
    fail_input("slab [{}, {}) of mode {} with {}, {} bytes of it", slab.first,
               slab.first + slab.count, name_of(slab.mode), whole, out.size());
  }
  const std::size_t run = common_run(shape, taken, steps);
  const std::size_t begin =
      (first[index_of(Mode::row)] * shape.width + first[index_of(Mode::column)]) * shape.channels +
      first[index_of(Mode::channel)];
  std::vector<std::byte> image_values;
  for (std::size_t v = 0; v < taken[index_of(Mode::view)]; ++v) {
    for (std::size_t l = 0; l < taken[index_of(Mode::light)]; ++l) {
      const std::size_t image =
          (first[index_of(Mode::view)] + v) * shape.lights + first[index_of(Mode::light)] + l;
      std::span<const std::byte> from = source.mapped(image, 1);
      if (from.empty()) {
        image_values.resize(info.image_bytes());
        source.read(image, 1, image_values);
        from = image_values;
      }
      const std::size_t at = v * steps[index_of(Mode::view)] + l * steps[index_of(Mode::light)];
      const std::byte* start = from.data() + begin * bytes;
      std::byte* to = out.data() + at * bytes;
      // Mapped values may be unaligned.
      const auto copy = [&](auto zero) {
        using T = decltype(zero);
        copy_image(shape, taken, steps, run, reinterpret_cast<const T*>(start),
                   reinterpret_cast<T*>(to));
      };
      if (bytes == 1) {
        copy(std::array<std::byte, 1>{});
      } else if (bytes == 2) {
        copy(std::array<std::byte, 2>{});
      } else {
        copy(std::array<std::byte, 4>{});
      }
      source.release(image, 1);
    }
  }
}

}  // namespace weft
