// weft tradeoff as a process: what it writes, how it goes on after a stop, and what it refuses.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

using nlohmann::json;
using Words = std::vector<std::string>;

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

json results_of(const std::filesystem::path& folder) {
  return json::parse(text_of(folder / "results.json"));
}

std::string write_raw(const std::filesystem::path& path, std::uint64_t seed) {
  const auto source = random_source({4, 5, 12, 13, 3}, DType::f16, seed);
  const auto sink = create_raw_btf(path, source->info());
  sink->write(0, source->info().shape.images(), source->bytes());
  sink->finish();
  return path;
}

// Quick measurements: one run of each encoding, few look-ups, no pictures.
Words quick(const Words& inputs, const std::filesystem::path& folder, const Words& more) {
  Words words{"tradeoff"};
  words.insert(words.end(), inputs.begin(), inputs.end());
  words.insert(words.end(), {"-o", folder.string(), "--repeat", "1", "--lookups", "1000",
                             "--no-pictures", "--json", "--quiet"});
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

// Lines and fields as RFC 4180 has them.
std::vector<Words> parse_csv(const std::string& text) {
  std::vector<Words> lines(1, Words(1));
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted && c == '"' && i + 1 < text.size() && text[i + 1] == '"') {
      lines.back().back() += text[++i];
    } else if (c == '"') {
      quoted = !quoted;
    } else if (quoted) {
      lines.back().back() += c;
    } else if (c == ',') {
      lines.back().emplace_back();
    } else if (c == '\n') {
      EXPECT_TRUE(i > 0 && text[i - 1] == '\r');
      lines.emplace_back(1);
    } else if (c != '\r') {
      lines.back().back() += c;
    }
  }
  EXPECT_FALSE(quoted);
  EXPECT_EQ(lines.back(), Words(1)) << "the last line is not ended";
  lines.pop_back();
  return lines;
}

TEST(Tradeoff, MeasuresEveryPointOfEveryMaterial) {
  const TemporaryFolder folder;
  const std::string a = write_raw(folder / "a, \"b\".safetensors", 1);
  const std::string b = write_raw(folder / "c.safetensors", 2);
  const ProcessResult run = run_weft(
      quick({a, b}, folder / "out",
            {"--point", "pca --rank 3 --storage f32", "--point", "--codec view-pca --rank 1"}));
  ASSERT_EQ(run.status, 0) << run.err;
  const json report = json::parse(run.out);
  EXPECT_EQ(report.at("points"), 4);
  EXPECT_EQ(report.at("measured"), 4);
  EXPECT_EQ(report.at("failed"), 0);

  // The figures are those of compress.
  const ProcessResult compress =
      run_weft({"compress", a, "--codec", "pca", "--rank", "3", "--storage", "f32", "--ssim",
                "--json", "--quiet", "-o", folder / "a.weft"});
  ASSERT_EQ(compress.status, 0) << compress.err;
  const json expected = json::parse(compress.out);
  const json results = results_of(folder / "out");
  ASSERT_EQ(results.at("points").size(), 4U);
  const json& point = results.at("points").at(0);
  const json& figures = point.at("figures");
  EXPECT_EQ(point.at("codec"), "pca");
  EXPECT_EQ(point.at("status"), 0);
  EXPECT_EQ(figures.at("file_size"), expected.at("file_size"));
  EXPECT_EQ(figures.at("ratio"), expected.at("ratio"));
  for (const char* name : {"rmse", "psnr", "snr", "relative", "max_error", "ssim"}) {
    EXPECT_EQ(figures.at(name), expected.at("errors").at(name)) << name;
  }
  for (const char* name : {"encode_time", "image_rate", "texel_rate", "lookup_rate",
                           "sorted_lookup_rate", "texel_time"}) {
    EXPECT_GT(figures.at(name).get<double>(), 0) << name;
  }
  EXPECT_EQ(figures.at("texel_rate").get<double>(), figures.at("image_rate").get<double>() * 156);
  // a process with an OpenCL driver takes megabytes, and these small materials no gigabytes
  EXPECT_GT(figures.at("peak_memory").get<double>(), 4e6);
  EXPECT_LT(figures.at("peak_memory").get<double>(), 8e9);
  for (const char* left : {"models", "work"}) {
    EXPECT_FALSE(std::filesystem::exists(folder / "out" / left)) << left;
  }

  // A table of as many fields everywhere, with the same numbers.
  const std::vector<Words> lines = parse_csv(text_of(folder / "out" / "results.csv"));
  ASSERT_EQ(lines.size(), 5U);
  for (const Words& line : lines) EXPECT_EQ(line.size(), lines[0].size());
  EXPECT_EQ(lines[1][0], "a, \"b\"");
  EXPECT_EQ(lines[1][2], "--rank 3 --storage f32");
  const auto column =
      static_cast<std::size_t>(std::ranges::find(lines[0], "rmse") - lines[0].begin());
  EXPECT_EQ(std::stod(lines[1][column]), figures.at("rmse").get<double>());

  // One file, with the points in it.
  const std::string page = text_of(folder / "out" / "index.html");
  for (const json& one : results.at("points")) {
    EXPECT_NE(page.find(one.at("key").get<std::string>()), std::string::npos);
  }
  for (const char* place : {"/*style*/", "/*script*/", "/*data*/", "src=\"", "url("}) {
    EXPECT_EQ(page.find(place), std::string::npos) << place;
  }
}

