#include "weft/device/tile_stream.hpp"

#include <algorithm>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "weft/error.hpp"

namespace weft {
namespace {

// Reads runs of images ahead on a thread of its own, into two slots.
class ReadAhead {
 public:
  ReadAhead(TileSource& source, std::size_t granule)
      : source_(source), granule_(granule), images_(source.info().shape.images()) {
    for (std::vector<std::byte>& slot : slots_) {
      slot.resize(std::min(granule, images_) * source.info().image_bytes());
    }
    thread_ = std::thread([this] { run(); });
  }

  ~ReadAhead() {
    {
      const std::lock_guard lock(mutex_);
      stopped_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }
  ReadAhead(const ReadAhead&) = delete;
  ReadAhead& operator=(const ReadAhead&) = delete;

  // The values of run `index`; waits for them. Rethrows what the source threw.
  std::span<const std::byte> wait(std::size_t index) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return filled_ > index || failure_; });
    if (filled_ <= index) std::rethrow_exception(failure_);
    const std::size_t first = index * granule_;
    const std::size_t count = std::min(granule_, images_ - first);
    return std::span(slots_[index % 2]).first(count * source_.info().image_bytes());
  }

  // Says that the device is done with all runs before `index`.
  void release_before(std::size_t index) {
    {
      const std::lock_guard lock(mutex_);
      released_ = index;
    }
    changed_.notify_all();
  }

 private:
  void run() {
    const std::size_t runs = (images_ + granule_ - 1) / granule_;
    try {
      for (std::size_t index = 0; index < runs; ++index) {
        {
          std::unique_lock lock(mutex_);
          changed_.wait(lock, [&] { return stopped_ || index < released_ + 2; });
          if (stopped_) return;
        }
        const std::size_t first = index * granule_;
        const std::size_t count = std::min(granule_, images_ - first);
        source_.read(first, count,
                     std::span(slots_[index % 2]).first(count * source_.info().image_bytes()));
        source_.release(first, count);
        {
          const std::lock_guard lock(mutex_);
          filled_ = index + 1;
        }
        changed_.notify_all();
      }
    } catch (...) {
      {
        const std::lock_guard lock(mutex_);
        failure_ = std::current_exception();
      }
      changed_.notify_all();
    }
  }

  TileSource& source_;
  const std::size_t granule_;
  const std::size_t images_;
  std::vector<std::byte> slots_[2];
  std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t filled_ = 0;    // runs read
  std::size_t released_ = 0;  // runs the device is done with
  bool stopped_ = false;
  std::exception_ptr failure_;
  std::thread thread_;
};

// An event behind all work that was enqueued so far.
Handle<cl_event> mark(Device& device) {
  cl_event event = nullptr;
  check_cl(clEnqueueMarkerWithWaitList(device.queue(), 0, nullptr, &event), "clEnqueueMarker");
  device.flush();
  return Handle<cl_event>(event);
}

// However a pass ends, the device must have stopped reading host memory before that goes.
class FinishAtEnd {
 public:
  explicit FinishAtEnd(Device& device) : device_(device) {}
  ~FinishAtEnd() { clFinish(device_.queue()); }
  FinishAtEnd(const FinishAtEnd&) = delete;
  FinishAtEnd& operator=(const FinishAtEnd&) = delete;

 private:
  Device& device_;
};

}  // namespace

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
  const std::size_t run =
      std::min(granule_, source_.info().shape.images()) * source_.info().image_bytes();
  // two slots on the host, and on a device with memory of its own two there
  return device_.limits().unified_memory ? 2 * run : 4 * run;
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
  const bool unified = device_.limits().unified_memory;
  ReadAhead reader(source_, granule_);
  const FinishAtEnd finish_at_end(device_);
  Buffer copies[2];
  Handle<cl_event> done[2];
  for (std::size_t index = 0; index * granule_ < images; ++index) {
    check_interrupt();
    const std::size_t first = index * granule_;
    const std::size_t count = std::min(granule_, images - first);
    const std::span<const std::byte> values = reader.wait(index);
    Buffer& raw = copies[index % 2];
    if (unified) {
      raw = Buffer::wrap(device_, values, "images");
    } else {
      if (raw.size() < values.size()) raw = Buffer(device_, values.size(), "images");
      device_.write(raw, 0, values);
    }
    work(first, count, raw);
    done[index % 2] = mark(device_);
    // The run before this one is done once its event is: its slot may be filled again.
    if (index > 0) {
      wait_for(done[(index - 1) % 2]);
      if (unified) copies[(index - 1) % 2] = Buffer();
      reader.release_before(index);
    }
  }
}

std::size_t image_granule(const BtfShape& shape) {
  constexpr std::size_t working_set = std::size_t{16} << 20;
  constexpr std::size_t enough_rows = 192;
  const std::size_t by_size = working_set / (shape.image_values() * sizeof(float));
  const std::size_t by_rows = (enough_rows + shape.channels - 1) / shape.channels;
  return std::clamp<std::size_t>(std::min(by_size, by_rows), 1, shape.images());
}

}  // namespace weft
