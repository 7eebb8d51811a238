// Writes files of ours into a folder, with values that check_safetensors.py knows as well:
//
//   write_sample_files FOLDER
//
//   raw_u8, raw_f16, raw_f32 .safetensors; raw_f16.npy with .json; model_f16, model_f32 .weft
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <vector>

#include "support/generators.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/model/pca.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

BtfInfo sample_info(DType dtype) {
  BtfInfo info = test::make_info({2, 3, 4, 5, 3}, dtype);
  info.encoding = Encoding::srgb;
  info.channel_names = {"R", "G", "B"};
  info.source = "a \"sample\"";
  info.mask.assign(info.shape.views * info.shape.texels(), 1);
  for (std::size_t i = 0; i < info.mask.size(); i += 7) info.mask[i] = 0;
  return info;
}

// U8: 7 i mod 256. F16: (i mod 1024) / 8 - 3. F32: i / 3 - 20, rounded to float.
template <typename T, typename Value>
void write_raw(TileSink& sink, const Value& value) {
  std::vector<T> values(sink.info().shape.values());
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<T>(value(i));
  sink.write(0, sink.info().shape.images(), std::as_bytes(std::span(values)));
  sink.finish();
}

std::uint16_t half_value(std::size_t i) {
  return float_to_half(static_cast<float>(i % 1024) / 8 - 3);
}

// Integers from -50 to 50 over 64, which half holds exactly; component j times 2^(100 - 110 j).
void write_sample_model(const std::filesystem::path& path, Storage storage) {
  const auto value = [](std::size_t i) { return (static_cast<float>(37 * i % 101) - 50) / 64; };
  PcaModel model;
  model.info.codec = "pca";
  model.info.parameters = R"({"rank":3})";
  model.info.storage = storage;
  model.info.btf = sample_info(DType::f16);
  const BtfShape& shape = model.info.btf.shape;
  model.rank = 3;
  const std::size_t row = shape.images() * shape.channels;
  for (std::size_t i = 0; i < row; ++i) model.mean.push_back(value(i));
  for (std::size_t i = 0; i < shape.texels() * model.rank; ++i) {
    model.coefficients.push_back(value(i + 1));
  }
  for (std::size_t j = 0; j < model.rank; ++j) {
    for (std::size_t i = 0; i < row; ++i) {
      model.basis.push_back(std::ldexp(value(i + 2), 100 - 110 * static_cast<int>(j)));
    }
  }
  write_model(path, model);
}

void write_all(const std::filesystem::path& folder) {
  write_raw<std::uint8_t>(*create_raw_btf(folder / "raw_u8.safetensors", sample_info(DType::u8)),
                          [](std::size_t i) { return 7 * i % 256; });
  write_raw<std::uint16_t>(*create_raw_btf(folder / "raw_f16.safetensors", sample_info(DType::f16)),
                           half_value);
  write_raw<float>(*create_raw_btf(folder / "raw_f32.safetensors", sample_info(DType::f32)),
                   [](std::size_t i) { return static_cast<double>(i) / 3 - 20; });
  write_raw<std::uint16_t>(*create_npy_btf(folder / "raw_f16.npy", sample_info(DType::f16)),
                           half_value);
  write_sample_model(folder / "model_f16.weft", Storage::f16);
  write_sample_model(folder / "model_f32.weft", Storage::f32);
}

}  // namespace
}  // namespace weft

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: write_sample_files FOLDER\n");
    return 2;
  }
  try {
    weft::write_all(argv[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
