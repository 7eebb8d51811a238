#include "job_report.hpp"

#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace weft {

ReportedJob::ReportedJob(const DeviceOptions& device, const OutputOptions& output, std::string unit)
    : output_(output), unit_(std::move(unit)) {
  job_.memory = device.memory;
  job_.on_plan = [this](const MemoryPlan& plan) {
    plan_ = plan;
    if (output_.quiet) return;
    std::string items;
    for (const MemoryItem& item : plan.items) {
      if (item.bytes == 0) continue;
      items +=
          fmt::format("{}{} {}", items.empty() ? "" : ", ", item.what, format_bytes(item.bytes));
    }
    std::string line = fmt::format("memory: {} of {} ({})", format_bytes(plan.total()),
                                   format_bytes(plan.limit), items);
    if (line == shown_plan_) return;  // as of every frame of a turntable
    fmt::print(stderr, "{}\n", line);
    shown_plan_ = std::move(line);
  };
  job_.progress = [this](const std::string& stage, std::size_t done, std::size_t total) {
    if (stage != stage_) {
      finish_progress();
      stage_ = stage;
      progress_ = std::make_unique<Progress>(output_, stage, total, unit_);
    }
    progress_->update(done);
  };
}

void ReportedJob::finish_progress() {
  if (progress_) progress_->finish();
  progress_.reset();
  stage_.clear();
}

void ReportedJob::add_fields(Report& report) const {
  report.add("memory_limit", bytes_cell(plan_.limit));
  report.add("memory_planned", bytes_cell(plan_.total()));
  std::vector<std::vector<Cell>> rows;
  for (const Stage& stage : job_.stages) {
    const auto rate = [&](double amount) {
      return amount > 0 && stage.seconds > 0 ? number_cell(amount / stage.seconds * 1e-9)
                                             : Cell{"", "null", true};
    };
    rows.push_back(
        {text_cell(stage.name), number_cell(stage.seconds), rate(stage.flops), rate(stage.bytes)});
  }
  report.table("stages", {"stage", "seconds", "gflops", "gigabytes_per_second"}, std::move(rows));
  std::string notes;
  for (const std::string& note : job_.notes) notes += (notes.empty() ? "" : "; ") + note;
  if (!notes.empty()) report.add("notes", notes);
}

std::unique_ptr<Device> open_device(const DeviceOptions& options, const OutputOptions& output) {
  if (options.reference()) return nullptr;
  auto device = std::make_unique<Device>(options.device, options.profile);
  if (!output.quiet) {
    for (const std::string& warning : device->tuning().warnings()) {
      fmt::print(stderr, "warning: {}\n", warning);
    }
  }
  return device;
}

namespace {

// {"gemm": {"source": "shipped", "MC": 96}, ...} of the kernels that ran; in the table the sources.
Cell tuning_cell(const Tuning& tuning) {
  nlohmann::json object = nlohmann::json::object();
  std::string text;
  for (const std::string& name : tuning.used()) {
    const TunableKernel& kernel = *find_tunable(name);
    const std::vector<std::size_t> values = tuning.values(kernel);
    nlohmann::json entry = {{"source", tuning.source(kernel)}};
    for (std::size_t i = 0; i < values.size(); ++i) entry[kernel.macros[i].macro] = values[i];
    object[name] = std::move(entry);
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", name, tuning.source(kernel));
  }
  return {text, object.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace), false};
}

}  // namespace

std::string device_name(const std::unique_ptr<Device>& device) {
  return device ? device->limits().name : std::string("reference");
}

void add_device_fields(Report& report, const std::unique_ptr<Device>& device) {
  if (!device) return;
  device->finish();  // collects the times of what was waited for by other means
  report.add("peak_device_memory", bytes_cell(device->peak_allocated()));
  if (!device->tuning().used().empty()) report.add("tuning", tuning_cell(device->tuning()));
  if (!device->profile().empty()) add_profile_table(report, device->profile());
}

}  // namespace weft
