// What subcommands share: options in the same words everywhere, sizes, kinds of output.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "weft/size_text.hpp"
#include "weft/tensor/dtype.hpp"

namespace CLI {
class App;
}

namespace weft {

// --json --quiet
struct OutputOptions {
  bool json = false;   // the report on standard output is one JSON object
  bool quiet = false;  // no progress, and no report unless it is JSON
};
void add_output_options(CLI::App& command, OutputOptions& options);

// --device --memory --profile
struct DeviceOptions {
  std::string device = "auto";
  std::size_t memory = std::size_t{2} << 30;  // bytes
  bool profile = false;

  // Whether the work is to be done by the Eigen reference, without any OpenCL device.
  bool reference() const { return device == "reference"; }
};
void add_device_options(CLI::App& command, DeviceOptions& options);

// --seed, a number of 64 bits; `what` is seeded.
void add_seed_option(CLI::App& command, std::uint64_t& seed, const std::string& what);

// "u8", "f16" or "f32". Throws an input error that names `option` and the text.
DType parse_dtype(std::string_view text, std::string_view option);

struct ImageSize {
  std::size_t width = 0;
  std::size_t height = 0;
};
// "128" or "256x128", width first; sides from 1 to 16384. Throws an input error that names `option`
// and the text.
ImageSize parse_image_size(std::string_view text, std::string_view option);

// What an output is, by its name.
enum class OutputKind {
  folder,       // images: an existing folder, a name that ends in / or has no extension
  npy,          // NAME.npy, with its directions in NAME.json
  safetensors,  // a raw BTF
  model         // NAME.weft
};
// Throws an input error for any other extension.
OutputKind output_kind(const std::filesystem::path& path);

// Throws an input error if a file of that name can't be made: to be found before the work.
void check_can_create(const std::filesystem::path& path);

}  // namespace weft