TEST(Tradeoff, ObjectsOfAGridAreAllCombinations) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder / "a.safetensors", 1);
  std::ofstream(folder / "grid.json")
      << R"({"points": [{"codec": ["pca", "view-pca"], "rank": [1, 2], "storage": [null, "f32"]},
                        "pca --rank 1", "tt --rank 2"]})";
  const ProcessResult run = run_weft(
      quick({raw}, folder / "out", {"--grid", folder / "grid.json", "--codecs", "pca,tt"}));
  ASSERT_EQ(run.status, 0) << run.err;
  std::vector<std::string> texts;
  const json report = json::parse(run.out);
  for (const json& row : report.at("table")) texts.push_back(row.at("point"));
  EXPECT_EQ(texts, (Words{"pca --rank 1", "pca --rank 1 --storage f32", "pca --rank 2",
                          "pca --rank 2 --storage f32", "tt --rank 2"}));
}

TEST(Tradeoff, TheDefaultGridIsAGrid) {
  const TemporaryFolder folder;
  const ProcessResult printed = run_weft({"tradeoff", "--print-grid"});
  ASSERT_EQ(printed.status, 0) << printed.err;
  EXPECT_GT(json::parse(printed.out).at("points").size(), 5U);
  // Every point is checked before any is measured, or an input is looked at.
  const ProcessResult run = run_weft(quick({folder / "none.safetensors"}, folder / "out", {}));
  EXPECT_EQ(run.status, 2);
  EXPECT_NE(run.err.find("none.safetensors"), std::string::npos) << run.err;
}

TEST(Tradeoff, GoesOnAfterBeingKilled) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder / "a.safetensors", 1);
  Words more;
  for (int rank = 1; rank <= 5; ++rank) {
    more.emplace_back("--point");
    more.push_back("pca --rank " + std::to_string(rank));
  }
  const Words words = quick({raw}, folder / "out", more);
  std::size_t before = 0;
  {
    Process process(weft_command(words));
    // once a point is recorded
    while (process.running() && before == 0) {
      if (std::filesystem::exists(folder / "out" / "results.json")) {
        before = results_of(folder / "out").at("points").size();
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    process.send_signal(SIGKILL);
    EXPECT_EQ(process.wait().status, 128 + SIGKILL);
  }
  before = results_of(folder / "out").at("points").size();
  ASSERT_GE(before, 1U);
  ASSERT_LT(before, 5U);
  const json first = results_of(folder / "out").at("points").at(0);

  const ProcessResult again = run_weft(words);
  ASSERT_EQ(again.status, 0) << again.err;
  const json report = json::parse(again.out);
  EXPECT_EQ(report.at("known_before"), before);
  EXPECT_EQ(report.at("measured"), 5 - before);
  const json results = results_of(folder / "out");
  std::set<std::string> keys;
  for (const json& point : results.at("points")) keys.insert(point.at("key"));
  EXPECT_EQ(keys.size(), 5U);
  EXPECT_EQ(results.at("points").size(), 5U);
  EXPECT_EQ(results.at("points").at(0), first);  // not measured again
  EXPECT_FALSE(std::filesystem::exists(folder / "out" / "work"));

  // A third run has nothing to do; another version of the program, all.
  const json third = json::parse(run_weft(words).out);
  EXPECT_EQ(third.at("measured"), 0);
  json other = results;
  other["program_version"] = "0.0.1";
  std::ofstream(folder / "out" / "results.json") << other;
  const json fourth =
      json::parse(run_weft(quick({raw}, folder / "out", {"--point", "pca --rank 1"})).out);
  EXPECT_EQ(fourth.at("measured"), 1);
  EXPECT_EQ(results_of(folder / "out").at("points").size(), 1U);
}

TEST(Tradeoff, InterruptedItLeavesAPageAndNoChild) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder / "a.safetensors", 1);
  Words more;
  for (int rank = 1; rank <= 20; ++rank) {
    more.emplace_back("--point");
    more.push_back("pca --rank " + std::to_string(rank));
  }
  Process process(weft_command(quick({raw}, folder / "out", more)));
  while (process.running() && !std::filesystem::exists(folder / "out" / "results.json")) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  process.send_signal(SIGINT);
  const ProcessResult result = process.wait();
  EXPECT_EQ(result.status, 130) << result.err;
  EXPECT_TRUE(std::filesystem::exists(folder / "out" / "index.html"));
  EXPECT_TRUE(std::filesystem::exists(folder / "out" / "results.csv"));
  EXPECT_LT(results_of(folder / "out").at("points").size(), 20U);
  for (const json& point : results_of(folder / "out").at("points")) {
    EXPECT_EQ(point.at("status"), 0);
  }
}

