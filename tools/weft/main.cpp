// The program `weft`: reads the command line, runs one subcommand and maps what went wrong to an
// exit status.
//
//   0 done                     3 no usable OpenCL device
//   1 request not met          4 run-time failure
//   2 bad usage or bad input   130 interrupted
//
// Errors are one line on standard error, `weft SUBCOMMAND: error: ...`, whatever the options; under
// --json standard output holds one JSON object if the subcommand came so far as to report, and
// nothing otherwise.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <string>

#include "subcommand.hpp"
#include "weft/error.hpp"
#include "weft/version.hpp"

namespace weft {

// Each is defined in the file of its subcommand.
void add_synth(CLI::App& program, Action& action);
void add_import(CLI::App& program, Action& action);
void add_resample(CLI::App& program, Action& action);
void add_compress(CLI::App& program, Action& action);
void add_reduce(CLI::App& program, Action& action);
void add_enlarge(CLI::App& program, Action& action);
void add_decompress(CLI::App& program, Action& action);
void add_verify(CLI::App& program, Action& action);
void add_info(CLI::App& program, Action& action);
void add_tradeoff(CLI::App& program, Action& action);
void add_render(CLI::App& program, Action& action);
void add_sheet(CLI::App& program, Action& action);
void add_bench(CLI::App& program, Action& action);
void add_devices(CLI::App& program, Action& action);
void add_tune(CLI::App& program, Action& action);

namespace {

using AddSubcommand = void (*)(CLI::App&, Action&);
// In the order of --help, which is the order of work.
constexpr AddSubcommand subcommands[] = {
    add_synth,   add_import,     add_resample, add_compress, add_reduce,
    add_enlarge, add_decompress, add_verify,   add_info,     add_tradeoff,
    add_render,  add_sheet,      add_devices,  add_bench,    add_tune,
};

constexpr int bad_usage = static_cast<int>(ErrorKind::input);
constexpr int runtime_failure = static_cast<int>(ErrorKind::runtime);

// The first signal asks the job to stop at its next granule and to leave no half file; the second
// one ends the process.
extern "C" void stop_on_signal(int) {
  request_interrupt();
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

void install_signal_handlers() {
  struct sigaction action = {};
  action.sa_handler = stop_on_signal;
  sigemptyset(&action.sa_mask);
  // Slow system calls go on where they were: the jobs themselves look at the request.
  action.sa_flags = SA_RESTART;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

// "weft compress", or "weft" where no subcommand was named.
std::string command_name(const CLI::App& program) {
  std::string name = program.get_name();
  for (const CLI::App* command : program.get_subcommands()) name += " " + command->get_name();
  return name;
}

int report_error(const std::string& command, const std::string& message, int status) {
  fmt::print(stderr, "{}: error: {}\n", command, message);
  return status;
}

// The error to report: what failed because the user stopped it (a driver's compiler, for one, gives
// up on a signal) was stopped by the user.
Error explained(const Error& error) {
  try {
    check_interrupt();
  } catch (const Error& interrupted) {
    return interrupted;
  }
  return error;
}

int run(int argc, char** argv) {
  CLI::App program("Compresses bidirectional texture functions and decompresses them.", "weft");
  program.set_version_flag("--version", std::string("weft ") + version(), "Print the version");
  program.set_help_flag("--help,-h", "Print this help");
  program.option_defaults()->always_capture_default();
  program.get_formatter()->column_width(28);
  program.require_subcommand(1);
  program.footer("'weft SUBCOMMAND --help' lists a subcommand's options with examples.");
  Action action;
  for (const AddSubcommand add : subcommands) add(program, action);

  // A misspelt subcommand is to be named; the parser would only miss one.
  const auto named = [argv](const CLI::App* command) { return command->check_name(argv[1]); };
  if (argc > 1 && argv[1][0] != '-' && program.get_subcommands(named).empty()) {
    fmt::print(stderr, "weft: error: unknown subcommand '{}'\nSee 'weft --help'.\n", argv[1]);
    return bad_usage;
  }

  // Read the whole command line before any work begins.
  try {
    program.parse(argc, argv);
  } catch (const CLI::Success& request) {
    return program.exit(request);  // --help or --version
  } catch (const CLI::ParseError& error) {
    const std::string command = command_name(program);
    fmt::print(stderr, "{}: error: {}\nSee '{} --help'.\n", command, error.what(), command);
    return bad_usage;
  } catch (const Error& error) {  // from the value of an option
    return report_error(command_name(program), error.what(), static_cast<int>(error.kind()));
  }

  const std::string command = command_name(program);
  try {
    install_signal_handlers();
    action();
    return 0;
  } catch (const Error& failure) {
    const Error error = explained(failure);
    return report_error(command, error.what(), static_cast<int>(error.kind()));
  } catch (const std::bad_alloc&) {
    return report_error(command, "out of memory", runtime_failure);
  } catch (const std::exception& error) {
    return report_error(command, error.what(), runtime_failure);
  }
}

}  // namespace
}  // namespace weft

int main(int argc, char** argv) {
  return weft::run(argc, argv);
}
