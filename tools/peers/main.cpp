// weft_peers: Weft's matrix products beside those of OpenBLAS, Eigen and CLBlast on the same data,
// interleaved, in one run.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include "common.hpp"
#include "comparison.hpp"
#include "job_report.hpp"
#include "report.hpp"
#include "weft/error.hpp"
#include "weft/ops/peak.hpp"

namespace weft::peers {
namespace {

struct Options {
  std::string filter;
  std::string skip;
  int threads = 0;
  bool list = false;
  ComparisonOptions comparison;
  DeviceOptions device;
  OutputOptions report;
};

std::vector<std::unique_ptr<Contender>> contenders_of(const Options& options, Device& device,
                                                      const Case& c, const Matrices& matrices) {
  std::vector<std::unique_ptr<Contender>> contenders;
  const auto add = [&](std::unique_ptr<Contender> contender) {
    if (!contender) return;
    if (!options.skip.empty() && options.skip.find(contender->name()) != std::string::npos) return;
    contenders.push_back(std::move(contender));
  };
  add(own_contender(device, c, matrices));
  if (contenders.empty()) return {};  // no double on this device
  add(openblas_contender(c, matrices));
  add(eigen_contender(c, matrices));
#ifdef WEFT_HAS_CLBLAST
  add(clblast_contender(device, c, matrices));
#endif
  return contenders;
}

// Whether all agree.
bool add_rows(const Case& c, const std::vector<Standing>& standings,
              std::vector<std::vector<Cell>>& rows) {
  const Standing& own = standings.front();
  bool agree = true;
  for (const Standing& standing : standings) {
    const bool right = standing.disagreement <= 1;
    agree = agree && right;
    if (standing.seconds.empty()) {
      const Cell none{"", "null", true};
      rows.push_back({text_cell(c.name), text_cell(c.shape()), text_cell(standing.name), none, none,
                      none, none, none, none, text_cell(standing.failure)});
      continue;
    }
    rows.push_back(
        {text_cell(c.name), text_cell(c.shape()), text_cell(standing.name),
         count_cell(standing.seconds.size()), number_cell(standing.best() * 1e3),
         number_cell(standing.median() * 1e3), number_cell(c.flops() / standing.best() * 1e-9),
         number_cell(standing.best() / own.best(), "", 3),
         number_cell(standing.median() / own.median(), "", 3),
         text_cell(right ? "agrees"
                         : fmt::format("differs, {:.3g} times the bound", standing.disagreement))});
  }
  return agree;
}

int compare_all(const Options& options) {
  std::vector<Case> cases = all_cases();
  std::erase_if(cases,
                [&](const Case& c) { return c.name.find(options.filter) == std::string::npos; });
  if (cases.empty()) fail_input("--filter {}: no case's name contains it", options.filter);
  if (options.list) {
    for (const Case& c : cases) fmt::print("{}\n", c.name);
    return 0;
  }
  if (options.device.reference()) fail_input("--device reference: peers are compared on a device");
  const std::unique_ptr<Device> device = open_device(options.device, options.report);
  const int threads =
      options.threads > 0 ? options.threads : static_cast<int>(device->limits().compute_units);
  set_peer_threads(threads);
  for (const char* name : {"OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"}) {
    const char* forced = std::getenv(name);
    if (!forced) continue;
    fmt::print(stderr, "warning: {}={} overrides what OpenBLAS would choose for this machine\n",
               name, forced);
  }

  ops::Peaks peaks = ops::measure_peaks(*device);
  std::vector<std::vector<Cell>> rows;
  bool agree = true;
  for (const Case& c : cases) {
    if (!options.report.quiet) fmt::print(stderr, "{}\n", c.name);
    const Matrices matrices(c);
    const auto contenders = contenders_of(options, *device, c, matrices);
    if (contenders.empty()) continue;
    agree &= add_rows(c, compare(c, matrices, contenders, options.comparison), rows);
  }
  const ops::Peaks after = ops::measure_peaks(*device);
  Report report;
  report.add("device", device->limits().name);
  report.add("compute_units", device->limits().compute_units);
  report.add("openblas", openblas_name());
  report.add("peer_threads", threads);
  report.add("peak_fma", std::max(peaks.flops, after.flops) * 1e-9, "GFLOP/s");
  report.table("products",
               {"case", "shape", "library", "runs", "best_ms", "median_ms", "gflops", "times_ours",
                "median_times_ours", "result"},
               std::move(rows));
  add_device_fields(report, device);
  report.print(options.report);
  return agree ? 0 : static_cast<int>(ErrorKind::unmet_goal);
}

int run(int argc, char** argv) {
  Options options;
  CLI::App program(
      "Compares matrix products with those of OpenBLAS, Eigen and CLBlast, interleaved.",
      "weft_peers");
  program.option_defaults()->always_capture_default();
  program
      .add_option("--filter", options.filter,
                  "Only cases whose name contains this, for example 'sgemm 2048'")
      ->type_name("TEXT");
  program.add_option("--skip", options.skip, "Libraries to leave out: Eigen,CLBlast,OpenBLAS")
      ->type_name("NAMES");
  program.add_option("--rounds", options.comparison.rounds, "Turns of each library")
      ->check(CLI::Range(1, 1000))
      ->type_name("COUNT");
  program.add_option("--pause", options.comparison.pause, "Pause before each turn")
      ->check(CLI::Range(0.0, 60.0))
      ->type_name("SECONDS");
  program
      .add_option("--threads", options.threads,
                  "Threads of OpenBLAS and Eigen (default 0: the device's compute units)")
      ->check(CLI::Range(0, 1024))
      ->type_name("COUNT");
  program.add_flag("--list", options.list, "Only list the cases");
  add_device_options(program, options.device);
  add_output_options(program, options.report);
  program.footer(
      "'times ours' is a library's time over Weft's: above 1, Weft is faster. Exit status 1 if "
      "results\n"
      "differ by more than rounding can explain.\n"
      "\n"
      "Examples:\n"
      "  weft_peers\n"
      "  weft_peers --filter 'sgemm 2048' --rounds 9 --skip CLBlast\n"
      "  weft_peers --filter syrk --json");
  try {
    program.parse(argc, argv);
    return compare_all(options);
  } catch (const CLI::ParseError& error) {
    const int status = program.exit(error);
    return status == 0 ? 0 : static_cast<int>(ErrorKind::input);
  } catch (const Error& error) {
    fmt::print(stderr, "weft_peers: error: {}\n", error.what());
    return static_cast<int>(error.kind());
  } catch (const std::exception& error) {
    fmt::print(stderr, "weft_peers: error: {}\n", error.what());
    return static_cast<int>(ErrorKind::runtime);
  }
}

}  // namespace
}  // namespace weft::peers

int main(int argc, char** argv) {
  return weft::peers::run(argc, argv);
}
