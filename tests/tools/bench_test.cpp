// weft bench as a process.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>

#include "tools/weft_process.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

TEST(Bench, MeasuresWhatIsAskedFor) {
  const ProcessResult result =
      run_weft({"bench", "--filter", "convert_tile", "--repeat", "1", "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  const json report = json::parse(result.out);
  EXPECT_GT(report.at("peak_fma").get<double>(), 0);
  EXPECT_GT(report.at("peak_copy").get<double>(), 0);
  ASSERT_GE(report.at("operations").size(), 3U);  // a row per type of values
  for (const json& row : report.at("operations")) {
    EXPECT_NE(row.at("operation").get<std::string>().find("convert_tile"), std::string::npos);
    for (const char* field : {"least_ms", "median_ms", "gflops", "of_peak", "gigabytes_per_second",
                              "of_bandwidth", "of_bound"}) {
      EXPECT_GT(row.at(field).get<double>(), 0) << field;
    }
  }
  // which values the kernel was built with
  const json& tuning = report.at("tuning").at("convert_tile");
  EXPECT_FALSE(tuning.at("source").get<std::string>().empty());
  EXPECT_TRUE(tuning.at("PANELS").is_number_unsigned());
}

TEST(Bench, ListsOperationsWithoutMeasuring) {
  const ProcessResult result = run_weft({"bench", "--list", "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  const json report = json::parse(result.out);
  std::set<std::pair<std::string, std::string>> rows;
  std::set<std::string> operations;
  for (const json& row : report.at("operations")) {
    operations.insert(row.at("operation").get<std::string>());
    EXPECT_TRUE(rows.emplace(row.at("operation"), row.at("shape")).second) << row;
  }
  for (const char* kernel : {"gemm",
                             "scan_tile",
                             "convert_tile",
                             "error_sums",
                             "transcode_tile",
                             "decode_pca",
                             "decode_lpca",
                             "decode_sparse",
                             "look_up_sparse",
                             "centre_clusters",
                             "project_clusters",
                             "assign_clusters",
                             "add_texel_squares",
                             "orthonormalise",
                             "tsqr",
                             "surface_hits",
                             "surface_shade",
                             "syrk_packed",
                             "syrk_rows",
                             "mode_gram",
                             "mode_product",
                             "convert_tile_transposed",
                             "gemm (double)"}) {
    EXPECT_TRUE(operations.contains(kernel)) << kernel;
  }
  for (const char* kernel :
       {"code_residuals", "ksvd_update", "invert_colour log", "log_error_sums"}) {
    EXPECT_TRUE(operations.contains(kernel)) << kernel;
  }
}

TEST(Bench, TheReferenceIsNotMeasured) {
  const ProcessResult result = run_weft({"bench", "--device", "reference"});
  EXPECT_EQ(result.status, 2);
  EXPECT_NE(result.err.find("--device reference"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace weft::test
