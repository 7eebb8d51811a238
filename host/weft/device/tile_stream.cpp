#include "weft/device/tile_stream.hpp"

#include <algorithm>

#include "weft/device/read_ahead.hpp"
#include "weft/error.hpp"

namespace weft {

TileStream::TileStream(Device& device, TileSource& source, std::size_t granule)
    : device_(device), source_(source), granule_(granule) {
  // A selection of a mapped source can be mapped image by image and not in runs.
  const std::size_t images = source.info().shape.images();
  mapped_ = device.limits().unified_memory;
  for (std::size_t first = 0; mapped_ && first < images; first += granule) {
    mapped_ = !source.mapped(first, std::min(granule, images - first)).empty();
  }
}

std::size_t TileStream::buffer_bytes() const {
  if (mapped_) return 0;
  return read_ahead_bytes(
      device_, std::min(granule_, source_.info().shape.images()) * source_.info().image_bytes());
}

void TileStream::for_each(const Work& work) {
  if (mapped_) {
    for_each_mapped(work);
  } else {
    for_each_read(work);
  }
}

void TileStream::for_each_mapped(const Work& work) {
  const std::size_t images = source_.info().shape.images();
  const FinishAtEnd finish_at_end(device_);
  struct Run {
    std::size_t first = 0;
    std::size_t count = 0;
    Buffer raw;
    Handle<cl_event> done;
  };
  Run previous;
  const auto retire = [&] {
    if (previous.count == 0) return;
    wait_for(previous.done);
    previous.raw = Buffer();
    source_.release(previous.first, previous.count);
  };
  for (std::size_t first = 0; first < images; first += granule_) {
    check_interrupt();
    Run run;
    run.first = first;
    run.count = std::min(granule_, images - first);
    run.raw = Buffer::wrap(device_, source_.mapped(first, run.count), "mapped images");
    // While the device works on this run, the system reads the next.
    const std::size_t next = first + run.count;
    if (next < images) source_.prefetch(next, std::min(granule_, images - next));
    work(first, run.count, run.raw);
    run.done = mark(device_);
    retire();
    previous = std::move(run);
  }
  retire();
}

void TileStream::for_each_read(const Work& work) {
  const std::size_t images = source_.info().shape.images();
  const std::size_t image_bytes = source_.info().image_bytes();
  const std::size_t runs = (images + granule_ - 1) / granule_;
  const auto count = [&](std::size_t run) { return std::min(granule_, images - run * granule_); };
  for_each_run(
      device_, runs, std::min(granule_, images) * image_bytes,
      [&](std::size_t run, std::span<std::byte> slot) {
        const std::size_t bytes = count(run) * image_bytes;
        source_.read(run * granule_, count(run), slot.first(bytes));
        source_.release(run * granule_, count(run));
        return bytes;
      },
      [&](std::size_t run, const Buffer& raw) { work(run * granule_, count(run), raw); });
}

std::size_t image_granule(const BtfShape& shape) {
  constexpr std::size_t working_set = std::size_t{16} << 20;
  constexpr std::size_t enough_rows = 192;
  const std::size_t by_size = working_set / (shape.image_values() * sizeof(float));
  const std::size_t by_rows = (enough_rows + shape.channels - 1) / shape.channels;
  return std::clamp<std::size_t>(std::min(by_size, by_rows), 1, shape.images());
}

}  // namespace weft
