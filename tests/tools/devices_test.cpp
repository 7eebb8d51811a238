#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "tools/weft_process.hpp"
#include "weft/device/device.hpp"

namespace weft::test {
namespace {

TEST(Devices, JsonListsWhatTheLibraryLists) {
  const ProcessResult result = run_weft({"devices", "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  const nlohmann::json report = nlohmann::json::parse(result.out);
  const std::vector<DeviceLimits> devices = list_devices();
  ASSERT_EQ(report.at("devices").size(), devices.size());
  for (std::size_t i = 0; i < devices.size(); ++i) {
    const nlohmann::json& row = report.at("devices").at(i);
    EXPECT_EQ(row.at("index"), i);
    EXPECT_EQ(row.at("name"), devices[i].name);
    EXPECT_EQ(row.at("largest_allocation"), devices[i].largest_allocation);
    EXPECT_EQ(row.at("fp64"), devices[i].has_fp64);
  }
}

TEST(Devices, TableNamesEachDevice) {
  const ProcessResult result = run_weft({"devices"});
  ASSERT_EQ(result.status, 0) << result.err;
  for (const DeviceLimits& device : list_devices()) {
    EXPECT_NE(result.out.find(device.name), std::string::npos) << result.out;
  }
}

TEST(Devices, WithoutAnySaysHowToGetOne) {
  // The loader finds no driver in an empty place.
  const TemporaryFolder none;
  const ProcessResult result =
      run_weft({"devices", "--json"}, {{"OCL_ICD_VENDORS", none.path().string() + "/"}});
  EXPECT_EQ(result.status, 3);
  EXPECT_EQ(result.out, "{\"devices\":[]}\n");
  EXPECT_NE(result.err.find("apt-get install pocl-opencl-icd"), std::string::npos) << result.err;
}

TEST(Devices, TakesNoArguments) {
  const ProcessResult result = run_weft({"devices", "surplus"});
  EXPECT_EQ(result.status, 2);
  EXPECT_NE(result.err.find("surplus"), std::string::npos) << result.err;
}

TEST(Devices, OutputThatCannotBeWrittenIsAFailure) {
  const ProcessResult result =
      run_process({"/bin/sh", "-c", "\"$0\" devices >/dev/full", weft_command({}).front()});
  EXPECT_EQ(result.status, 4);
  EXPECT_NE(result.err.find("standard output"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace weft::test
