#include "support/shared_device.hpp"

#include <gtest/gtest.h>

#include <memory>

#include "weft/device/handle.hpp"

namespace weft::test {
namespace {

std::unique_ptr<Device>& slot() {
  static std::unique_ptr<Device> device;
  return device;
}

class ReleasedAtEnd : public testing::Environment {
 public:
  void TearDown() override {
    slot().reset();
    EXPECT_EQ(live_cl_handles(), 0U) << "OpenCL objects are still alive";
  }
};

// GoogleTest owns it.
const testing::Environment* const released_at_end =
    testing::AddGlobalTestEnvironment(new ReleasedAtEnd);

}  // namespace

Device& shared_device() {
  if (!slot()) slot() = std::make_unique<Device>("auto");
  return *slot();
}

}  // namespace weft::test
