// weft tune: finds good values for the macros of kernels on this device and keeps them in the
// user's tuning database (weft/device/tuning.hpp).
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common.hpp"
#include "job_report.hpp"
#include "progress.hpp"
#include "report.hpp"
#include "subcommand.hpp"
#include "tune/search.hpp"
#include "tune/trial.hpp"
#include "weft/device/tuning.hpp"
#include "weft/device/tuning_file.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

struct TuneCommand {
  std::vector<std::string> kernels;
  double budget = 60;
  std::string output;
  std::uint64_t seed = 0;
  bool list = false;
  DeviceOptions device;
  OutputOptions report;
};

// The trials of the kernels that were asked for; of all if none was.
std::vector<Trial> wanted_trials(const std::vector<std::string>& kernels) {
  std::vector<Trial> trials = all_trials();
  if (kernels.empty()) return trials;
  std::vector<Trial> wanted;
  for (const std::string& name : kernels) {
    const auto found = std::ranges::find_if(
        trials, [&](const Trial& trial) { return trial.kernel && trial.kernel->name == name; });
    if (found == trials.end()) {
      std::string names;
      for (const Trial& trial : all_trials()) {
        names += fmt::format("{}{}", names.empty() ? "" : ", ", trial.kernel->name);
      }
      fail_input("--kernel {}: there is no such kernel to tune; there are {}", name, names);
    }
    wanted.push_back(std::move(*found));
    trials.erase(found);
  }
  return wanted;
}

void list_macros(const TuneCommand& options, const Device& device) {
  std::vector<std::vector<Cell>> rows;
  for (const TunableKernel* kernel : tunable_kernels()) {
    const bool wanted =
        options.kernels.empty() || std::ranges::count(options.kernels, kernel->name) > 0;
    if (!wanted) continue;
    const TuneValues values = device.tuning().values(*kernel);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const Tunable& macro = kernel->macros[i];
      std::string legal;
      for (const std::size_t value : macro.legal) {
        legal += fmt::format("{}{}", legal.empty() ? "" : " ", value);
      }
      rows.push_back({text_cell(kernel->name), text_cell(macro.macro), count_cell(values[i]),
                      count_cell(macro.standard), text_cell(legal),
                      text_cell(device.tuning().source(*kernel)), text_cell(macro.meaning)});
    }
  }
  Report report;
  report.add("device", device.limits().name);
  report.table("macros", {"kernel", "macro", "value", "default", "legal", "source", "meaning"},
               std::move(rows));
  report.print(options.report);
}

// What a search came to, as an entry of the database.
TuningResult result_of(const Device& device, const Trial& trial, const TuneOutcome& outcome) {
  TuningResult result;
  result.device = fingerprint(device.limits());
  result.kernel = trial.kernel->name;
  for (std::size_t i = 0; i < outcome.best.size(); ++i) {
    result.values[trial.kernel->macros[i].macro] = outcome.best[i];
  }
  result.shape = trial.timed.shape;
  result.default_seconds = outcome.base_seconds;
  result.seconds = outcome.improved ? outcome.best_seconds : outcome.base_seconds;
  return result;
}

std::vector<Cell> row_of(const Trial& trial, const TuneValues& base, const TuneOutcome& outcome,
                         bool written) {
  const double gain = outcome.base_seconds / outcome.best_seconds - 1;
  return {text_cell(trial.kernel->name),
          text_cell(trial.timed.shape),
          count_cell(outcome.legal),
          count_cell(outcome.tried),
          count_cell(outcome.rejected),
          text_cell(format_values(*trial.kernel, base)),
          number_cell(outcome.base_seconds * 1e3),
          text_cell(format_values(*trial.kernel, outcome.best)),
          number_cell((outcome.improved ? outcome.best_seconds : outcome.base_seconds) * 1e3),
          number_cell(outcome.improved ? 100 * gain : 0.0, "", 3),
          number_cell(100 * outcome.noise, "", 3),
          text_cell(outcome.improved ? "better" : "default kept"),
          flag_cell(written)};
}