TEST(Tradeoff, NoticesAChangedInput) {
  const TemporaryFolder folder;
  const std::string a = write_raw(folder / "a.safetensors", 1);
  const std::string b = write_raw(folder / "b.safetensors", 2);
  const Words words = quick({a, b}, folder / "out", {"--point", "pca --rank 2"});
  ASSERT_EQ(run_weft(words).status, 0);
  const json before = results_of(folder / "out");
  write_raw(a, 3);
  const ProcessResult again = run_weft(words);
  ASSERT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(json::parse(again.out).at("measured"), 1);
  const json after = results_of(folder / "out");
  ASSERT_EQ(after.at("points").size(), 2U);
  ASSERT_EQ(after.at("materials").size(), 2U);
  std::set<std::string> errors;
  for (const json* results : {&before, &after}) {
    for (const json& point : results->at("points")) {
      errors.insert(point.at("figures").at("rmse").dump());
    }
  }
  EXPECT_EQ(errors.size(), 3U);
}

TEST(Tradeoff, APointThatFailsLosesItselfAlone) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder / "a.safetensors", 1);
  const Words unmet{"--point", "tucker --target rel=1e-6 --ranks v=2", "--point", "pca --rank 1"};
  const ProcessResult goal = run_weft(quick({raw}, folder / "out", unmet));
  EXPECT_EQ(goal.status, 0) << goal.err;  // that a goal can't be met is a result
  EXPECT_EQ(json::parse(goal.out).at("unmet_goals"), 1);
  const json first = results_of(folder / "out").at("points").at(0);
  EXPECT_EQ(first.at("status"), 1);
  EXPECT_NE(first.at("message").get<std::string>().find("rel"), std::string::npos) << first;
  EXPECT_TRUE(first.at("figures").empty());

  const ProcessResult failed = run_weft(
      quick({raw}, folder / "out", {"--point", "pca --rank none", "--point", "pca --rank 2"}));
  EXPECT_EQ(failed.status, 1);
  EXPECT_NE(failed.err.find("1 of 2 points failed"), std::string::npos) << failed.err;
  EXPECT_EQ(json::parse(failed.out).at("table").size(), 2U);
  // with what earlier runs measured
  const std::vector<Words> lines = parse_csv(text_of(folder / "out" / "results.csv"));
  EXPECT_EQ(lines.size(), 5U);

  // What takes too long is measured again next time.
  const Words words = quick({raw}, folder / "out", {"--point", "pca --rank 3"});
  Words hasty = words;
  hasty.insert(hasty.end(), {"--time-limit", "0.001"});
  EXPECT_EQ(run_weft(hasty).status, 1);
  const json last = results_of(folder / "out").at("points").back();
  EXPECT_NE(last.at("message").get<std::string>().find("time limit"), std::string::npos) << last;
  const ProcessResult patient = run_weft(words);
  EXPECT_EQ(patient.status, 0) << patient.err;
  EXPECT_EQ(json::parse(patient.out).at("measured"), 1);
}

