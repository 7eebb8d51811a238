#include "support/guarded_buffer.hpp"

#include <algorithm>
#include <utility>

namespace weft::test {
namespace {

// Wide enough to meet a work-group's worth of stray floats.
constexpr std::size_t guard_bytes = 4096;

// No two neighbours alike, so that shifted copies of the guard itself are seen too.
std::byte guard_byte(std::size_t index) {
  return static_cast<std::byte>(0xA5 ^ (index * 151));
}

std::size_t round_up(std::size_t value, std::size_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

}  // namespace

bool is_simulator(const Device& device) {
  return device.limits().platform.find("Oclgrind") != std::string::npos;
}

GuardedBuffer::GuardedBuffer(Device& device, std::size_t bytes, std::string what)
    : device_(&device),
      what_(std::move(what)),
      guarded_(!is_simulator(device)),
      front_(round_up(guard_bytes, std::max<std::size_t>(device.limits().alignment, 1))),
      whole_(device, guarded_ ? front_ + bytes + guard_bytes : bytes, what_.c_str()) {
  if (!guarded_) return;
  contents_ = Buffer::part(device, whole_, front_, bytes, what_.c_str());
  std::vector<std::byte> initial(whole_.size(), std::byte{0xFF});
  for (std::size_t i = 0; i < initial.size(); ++i) {
    if (i < front_ || i >= front_ + bytes) initial[i] = guard_byte(i);
  }
  device.write(whole_, 0, initial);
}

testing::AssertionResult GuardedBuffer::intact() {
  if (!guarded_) return testing::AssertionSuccess();
  std::vector<std::byte> now(whole_.size());
  device_->read(whole_, 0, now);
  const std::size_t end = front_ + contents_.size();
  for (std::size_t i = 0; i < now.size(); ++i) {
    if ((i >= front_ && i < end) || now[i] == guard_byte(i)) continue;
    if (i < front_) {
      return testing::AssertionFailure()
             << what_ << ": byte " << front_ - i << " before its beginning was overwritten";
    }
    return testing::AssertionFailure()
           << what_ << ": byte " << i - end << " past its end was overwritten";
  }
  return testing::AssertionSuccess();
}

}  // namespace weft::test
