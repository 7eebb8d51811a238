// What subcommands that run a Job on a device or by the reference share.
#pragma once

#include <memory>
#include <string>

#include "common.hpp"
#include "progress.hpp"
#include "report.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"

namespace weft {

// A Job wired to the options: memory, progress bars per stage, and the memory plan said before the
// work on standard error (not under --quiet).
class ReportedJob {
 public:
  // `unit` is what the job's stages count.
  ReportedJob(const DeviceOptions& device, const OutputOptions& output,
              std::string unit = "images");
  ReportedJob(const ReportedJob&) = delete;
  ReportedJob& operator=(const ReportedJob&) = delete;

  Job& job() { return job_; }
  // Ends the progress line that is open.
  void finish_progress();
  // Fields `memory_plan`, `stages` and `notes`.
  void add_fields(Report& report) const;

 private:
  OutputOptions output_;
  Job job_;
  MemoryPlan plan_;
  std::string shown_plan_;  // the line as it was said last
  std::string unit_;
  std::string stage_;
  std::unique_ptr<Progress> progress_;
};

// The device of the options, or null for the reference. Says on standard error which entries of
// tuning databases are ignored (not under --quiet).
std::unique_ptr<Device> open_device(const DeviceOptions& options, const OutputOptions& output);
// "reference" or the device's name.
std::string device_name(const std::unique_ptr<Device>& device);
// Device memory at its peak, where the values of the kernels' macros came from, and the kernels'
// times under --profile.
void add_device_fields(Report& report, const std::unique_ptr<Device>& device);

}  // namespace weft
