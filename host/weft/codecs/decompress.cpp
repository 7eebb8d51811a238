#include "weft/codecs/decompress.hpp"

#include <algorithm>
#include <cstring>
#include <utility>
#include <vector>

#include "weft/btf/encoding.hpp"
#include "weft/device/tile_stream.hpp"
#include "weft/error.hpp"
#include "weft/ops/tile.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

void check_shapes(const BtfShape& from, const BtfShape& to) {
  if (from == to) return;
  fail_input(
      "images of {} x {} texels, {} channels, can't be written where {} x {} x {} are expected",
      from.height, from.width, from.channels, to.height, to.width, to.channels);
}

// Clamps floats that lie in bytes to +-limit.
void clamp_floats(std::span<std::byte> values, float limit) {
  for (std::size_t i = 0; i < values.size(); i += sizeof(float)) {
    float value = 0;
    std::memcpy(&value, values.data() + i, sizeof value);
    value = std::clamp(value, -limit, limit);
    std::memcpy(values.data() + i, &value, sizeof value);
  }
}

}  // namespace

void decompress(Device& device, const Model& model, TileSink& sink, Job& job) {
  const BtfShape& shape = model.info.btf.shape;
  const BtfInfo& output = sink.info();
  check_shapes(shape, output.shape);
  const Codec& codec = find_codec(model.info.codec);
  const std::size_t run = image_granule(shape);
  const std::size_t values = run * shape.image_values();
  const std::size_t bytes = values * size_of(output.dtype);

  MemoryPlan plan;
  plan.add("model on the device", codec.decoder_bytes(model));
  plan.add("decoded images", values * sizeof(float));
  plan.add("converted images", 4 * bytes);  // two runs on the device, two on the host
  job.plan(plan);

  const std::unique_ptr<DeviceDecoder> decoder = codec.decoder(device, model);
  Buffer decoded(device, values * sizeof(float), "decoded images");
  // Two runs are in hand: one being decoded, one being written.
  struct Slot {
    Buffer converted;
    std::vector<std::byte> host;
    Handle<cl_event> ready;
    std::size_t first = 0;
    std::size_t count = 0;
  };
  Slot slots[2];
  for (Slot& slot : slots) {
    slot.converted = Buffer(device, bytes, "converted images");
    slot.host.resize(bytes);
  }
  // However it ends, no copy may still be under way into `slots`.
  struct Finish {
    Device& device;
    ~Finish() { clFinish(device.queue()); }
  } const finish{device};

  const auto write_out = [&](Slot& slot) {
    if (slot.count == 0) return;
    {
      const StageTimer timer(job, "decode (waited for)");
      wait_for(slot.ready);
    }
    const StageTimer timer(job, "write", 0, static_cast<double>(slot.count * output.image_bytes()));
    sink.write(slot.first, slot.count,
               std::span(slot.host).first(slot.count * output.image_bytes()));
    job.advance("decompress", slot.first + slot.count, shape.images());
    slot.count = 0;
  };
  for (std::size_t first = 0, index = 0; first < shape.images(); first += run, ++index) {
    check_interrupt();
    Slot& slot = slots[index % 2];
    write_out(slot);
    slot.first = first;
    slot.count = std::min(run, shape.images() - first);
    decoder->decode(first, slot.count, decoded);
    ops::transcode_tile(device, slot.count * shape.image_values(), decoded, model.info.btf.encoding,
                        output.encoding, output.dtype, slot.converted);
    slot.ready = device.read_later(slot.converted, 0,
                                   std::span(slot.host).first(slot.count * output.image_bytes()));
    job.stage("decode (waited for)").flops +=
        decoder->image_flops() * static_cast<double>(slot.count);
    write_out(slots[(index + 1) % 2]);
  }
  for (Slot& slot : slots) write_out(slot);
  const StageTimer timer(job, "write");
  sink.finish();
  device.finish();
}

void copy_images(TileSource& source, TileSink& sink, Job& job) {
  const BtfInfo& input = source.info();
  const BtfInfo& output = sink.info();
  check_shapes(input.shape, output.shape);
  const Representation from{input.dtype, input.encoding};
  const Representation to{output.dtype, output.encoding};
  const std::size_t run = image_granule(input.shape);
  // The stored value whose light is the largest half.
  const auto limit = static_cast<float>(
      encode_from_linear(input.encoding, decode_to_linear(output.encoding, double{half_max})));
  std::vector<std::byte> values(run * input.image_bytes());
  std::vector<std::byte> converted(run * output.image_bytes());
  for (std::size_t first = 0; first < input.shape.images(); first += run) {
    check_interrupt();
    const std::size_t count = std::min(run, input.shape.images() - first);
    const std::span<std::byte> in = std::span(values).first(count * input.image_bytes());
    const std::span<std::byte> out = std::span(converted).first(count * output.image_bytes());
    source.read(first, count, in);
    source.release(first, count);
    if (input.dtype == DType::f32 && output.dtype == DType::f16) clamp_floats(in, limit);
    convert_values(from, in, to, out, "the output");
    sink.write(first, count, out);
    job.advance("decompress", first + count, input.shape.images());
  }
  sink.finish();
}

}  // namespace weft