void run_tune(const TuneCommand& options) {
  if (options.device.reference()) fail_input("--device reference: a device is tuned");
  std::vector<Trial> trials = wanted_trials(options.kernels);
  const std::filesystem::path file =
      options.output.empty() ? user_tuning_file() : std::filesystem::path(options.output);
  if (file.empty() && !options.list) {
    fail_input("--output: none given, and no folder for configuration is known");
  }
  const std::unique_ptr<Device> device = open_device(options.device, options.report);
  if (options.list) return list_macros(options, *device);
  check_tuning_file(file);

  // What entries of the user's are to beat: the values without any.
  const Tuning shipped(device->limits(), {}, shipped_tuning(), {});
  std::erase_if(trials,
                [&](const Trial& trial) { return trial.timed.fp64 && !device->limits().has_fp64; });
  std::vector<std::vector<Cell>> rows;
  std::vector<std::string> rejections;
  for (const Trial& trial : trials) {
    const TuneValues base = shipped.values(*trial.kernel);
    const TuneValues current = device->tuning().values(*trial.kernel);
    const bool has_entry = current != base;
    TuneOptions search;
    search.budget = options.budget / static_cast<double>(trials.size());
    search.seed = options.seed;
    std::unique_ptr<Progress> progress;
    search.progress = [&](std::size_t done, std::size_t all) {
      if (!progress) {
        progress = std::make_unique<Progress>(
            options.report, fmt::format("tune {}", trial.kernel->name), all, "candidates");
      }
      progress->update(done);
    };
    const std::vector<TuneValues> first =
        has_entry ? std::vector<TuneValues>{current} : std::vector<TuneValues>{};
    DeviceTrial work(*device, trial);
    const TuneOutcome outcome =
        tune_kernel(*trial.kernel, device->limits(), base, first, work, search);
    progress.reset();  // hardly ever were all candidates visited
    // An entry that is no better than the default any more gives way to it.
    const bool write = outcome.improved || has_entry;
    if (write) save_tuning(file, {result_of(*device, trial, outcome)});
    device->tune(*trial.kernel, outcome.best, file.string());
    rows.push_back(row_of(trial, base, outcome, write));
    for (const std::string& rejection : outcome.rejections) {
      rejections.push_back(fmt::format("{} {}", trial.kernel->name, rejection));
    }
  }

  Report report;
  report.add("device", device->limits().name);
  report.add("file", file.string());
  report.add("seed", options.seed);
  report.table("kernels",
               {"kernel", "shape", "legal", "tried", "rejected", "default_values", "default_ms",
                "best_values", "best_ms", "gain_percent", "noise_percent", "outcome", "written"},
               std::move(rows));
  if (!rejections.empty()) {
    std::vector<std::vector<Cell>> lines;
    for (const std::string& rejection : rejections) lines.push_back({text_cell(rejection)});
    report.table("rejections", {"candidate"}, std::move(lines));
  }
  report.print(options.report);
}

}  // namespace

void add_tune(CLI::App& program, Action& action) {
  auto options = std::make_shared<TuneCommand>();
  CLI::App* command = program.add_subcommand("tune", "Find fast kernel parameters for a device");
  command
      ->add_option("--kernel", options->kernels,
                   "Kernel to tune, for example gemm; may be given several times (default: all)")
      ->type_name("NAME");
  command
      ->add_option("--budget", options->budget,
                   "Time for all kernels together; the candidate at hand is finished")
      ->check(CLI::Range(0.0, 1e6))
      ->type_name("SECONDS");
  command
      ->add_option("--output", options->output,
                   "Tuning database to write to (default: the user's own)")
      ->type_name("FILE");
  add_seed_option(*command, options->seed, "the search");
  command->add_flag("--list", options->list,
                    "Only list the kernels' macros, their values and where these come from");
  add_device_options(*command, options->device);
  add_output_options(*command, options->report);
  command->footer(
      "Every candidate's result is checked against the reference before it is timed. Candidates "
      "and\n"
      "default take turns; the default is replaced only by what is better by more than the noise.\n"
      "The user's database is $WEFT_TUNING, else $XDG_CONFIG_HOME/weft/tuning.json, else\n"
      "~/.config/weft/tuning.json; every subcommand reads it. Its entries hold for the very "
      "device\n"
      "and driver they were found on. Results depend on them by no more than rounding.\n"
      "\n"
      "Examples:\n"
      "  weft tune --list\n"
      "  weft tune --budget 300\n"
      "  weft tune --kernel gemm --budget 120\n"
      "  weft tune --kernel decode_pca --output tuning.json --json");
  command->callback([options, &action] { action = [options] { run_tune(*options); }; });
}

}  // namespace weft