TEST(Tradeoff, KeepsModelsAndPicturesWhereAsked) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder / "a.safetensors", 1);
  const std::filesystem::path out = folder / "out";
  const ProcessResult run =
      run_weft({"tradeoff", raw, "-o", out, "--repeat", "1", "--lookups", "1000", "--point",
                "pca --rank 2", "--keep-models", "--quiet"});
  ASSERT_EQ(run.status, 0) << run.err;
  std::size_t models = 0;
  for (const auto& entry : std::filesystem::directory_iterator(out / "models")) {
    models += entry.path().extension() == ".weft" ? 1 : 2;  // and nothing else
    EXPECT_EQ(run_weft({"info", entry.path()}).status, 0);
  }
  EXPECT_EQ(models, 1U);
  const json point = results_of(out).at("points").at(0);
  EXPECT_EQ(point.at("message"), "");
  // two pictures of the material and two of the model, in the page as well
  const auto images = std::filesystem::directory_iterator(out / "images");
  EXPECT_EQ(std::distance(begin(images), end(images)), 4);
  const std::string page = text_of(out / "index.html");
  std::size_t embedded = 0;
  for (std::size_t at = page.find("data:image/png;base64,"); at != std::string::npos;
       at = page.find("data:image/png;base64,", at + 1)) {
    ++embedded;
  }
  EXPECT_EQ(embedded, 4U);
}

TEST(Tradeoff, BadUsage) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder / "a.safetensors", 1);
  const std::string copy = write_raw(folder / "copy.safetensors", 1);
  const auto grid = [&](const std::string& text) {
    std::ofstream(folder / "grid.json") << text;
    return quick({raw}, folder / "out", {"--grid", folder / "grid.json"});
  };
  const auto expect_refused = [](const Words& words, const std::string& message) {
    const ProcessResult run = run_weft(words);
    EXPECT_EQ(run.status, 2) << message;
    EXPECT_NE(run.err.find(message), std::string::npos) << run.err;
    EXPECT_EQ(run.out, "");
  };
  expect_refused(grid("[1"), "grid.json: not valid JSON");
  expect_refused(grid("{}"), "neither a list of points");
  expect_refused(grid("[]"), "neither a list of points");
  expect_refused(grid("[7]"), "element 1: neither the text");
  expect_refused(grid(R"(["pca", {"rank": 3}])"), "element 2: \"codec\" is missing");
  expect_refused(grid(R"([{"codec": "pca", "rank": []}])"), "\"rank\" is an empty list");
  expect_refused(grid(R"([{"codec": "pca", "--rank": 3}])"), "without dashes");
  expect_refused(grid(R"([{"codec": "pca", "rank": {"a": 1}}])"), "neither a text nor a number");
  expect_refused(grid(R"([{"codec": "mp3"}])"), "mp3");
  std::string many = R"([{"codec": "pca")";
  for (const char* name : {"rank", "seed", "peak", "nan", "level"}) {
    many += std::string(",\"") + name + "\": [1,2,3,4,5,6,7,8,9,10,11,12,13,14]";
  }
  expect_refused(grid(many + "}]"), "more than 10000 points");
  const auto point = [&](const std::string& text) {
    return quick({raw}, folder / "out", {"--point", text});
  };
  expect_refused(point("--rank 3"), "does not begin with a codec");
  expect_refused(point("pca --rank '3"), "quote that is not closed");
  expect_refused(point("pca --ranc 3"), "--ranc");
  expect_refused(point("pca --clusters 3"), "not a parameter of codec pca");
  expect_refused(point("pca -o x.weft"), "no option of a point");
  expect_refused(point("pca --nan maybe"), "--nan");
  expect_refused(point("pca extra"), "extra is no option");
  expect_refused(point("vq --into base.weft"), "--into is no option");
  expect_refused(quick({raw}, folder / "out", {"--codecs", "pca", "--with", "--clusters 2"}),
                 "not a parameter of codec pca");
  expect_refused(quick({raw}, folder / "out", {"--codecs", "mp3"}), "mp3");
  expect_refused(quick({}, folder / "out", {}), "INPUT");
  expect_refused({"tradeoff", raw}, "--output");
  expect_refused(quick({raw}, raw, {}), "not a folder");
  expect_refused(quick({raw, copy}, folder / "out", {}), "hold the same bytes");
  expect_refused(quick({folder / "grid.json"}, folder / "out", {"--point", "pca"}), "grid.json");

  // A record that is none, and a folder in use.
  std::filesystem::create_directories(folder / "out");
  for (const char* text : {"no", "{}", R"({"format": "weft tradeoff", "format_version": 2})",
                           R"({"format": "weft tradeoff", "format_version": 1, "points": 3})"}) {
    std::ofstream(folder / "out" / "results.json") << text;
    expect_refused(point("pca"), "results.json");
  }
  std::filesystem::remove(folder / "out" / "results.json");
  const std::string out = folder / "out";
  const int descriptor = ::open(out.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  ASSERT_EQ(::flock(descriptor, LOCK_EX), 0);
  expect_refused(point("pca"), "in use by another run");
  ::close(descriptor);
}

}  // namespace
}  // namespace weft::test
