#include "weft/device/read_ahead.hpp"

#include <condition_variable>
#include <exception>
#include <mutex>
#include <span>
#include <thread>

#include "weft/error.hpp"
#include "weft/tensor/float_store.hpp"

namespace weft {
namespace {

// Fills runs ahead on a thread of its own, into two slots.
class ReadAhead {
 public:
  ReadAhead(std::size_t runs, std::size_t slot_bytes, const FillRun& fill)
      : runs_(runs), slot_bytes_(slot_bytes), fill_(fill) {
    // pages come as they are filled: a vector would be filled with zeros first
    const std::size_t floats = (slot_bytes + sizeof(float) - 1) / sizeof(float);
    for (Slot& slot : slots_) slot.values = FloatStore(floats);
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

  // The values of run `index`; waits for them. Rethrows what filling threw.
  std::span<const std::byte> wait(std::size_t index) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return filled_ > index || failure_; });
    if (filled_ <= index) std::rethrow_exception(failure_);
    const Slot& slot = slots_[index % 2];
    return std::as_bytes(std::span(slot.values)).first(slot.bytes);
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
  struct Slot {
    FloatStore values;
    std::size_t bytes = 0;
  };

  void run() {
    try {
      for (std::size_t index = 0; index < runs_; ++index) {
        {
          std::unique_lock lock(mutex_);
          changed_.wait(lock, [&] { return stopped_ || index < released_ + 2; });
          if (stopped_) return;
        }
        Slot& slot = slots_[index % 2];
        slot.bytes =
            fill_(index, std::as_writable_bytes(std::span(slot.values)).first(slot_bytes_));
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

  const std::size_t runs_;
  const std::size_t slot_bytes_;
  const FillRun& fill_;
  Slot slots_[2];
  std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t filled_ = 0;    // runs read
  std::size_t released_ = 0;  // runs the device is done with
  bool stopped_ = false;
  std::exception_ptr failure_;
  std::thread thread_;
};

}  // namespace

Handle<cl_event> mark(Device& device) {
  cl_event event = nullptr;
  check_cl(clEnqueueMarkerWithWaitList(device.queue(), 0, nullptr, &event), "clEnqueueMarker");
  device.flush();
  return Handle<cl_event>(event);
}

std::size_t read_ahead_bytes(const Device& device, std::size_t slot_bytes) {
  // two slots on the host, and on a device with memory of its own two there
  return device.limits().unified_memory ? 2 * slot_bytes : 4 * slot_bytes;
}

void for_each_run(Device& device, std::size_t runs, std::size_t slot_bytes, const FillRun& fill,
                  const UseRun& use) {
  const bool unified = device.limits().unified_memory;
  ReadAhead reader(runs, slot_bytes, fill);
  const FinishAtEnd finish_at_end(device);
  Buffer copies[2];
  Handle<cl_event> done[2];
  for (std::size_t index = 0; index < runs; ++index) {
    check_interrupt();
    const std::span<const std::byte> values = reader.wait(index);
    Buffer& raw = copies[index % 2];
    if (unified) {
      raw = Buffer::wrap(device, values, "images");
    } else {
      if (raw.size() < values.size()) raw = Buffer(device, values.size(), "images");
      device.write(raw, 0, values);
    }
    use(index, raw);
    done[index % 2] = mark(device);
    // The run before this one is done once its event is: its slot may be filled again.
    if (index > 0) {
      wait_for(done[(index - 1) % 2]);
      if (unified) copies[(index - 1) % 2] = Buffer();
      reader.release_before(index);
    }
  }
}

}  // namespace weft
