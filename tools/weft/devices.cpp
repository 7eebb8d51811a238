// weft devices: the OpenCL devices of this machine, numbered as --device counts them.
#include <CLI/CLI.hpp>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common.hpp"
#include "report.hpp"
#include "subcommand.hpp"
#include "weft/device/device.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

void run_devices(const OutputOptions& options) {
  const std::vector<DeviceLimits> devices = list_devices();
  std::vector<std::vector<Cell>> rows;
  for (std::size_t index = 0; index < devices.size(); ++index) {
    const DeviceLimits& d = devices[index];
    const auto size = [](std::size_t bytes) {
      return Cell{format_bytes(bytes), std::to_string(bytes), true};
    };
    rows.push_back({count_cell(index), text_cell(d.name), text_cell(d.platform),
                    text_cell(d.is_cpu ? "CPU" : "GPU or other"), text_cell(d.version),
                    count_cell(d.compute_units), size(d.global_memory), size(d.largest_allocation),
                    size(d.local_memory), flag_cell(d.has_fp64), flag_cell(d.has_fp16),
                    flag_cell(d.unified_memory)});
  }
  Report report;
  report.table("devices",
               {"index", "name", "platform", "kind", "version", "compute_units", "global_memory",
                "largest_allocation", "local_memory", "fp64", "fp16", "unified_memory"},
               std::move(rows));
  if (options.json || !devices.empty()) report.print(options);
  if (devices.empty()) {
    fail(ErrorKind::no_device,
         "there is no OpenCL device; a CPU becomes one with 'apt-get install pocl-opencl-icd', a "
         "GPU "
         "with its maker's driver; '--device reference' works without any");
  }
}

}  // namespace

void add_devices(CLI::App& program, Action& action) {
  auto options = std::make_shared<OutputOptions>();
  CLI::App* command = program.add_subcommand("devices", "List the OpenCL devices of this machine");
  add_output_options(*command, *options);
  command->footer(
      "Exit status 3 if there is none.\n"
      "\n"
      "Examples:\n"
      "  weft devices\n"
      "  weft devices --json\n"
      "  weft compress cloth.safetensors --codec pca --device 0 -o cloth.weft");
  command->callback([options, &action] { action = [options] { run_devices(*options); }; });
}

}  // namespace weft
