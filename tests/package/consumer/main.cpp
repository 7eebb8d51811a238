// Writes a small raw BTF into the folder given, reads it back, and lists the codecs
// and the OpenCL devices.
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/directions.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/device/device.hpp"
#include "weft/error.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/version.hpp"

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  try {
    weft::BtfInfo info;
    info.shape = {1, 3, 2, 2, 3};
    info.dtype = weft::DType::u8;
    info.view_directions = weft::even_directions(1);
    info.light_directions = weft::even_directions(3);

    const std::filesystem::path path = std::filesystem::path(argv[1]) / "small.safetensors";
    const std::vector<std::byte> values(info.bytes(), std::byte{7});
    const std::unique_ptr<weft::TileSink> sink = weft::create_raw_btf(path, info);
    sink->write(0, info.shape.images(), values);
    sink->finish();

    const std::shared_ptr<weft::TileSource> source = weft::open_raw_btf(path);
    std::vector<std::byte> read(info.bytes());
    source->read(0, info.shape.images(), read);
    if (read != values) return 1;

    std::printf("weft %s\n", weft::version());
    for (const weft::Codec* codec : weft::codecs()) {
      std::printf("%.*s\n", static_cast<int>(codec->name().size()), codec->name().data());
    }
    for (const weft::DeviceLimits& device : weft::list_devices()) {
      std::printf("%s\n", device.name.c_str());
    }
    return 0;
  } catch (const weft::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return static_cast<int>(error.kind());
  }
}
