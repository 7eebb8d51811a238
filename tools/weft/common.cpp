#include "common.hpp"

#include <CLI/CLI.hpp>
#include <charconv>

#include "weft/error.hpp"
#include "weft/io/atomic_file.hpp"

namespace weft {
namespace {

// Longest side of an image that is asked for.
constexpr std::size_t largest_side = 16384;

}  // namespace

void add_output_options(CLI::App& command, OutputOptions& options) {
  command.add_flag("--json", options.json, "Report as one JSON object on standard output")
      ->group("Report");
  command
      .add_flag("--quiet", options.quiet, "No progress, and no report unless --json asks for one")
      ->group("Report");
}

void add_device_options(CLI::App& command, DeviceOptions& options) {
  command
      .add_option("--device", options.device,
                  "auto (the first GPU, else the first device), reference (Eigen, without OpenCL), "
                  "an index of 'weft devices', or a part of a device's name")
      ->type_name("CHOICE")
      ->group("Device");
  command
      .add_option_function<std::string>(
          "--memory",
          [&options](const std::string& text) { options.memory = parse_size(text, "--memory"); },
          "Bound on the job's memory, host and device together, not counting pages of a mapped "
          "input")
      ->type_name("SIZE")
      ->default_str("2GiB")
      ->group("Device");
  command.add_flag("--profile", options.profile, "Report the time spent in each kernel")
      ->group("Device");
}

void add_seed_option(CLI::App& command, std::uint64_t& seed, const std::string& what) {
  command
      .add_option_function<std::string>(
          "--seed",
          [&seed](const std::string& text) {
            const char* const end = text.data() + text.size();
            const auto parsed = std::from_chars(text.data(), end, seed);
            if (parsed.ec != std::errc{} || parsed.ptr != end) {
              fail_input("--seed {}: a whole number from 0 to 2^64 - 1 is needed", text);
            }
          },
          "Seed of " + what)
      ->type_name("NUMBER")
      ->default_str("0");
}

DType parse_dtype(std::string_view text, std::string_view option) {
  if (text == "u8") return DType::u8;
  if (text == "f16") return DType::f16;
  if (text == "f32") return DType::f32;
  fail_input("{}: '{}' is not u8, f16 or f32", option, text);
}

ImageSize parse_image_size(std::string_view text, std::string_view option) {
  const auto side = [text, option](std::string_view digits) {
    std::size_t value = 0;
    const char* const end = digits.data() + digits.size();
    const auto [stop, status] = std::from_chars(digits.data(), end, value);
    if (status != std::errc{} || stop != end || value < 1 || value > largest_side) {
      fail_input("{}: '{}' is not N or WIDTHxHEIGHT with sides from 1 to {}", option, text,
                 largest_side);
    }
    return value;
  };
  const std::size_t cross = text.find('x');
  if (cross == std::string_view::npos) return {side(text), side(text)};
  return {side(text.substr(0, cross)), side(text.substr(cross + 1))};
}

OutputKind output_kind(const std::filesystem::path& path) {
  if (path.empty()) fail_input("the output has an empty name");
  if (!path.has_filename() || std::filesystem::is_directory(path)) return OutputKind::folder;
  const std::string extension = path.extension().string();
  if (extension.empty()) return OutputKind::folder;
  if (extension == ".npy") return OutputKind::npy;
  if (extension == ".safetensors") return OutputKind::safetensors;
  if (extension == ".weft") return OutputKind::model;
  fail_input(
      "{}: unknown kind of output '{}'; known: .safetensors (raw BTF), .npy, .weft (model), or a "
      "folder for images (a name without extension, or one that ends in /)",
      path.string(), extension);
}

void check_can_create(const std::filesystem::path& path) {
  const AtomicFile temporary(path);  // which is removed again
}

}  // namespace weft
