#include "support/guarded_buffer.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <fstream>
#include <sstream>

#include "support/matchers.hpp"
#include "weft/device/device.hpp"

namespace weft::test {
namespace {

void run_stray_writes(Device& device, Buffer& out, std::uint64_t n, std::int64_t stray) {
  std::ifstream file(WEFT_STRAY_KERNEL_FILE);
  std::ostringstream text;
  text << file.rdbuf();
  const std::string source = text.str();
  cl_kernel kernel = device.kernel({"stray_writes.cl", source.c_str()}, "", "stray_writes");
  set_arguments(kernel, out, n, stray);
  const std::array<std::size_t, 1> global{n};
  const std::array<std::size_t, 1> local{1};
  device.launch(kernel, global, local);
  device.finish();
}

TEST(GuardedBuffer, SmallIntact) {
  Device device("auto");
  GuardedBuffer guarded(device, 7 * sizeof(float), "out");
  run_stray_writes(device, guarded.buffer(), 7, 0);
  EXPECT_TRUE(guarded.intact());
  EXPECT_TRUE(all_equal(guarded.values<float>(), std::vector<float>(7, 1.0F)));
}

TEST(GuardedBuffer, ContentsBeginAsGivenOrAsNan) {
  Device device("auto");
  GuardedBuffer nan(device, 3 * sizeof(float), "nan");
  for (const float value : nan.values<float>()) EXPECT_TRUE(std::isnan(value));
  const std::vector<float> values{1.5F, -2.0F, 3.0F};
  GuardedBuffer given(device, std::span<const float>(values), "given");
  EXPECT_TRUE(all_equal(given.values<float>(), values));
  EXPECT_TRUE(given.intact());
}

TEST(GuardedBuffer, SeesWritesOnBothSides) {
  Device device("auto");
  // The guards are memory of this process, so a stray write into them does no harm.
  GuardedBuffer past(device, 7 * sizeof(float), "past");
  run_stray_writes(device, past.buffer(), 7, 8);
  const testing::AssertionResult after = past.intact();
  EXPECT_FALSE(after);
  EXPECT_STREQ(after.message(), "past: byte 4 past its end was overwritten");

  GuardedBuffer before(device, 7 * sizeof(float), "before");
  run_stray_writes(device, before.buffer(), 7, -1);
  const testing::AssertionResult front = before.intact();
  EXPECT_FALSE(front);
  EXPECT_STREQ(front.message(), "before: byte 4 before its beginning was overwritten");
}

// For the simulator alone: it has to report this write. Elsewhere nothing strays.
TEST(StrayWrite, IsLeftToTheSimulator) {
  Device device("auto");
  Buffer buffer(device, 7 * sizeof(float), "out");
  const bool simulator = device.limits().platform.find("Oclgrind") != std::string::npos;
  run_stray_writes(device, buffer, 7, simulator ? 7 : 0);
}

}  // namespace
}  // namespace weft::test
