#include "report.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

namespace weft::test {
namespace {

Report example() {
  Report report;
  report.add("codec", "pca").add("rank", 64).add("time", 1.25, "s").add("mask", false);
  report.add("file_size", bytes_cell(1536));
  report.section("errors").add("psnr", std::numeric_limits<double>::infinity(), "dB");
  report.table("kernels", {"kernel", "launches"},
               {{text_cell("gemm"), count_cell(128)}, {text_cell("scan_tile"), count_cell(7)}});
  return report;
}

TEST(Report, Text) {
  EXPECT_EQ(example().to_text(),
            "codec      pca\n"
            "rank       64\n"
            "time       1.25 s\n"
            "mask       no\n"
            "file size  1.5 KiB (1536 bytes)\n"
            "errors\n"
            "  psnr  inf dB\n"
            "kernels\n"
            "  kernel     launches\n"
            "  gemm            128\n"
            "  scan_tile         7\n");
}

TEST(Report, Json) {
  EXPECT_EQ(example().to_json(),
            R"({"codec":"pca","rank":64,"time":1.25,"mask":false,"file_size":1536,)"
            R"("errors":{"psnr":"inf"},"kernels":[{"kernel":"gemm","launches":128},)"
            R"({"kernel":"scan_tile","launches":7}]})");
}

TEST(Report, NumbersKeepAllTheirDigitsInJson) {
  for (const double value : {0.1, 1.0 / 3.0, 1e-300, 6.02214076e23, -0.0}) {
    EXPECT_EQ(nlohmann::json::parse(number_cell(value).json).get<double>(), value);
  }
  EXPECT_EQ(number_cell(std::nan("")).json, "\"nan\"");
  EXPECT_EQ(number_cell(-std::numeric_limits<double>::infinity()).json, "\"-inf\"");
}

TEST(Report, TextOfAnyBytesIsValidJson) {
  const std::string hostile = "quote \" newline \n control \x01 not UTF-8 \xff\xfe";
  const nlohmann::json parsed = nlohmann::json::parse(text_cell(hostile).json);
  EXPECT_EQ(parsed.get<std::string>().find("quote \" newline \n control \x01"), 0U);
  // In the table nothing from a file moves the terminal's cursor.
  EXPECT_EQ(text_cell("a\nb\x1b[2Jc\x7f").text, "a?b?[2Jc?");
}

TEST(Report, SectionsStayValidAsMoreAreAdded) {
  Report report;
  Report& first = report.section("a");
  for (int i = 0; i < 100; ++i) report.section("b").add("i", i);
  first.add("x", 1);
  EXPECT_EQ(report.to_json().find(R"({"a":{"x":1},"b":{"i":0})"), 0U);
}

TEST(Report, ItemsAreAnArrayAndParagraphs) {
  Report report;
  report.item("files").add("file", "a");
  report.item("files").add("file", "b").add("rank", 3);
  EXPECT_EQ(report.to_json(), R"({"files":[{"file":"a"},{"file":"b","rank":3}]})");
  EXPECT_EQ(report.to_text(), "file  a\n\nfile  b\nrank  3\n");
}

TEST(Format, BytesAndSeconds) {
  EXPECT_EQ(format_bytes(1023), "1023 bytes");
  EXPECT_EQ(format_bytes(1024), "1.0 KiB");
  EXPECT_EQ(format_bytes(644972544), "615.1 MiB");
  EXPECT_EQ(format_seconds(0.0125), "12.5 ms");
  EXPECT_EQ(format_seconds(59.94), "59.9 s");
  EXPECT_EQ(format_seconds(59.97), "1 min 0 s");
  EXPECT_EQ(format_seconds(200), "3 min 20 s");
  EXPECT_EQ(format_seconds(7260), "2 h 1 min");
}

}  // namespace
}  // namespace weft::test
