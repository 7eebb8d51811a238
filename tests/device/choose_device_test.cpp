// Choosing a device by "auto", by index and by name, and choices that fit none or several.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <string>

#include "support/expect_error.hpp"
#include "support/process.hpp"
#include "weft/device/device.hpp"

namespace weft::test {
namespace {

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

TEST(ChooseDevice, LimitsAreSensible) {
  const std::vector<DeviceLimits> all = list_devices();
  ASSERT_FALSE(all.empty()) << "the tests need an OpenCL device";
  for (const DeviceLimits& limits : all) {
    SCOPED_TRACE(limits.name);
    EXPECT_FALSE(limits.name.empty());
    EXPECT_FALSE(limits.platform.empty());
    EXPECT_EQ(limits.version.rfind("OpenCL ", 0), 0U) << limits.version;
    EXPECT_GE(limits.compute_units, 1U);
    EXPECT_GE(limits.max_work_group, 1U);
    EXPECT_GE(limits.alignment, 1U);
    // what the standard guarantees: a quarter of the memory, or 1 MiB
    EXPECT_GE(limits.largest_allocation, std::size_t{1} << 20);
    EXPECT_GE(limits.global_memory, limits.largest_allocation);
    EXPECT_GE(limits.local_memory, std::size_t{16} << 10);
  }
}

TEST(ChooseDevice, AutoIsTheFirstThatIsNoCpuElseTheFirst) {
  const std::vector<DeviceLimits> all = list_devices();
  ASSERT_FALSE(all.empty());
  const auto gpu =
      std::find_if(all.begin(), all.end(), [](const DeviceLimits& d) { return !d.is_cpu; });
  const Device device("auto");
  EXPECT_EQ(device.limits().name, gpu != all.end() ? gpu->name : all.front().name);
}

TEST(ChooseDevice, ByIndexAndByPartOfAName) {
  const std::vector<DeviceLimits> all = list_devices();
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_EQ(Device(std::to_string(i)).limits().name, all[i].name);
  }
  if (all.size() == 1) {
    const std::string& name = all.front().name;
    EXPECT_EQ(Device(name).limits().name, name);
    EXPECT_EQ(Device(upper(name.substr(0, 4))).limits().name, name);
    EXPECT_EQ(Device(upper(all.front().platform)).limits().name, name);
  }
}

TEST(ChooseDevice, AChoiceThatFitsNoneIsNamed) {
  const std::vector<DeviceLimits> all = list_devices();
  const std::string past = std::to_string(all.size());
  expect_error(ErrorKind::input, {"--device " + past, std::to_string(all.size() - 1)},
               [&] { Device device(past); });
  // too long for any integer
  const std::string huge(40, '9');
  expect_error(ErrorKind::input, {"--device " + huge}, [&] { Device device(huge); });
  for (const char* choice : {"no such device", "-1", "0x0", "1.5", " 0"}) {
    expect_error(ErrorKind::input, {std::string("--device ") + choice, all.front().name},
                 [&] { Device device(choice); });
  }
  expect_error(ErrorKind::input, {"--device", all.front().name}, [] { Device device(""); });
  EXPECT_EQ(live_cl_handles(), 0U);
}

// The loader reads OCL_ICD_VENDORS once per process, so the case without a driver has its own.
TEST(ChooseDevice, DISABLED_InAProcessWithoutDrivers) {
  EXPECT_TRUE(list_devices().empty());
  for (const char* choice : {"auto", "0", "name"}) {
    expect_error(ErrorKind::no_device, {"apt-get install pocl-opencl-icd", "--device reference"},
                 [&] { Device device(choice); });
  }
}

TEST(ChooseDevice, WithoutADriverItSaysHowToGetOne) {
  const TemporaryFolder none;
  const ProcessResult result =
      run_process({"/proc/self/exe", "--gtest_also_run_disabled_tests",
                   "--gtest_filter=ChooseDevice.DISABLED_InAProcessWithoutDrivers"},
                  {{"OCL_ICD_VENDORS", none.path().string() + "/"}});
  EXPECT_EQ(result.status, 0) << result.out << result.err;
  EXPECT_NE(result.out.find("[  PASSED  ] 1 test."), std::string::npos) << result.out;
}

}  // namespace
}  // namespace weft::test
