// Programs, launches, profiling, and the release of everything.
#include "weft/device/device.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cctype>
#include <cmath>
#include <fstream>
#include <limits>
#include <memory>
#include <string>

#include "device/spin.hpp"
#include "support/expect_error.hpp"
#include "weft/error.hpp"

namespace weft::test {
namespace {

std::string build_error(Device& device, const std::string& options) {
  try {
    device.kernel(kernel_sources::gemm, options, "gemm");
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::runtime);
    return error.what();
  }
  ADD_FAILURE() << "gemm.cl builds with " << options;
  return {};
}

// The line number behind the first "FILE:" that is followed by one; 0 if there is none.
std::size_t line_in_log(const std::string& log, const std::string& file) {
  for (std::size_t at = log.find(file + ":"); at != std::string::npos;
       at = log.find(file + ":", at + 1)) {
    const std::string number = log.substr(at + file.size() + 1, 9);
    if (std::isdigit(static_cast<unsigned char>(number[0]))) return std::stoul(number);
  }
  return 0;
}

TEST(Program, AFailedBuildShowsTheLogWithFileAndLine) {
  Device device("auto");
  // MC is multiplied with in the body of gemm.cl
  const std::string own = build_error(device, "-DMC=rows_of_nothing");
  EXPECT_NE(own.find(device.limits().name), std::string::npos) << own;
  EXPECT_NE(own.find("-DMC=rows_of_nothing"), std::string::npos) << own;
  EXPECT_GT(line_in_log(own, "gemm.cl"), 0U) << own;
  EXPECT_NE(own.find("rows_of_nothing"), std::string::npos) << own;
  // VW is compared with in the included vector_width.cl
  const std::string included = build_error(device, "-DVW=8.5");
  EXPECT_GT(line_in_log(included, "vector_width.cl"), 0U) << included;
  // the device is as good as before
  EXPECT_NE(device.kernel(kernel_sources::gemm, "", "gemm"), nullptr);
}

TEST(Program, LinesOfTheLogAreThoseOfTheFile) {
  Device device("auto");
  const std::string log = build_error(device, "-DMC=rows_of_nothing");
  const std::size_t number = line_in_log(log, "gemm.cl");
  ASSERT_GT(number, 0U) << log;
  std::ifstream file(WEFT_KERNEL_FOLDER "/gemm.cl");
  std::string shown;
  for (std::size_t line = number; line > 0; --line) std::getline(file, shown);
  EXPECT_NE(shown.find("MC"), std::string::npos) << "line " << number << ": " << shown;
}

TEST(Program, KernelsAreBuiltOncePerOptions) {
  Device device("auto");
  const cl_kernel kernel = device.kernel(kernel_sources::gemm, "", "gemm");
  EXPECT_EQ(device.kernel(kernel_sources::gemm, "", "gemm"), kernel);
  EXPECT_NE(device.kernel(kernel_sources::gemm, "-DMC=48", "gemm"), kernel);
  EXPECT_NE(device.kernel(kernel_sources::gemm, "", "pack_panels"), kernel);
  expect_error(ErrorKind::runtime, {"no_such_kernel", "CL_INVALID_KERNEL_NAME"},
               [&] { device.kernel(kernel_sources::gemm, "", "no_such_kernel"); });
}

TEST(Launch, ErrorsNameTheKernel) {
  Device device("auto");
  const Buffer in(device, 16, "in");
  Buffer out(device, 16, "out");
  enqueue_spin(device, in, 1, out);
  device.finish();
  const std::array<std::size_t, 1> one{1};
  const std::array<std::size_t, 1> two{2};
  // work-groups of two, where the kernel asks for one
  const cl_kernel kernel = device.kernel(kernel_sources::error_sums, "", "error_sums");
  expect_error(ErrorKind::runtime, {"error_sums"}, [&] { device.launch(kernel, two, two); });
  expect_error(ErrorKind::runtime, {"argument 1", "error_sums"},
               [&] { set_arguments(kernel, in, std::int32_t{1}); });
  // the arguments were never all set
  expect_error(ErrorKind::runtime, {"error_sums", "CL_INVALID_KERNEL_ARGS"},
               [&] { device.launch(kernel, one, one); });
}

TEST(Profile, SumsLaunchesAndTimesPerKernel) {
  Device device("auto", true);
  const Buffer in(device, 16, "in");
  Buffer out(device, 16, "out");
  EXPECT_TRUE(device.profile().empty());
  for (int i = 0; i < 3; ++i) enqueue_spin(device, in, 1000, out);
  device.finish();
  ASSERT_EQ(device.profile().size(), 1U);
  const KernelTime first = device.profile().at("spin");
  EXPECT_EQ(first.launches, 3U);
  EXPECT_GE(first.seconds, 0.0);
  // sums go on, and a finish without launches adds nothing
  enqueue_spin(device, in, 1 << 20, out);
  device.finish();
  device.finish();
  const KernelTime second = device.profile().at("spin");
  EXPECT_EQ(second.launches, 4U);
  EXPECT_GT(second.seconds, first.seconds);
}

TEST(Profile, IsEmptyUnlessAskedFor) {
  Device device("auto");
  const Buffer in(device, 16, "in");
  Buffer out(device, 16, "out");
  enqueue_spin(device, in, 10, out);
  device.finish();
  EXPECT_TRUE(device.profile().empty());
}

TEST(Handles, AreReleasedAfterUseAndAfterErrors) {
  ASSERT_EQ(live_cl_handles(), 0U);
  {
    Device device("auto", true);
    const Buffer in(device, 256, "in");
    Buffer out(device, 256, "out");
    enqueue_spin(device, in, 10, out);
    EXPECT_GE(live_cl_handles(), 7U);  // context, queue, program, kernel, event, two buffers
  }
  EXPECT_EQ(live_cl_handles(), 0U);
  {
    Device device("auto");
    const Buffer whole(device, 256, "whole");
    EXPECT_THROW(device.kernel(kernel_sources::gemm, "-DMC=nothing", "gemm"), Error);
    EXPECT_THROW(device.kernel(kernel_sources::gemm, "", "nothing"), Error);
    EXPECT_THROW(Buffer(device, std::numeric_limits<std::size_t>::max(), "huge"), Error);
    EXPECT_THROW(Buffer::part(device, whole, 0, 257, "stray"), Error);
  }
  EXPECT_EQ(live_cl_handles(), 0U);
}

TEST(Handles, MovesNeitherLoseNorDoubleThem) {
  Device device("auto");
  const std::size_t before = live_cl_handles();
  {
    Buffer a(device, 1, "a");
    Buffer b = std::move(a);
    EXPECT_EQ(live_cl_handles(), before + 1);
    b = Buffer(device, 2, "b");
    EXPECT_EQ(live_cl_handles(), before + 1);
    std::vector<Buffer> many;
    for (int i = 0; i < 20; ++i) many.emplace_back(device, 1, "one of many");
    EXPECT_EQ(live_cl_handles(), before + 21);
  }
  EXPECT_EQ(live_cl_handles(), before);
}

}  // namespace
}  // namespace weft::test
